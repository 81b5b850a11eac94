"""`cadtof calibrate dark`: covered-lens frames → offsets, noise and bad pixels."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cadtof_cli.calibration.dark import Defect
from cadtof_cli.calibration.fit.dark import fit_dark, tells_dead
from cadtof_cli.calibration.fit.light import light_seen
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CaptureError, SettingsError
from cadtof_cli.phasors.frame_mean import MeanVolts
from cadtof_cli.workflows.calibrate.captures import (
    CalibrateReport,
    CalibrateSettings,
    averaged_captures,
    length_in_words,
    predicted_noise_v,
    save_with_report,
)
from cadtof_cli.workflows.progress import Progress


def calibrate_dark(inputs: Sequence[Path], /, *, settings: CalibrateSettings, progress: Progress) -> CalibrateReport:
    """Measure the dark part from one capture and write it.

    Raise CadtofError as `averaged_captures` does, or if there are several captures, or the frames saw light.
    """
    averaged = averaged_captures(inputs, "dark", settings=settings, progress=progress)
    if len(averaged.captures) > 1:
        raise SettingsError(f"found {len(averaged.captures)} captures, expected one, recorded with the lens covered")
    capture, mean = averaged.captures[0]
    _require_dark(capture, mean)
    metadata = capture.source.metadata
    dark = fit_dark(mean, origin=averaged.origin, predicted_noise_v=predicted_noise_v(metadata))
    dark = replace(dark, zero_v=metadata.voltage.zero_v)
    counts = dark.defect_counts()
    known = zip(counts.values(), Defect, strict=True)
    findings = tuple(f"{count} pixels with {defect.meaning}" for count, defect in known if count)
    if mean.frames < 2:
        findings += (
            "only one frame: the noise was not measured but predicted from the integration length "
            f"({length_in_words(metadata)}), and noisy and dead pixels were not looked for",
        )
    elif not tells_dead(mean):
        findings += (
            f"only {mean.frames} frames: a sound pixel may hold the same count in all of them by chance, so dead pixels were not "
            "looked for",
        )
    bad = int(dark.hot.sum())
    return save_with_report(dark, settings, {**dark.quality(), "bad_pixels": bad, "defects": counts}, findings)


def _require_dark(capture: Capture, mean: MeanVolts) -> None:
    """Make sure that the frames saw no light. Offsets from lit frames would subtract their scene from every other frame."""
    modulation = capture.source.metadata.modulation
    seen = light_seen(mean.volts, harmonics=modulation.harmonics, amplitude_v=modulation.amplitude_v)
    if seen.follows_law:
        raise CaptureError(
            f"{capture.root}: these frames saw light: from pixel to pixel, the values of all harmonics and channels change "
            "together; light does that, offsets do not: cover the lens, or switch the laser off and darken the room, and "
            "record again"
        )
    if seen.is_lit:
        voltage = capture.source.metadata.voltage
        middle = voltage.zero + float(np.nanmedian(mean.volts)) / (voltage.volts_per_count or 1.0)
        raise CaptureError(
            f"{capture.root}: these frames saw light, or zero_counts is wrong: at every harmonic, all pixels have at least "
            f"{seen.level:.0%} of the modulation amplitude in common, which is too much for offsets; cover the lens and record "
            f"again; if it was covered, correct --zero-counts, the stored value of 0 V: their median is {middle:.6g}"
        )
