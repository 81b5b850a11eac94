"""`cadtof calibrate response`: flat targets at known distances → G[h,k], and maps of phase and gain."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.calibration.fit.response import TargetMean, fit_response
from cadtof_cli.calibration.response import ResponseCalibration
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.frame_mean import MeanVolts
from cadtof_cli.workflows.calibrate.captures import (
    CalibrateReport,
    CalibrateSettings,
    averaged_captures,
    predicted_noise_v,
    save_with_report,
)
from cadtof_cli.workflows.progress import Progress

FRAMES_ENOUGH = 3
"""Number of frames that is enough to measure the noise of their mean by their scatter."""


def calibrate_response(
    inputs: Sequence[Path], /, *, settings: CalibrateSettings, progress: Progress
) -> CalibrateReport:
    """Measure the response part from captures of a flat target and write it.

    Raise CadtofError as `averaged_captures` does, or if a target's distance is not known.
    """
    averaged = averaged_captures(inputs, "response", settings=settings, progress=progress)
    for capture, _ in averaged.captures:
        if capture.source.metadata.target.distance_m is None:
            raise SettingsError(
                f"{capture.root}: the target's distance is not known: set distance_m under [target] in capture.toml, or "
                "--distance, once for all captures or once each"
            )
    targets = [_target(capture, mean, averaged.earlier) for capture, mean in averaged.captures]
    metadata = averaged.captures[0][0].source.metadata
    response = fit_response(targets, metadata=metadata, origin=averaged.origin)
    return save_with_report(response, settings, _figures(response), response.quality.findings)


def _target(capture: Capture, mean: MeanVolts, earlier: Calibration | None) -> TargetMean:
    volts, noise = mean.volts, predicted_noise_v(capture.source.metadata)
    noise = mean.mean_noise() if mean.frames >= FRAMES_ENOUGH else noise / math.sqrt(mean.frames)
    offset_noise_v = earlier.dark.quality()["offset_stderr_v"] if earlier and earlier.dark else 0.0
    if earlier and earlier.dark:
        volts = np.where(earlier.dark.hot, np.nan, volts - earlier.dark.offset_v)
        noise = np.hypot(noise, offset_noise_v)
    distance = capture.source.metadata.target.distance_m
    assert distance is not None
    return TargetMean(volts[:, 0] + 1j * volts[:, 1], noise, distance, offset_noise_v)


def _figures(response: ResponseCalibration) -> dict[str, Any]:
    main = [one.main for one in response.responses]
    return {
        "distances_m": list(response.quality.distances_m),
        "gain": [abs(g) for g in main],
        "phase_rad": [float(np.angle(g)) for g in main],
        "terms": {
            f"H{one.harmonic}": {f"{k:+d}": [(g / one.main).real, (g / one.main).imag] for k, g in one.terms if k != 1}
            for one in response.responses
        },
        "pixel_phase_std_rad": response.phase_rad.std(axis=(1, 2)).tolist(),
        "pixel_phase_stderr_rad": list(response.quality.phase_stderr_rad),
        "pixel_gain_std": response.gain.std(axis=(1, 2)).tolist(),
        "pixel_gain_stderr": list(response.quality.gain_stderr),
        "residual": response.quality.residual,
        "field_curvature_m": [response.curvature.k2_m, response.curvature.k4_m],
    }
