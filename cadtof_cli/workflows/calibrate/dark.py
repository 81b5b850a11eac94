"""`cadtof calibrate dark`: covered-lens frames → offsets, noise and bad pixels."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cadtof_cli.calibration.dark import DEFECT_MEANING, Defect, fit_dark
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.errors import SettingsError
from cadtof_cli.workflows.calibrate.captures import (
    CalibrateReport,
    CalibrateSettings,
    averaged_captures,
    origin_of,
    saved,
)
from cadtof_cli.workflows.progress import Progress


def calibrate_dark(
    inputs: Sequence[Path], /, *, settings: CalibrateSettings, overrides: Mapping[str, Any], progress: Progress
) -> CalibrateReport:
    """Measure the dark part from one capture and write it.

    Raises:
        CadtofError: see `averaged_captures`; or there are several captures.
    """
    averaged = averaged_captures(inputs, "dark", settings=settings, overrides=overrides, progress=progress)
    if len(averaged) > 1:
        raise SettingsError(f"found {len(averaged)} captures, expected one of covered-lens frames")
    dark = fit_dark(averaged[0].mean, origin=origin_of(averaged, Calibration()))
    counts = dark.defect_counts()
    findings = tuple(
        f"{counts[bit.name.lower()]} pixels with {DEFECT_MEANING[bit]}"
        for bit in Defect
        if bit.name and counts[bit.name.lower()]
    )
    if averaged[0].mean.frames < 2:
        findings += ("one frame only: no noise was measured, and noisy or dead pixels were not looked for",)
    bad = int(dark.hot.sum())
    return saved(dark, settings, {**dark.quality(), "bad_pixels": bad, "defects": counts}, findings)
