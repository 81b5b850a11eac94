"""A calibration folder as a run of `resolve` uses it: checked against the captures, and what is said of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cadtof_cli.capture.frames import Capture, typical_file
from cadtof_cli.frame_plan import CalibrationUse
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration


@dataclass(frozen=True)
class AppliedCalibration:
    """What workers are handed, what `run.json` says, and notes for the user."""

    use: CalibrationUse
    parts: Mapping[str, Mapping[str, Any]]
    notes: tuple[str, ...]


def use_calibration(folder: Path, captures: Sequence[Capture], /) -> AppliedCalibration:
    """Read a calibration folder and make sure that it belongs to the captures.

    Raises:
        MetadataError: it cannot be read, or is damaged.
        SettingsError: size of the array, periods or waveform differ from a capture's.
    """
    from cadtof_cli.calibration.store import load_calibration

    calibration = load_calibration(folder)
    for capture in captures:
        typical = typical_file(capture)
        calibration.require_match(capture.source.metadata, typical.pixels if typical else None)
    digests = calibration.digests
    parts: dict[str, Mapping[str, Any]] = {
        part.kind: {
            "digest": digests[part.kind],
            "created": part.origin.created,
            "version": part.origin.version,
            "captures": list(part.origin.captures),
        }
        for part in calibration.parts
    }
    notes = (
        f"{folder}: applied {_description(calibration)}",
        *(f"warning: {folder}: {text}" for text in calibration.stale()),
    )
    return AppliedCalibration(CalibrationUse(folder, calibration.digest), parts, notes)


def _description(calibration: "Calibration") -> str:
    said = []
    if calibration.dark is not None:
        said.append(f"dark ({int(calibration.dark.hot.sum())} bad pixels)")
    if calibration.response is not None:
        orders = sorted({k for one in calibration.response.responses for k, _ in one.terms}, key=lambda k: (abs(k), -k))
        shown = f"k = {', '.join(map(str, orders[:6]))}{' …' if len(orders) > 6 else ''}"
        curved = calibration.petzval is None and any(calibration.response.field_curvature_m)
        said.append(f"response ({shown}{'; with the field curvature it found' if curved else ''})")
    if calibration.petzval is not None:
        said.append(f"petzval (k2 = {calibration.petzval.k2_m:.4f} m, k4 = {calibration.petzval.k4_m:.4f} m)")
    return ", ".join(said)
