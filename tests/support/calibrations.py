"""A made-up calibration: every pixel has other values, so that a test notices if pixels are mixed up."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.parts import FieldCurvature, Origin
from cadtof_cli.calibration.petzval import PetzvalCalibration, PetzvalQuality
from cadtof_cli.calibration.response import ResponseCalibration, ResponseQuality
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response

PETZVAL_QUALITY = PetzvalQuality(0.01, 0.001, 0.001, 0.5, 28.0, True, ())


def curved(
    k2_m: float, k4_m: float, point_px: tuple[float, float], *, k2_stderr_m: float = 0.001, k4_stderr_m: float = 0.002
) -> FieldCurvature:
    """Return field curvature about a principal point."""
    return FieldCurvature(
        k2_m=k2_m, k4_m=k4_m, k2_stderr_m=k2_stderr_m, k4_stderr_m=k4_stderr_m, principal_point_px=point_px
    )


def response_quality(harmonics: int, *, phase_stderr_rad: float = 0.0) -> ResponseQuality:
    """Return the quality of a response of so many harmonics; each has this standard error of the phase."""
    return ResponseQuality((), 1.0, (phase_stderr_rad,) * harmonics, (0.0,) * harmonics, (), ())


def made_up_calibration(metadata: CaptureMetadata, pixels: tuple[int, int], parts: Collection[str], /) -> Calibration:
    """Return the named parts for captures of a sine: offsets, hot pixels, gains, delays, imbalance, curvature."""
    rng = np.random.default_rng(11)
    modulation = metadata.modulation
    origin = Origin(
        captures=("made up",),
        frames=1,
        pixels=pixels,
        periods_ns=modulation.periods_ns,
        waveform=modulation.waveform,
        created="2026-01-01T00:00:00+00:00",
    )
    shape = (len(modulation.periods_ns), *pixels)
    offset_v = rng.normal(scale=2e-3, size=(shape[0], 2, *pixels)).astype(np.float32)
    dark = DarkCalibration(
        origin, offset_v, np.full_like(offset_v, 4e-4), (rng.random(pixels) < 0.02).astype(np.uint32)
    )
    responses = tuple(
        HarmonicResponse(one.harmonic, ((1, one.main * (0.97 + 0.04j)), (-1, 0.02 - 0.01j)))
        for one in ideal_response(metadata)
    )
    response = ResponseCalibration(
        origin,
        responses,
        rng.normal(scale=0.05, size=shape).astype(np.float32),
        rng.uniform(0.9, 1.1, shape).astype(np.float32),
        curved(0.03, -0.02, (pixels[1] / 4, pixels[0] / 3)),
        response_quality(shape[0]),
    )
    petzval = PetzvalCalibration(origin, curved(0.05, -0.03, (pixels[1] / 3, pixels[0] / 2)), PETZVAL_QUALITY)
    every = Calibration(dark, response, petzval)
    return replace(Calibration(), **{name: getattr(every, name) for name in parts})
