"""What a calibration folder holds, for `cadtof info`."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cadtof_cli.calibration.parts import PART_KINDS
from cadtof_cli.calibration.store import load_calibration
from cadtof_cli.errors import CadtofError
from cadtof_cli.files.reading import is_folder


@dataclass
class CalibrationFacts:
    """The digest of a calibration folder, and for each of its parts the origin and the figures."""

    path: str
    digest: str | None = None
    parts: dict[str, dict[str, Any]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def is_calibration_folder(path: Path, /) -> bool:
    """Tell whether a folder is one that `cadtof calibrate` wrote."""
    return is_folder(path) and any(os.path.lexists(path / f"{kind}.toml") for kind in PART_KINDS)


def facts_of_calibration(path: Path, /) -> CalibrationFacts:
    """Return what a calibration folder holds; a part that cannot be read, or is out of date, is a problem."""
    facts = CalibrationFacts(str(path))
    try:
        calibration = load_calibration(path)
    except CadtofError as error:
        facts.problems.append(str(error))
        return facts
    facts.digest = calibration.digest
    facts.problems += calibration.stale()
    for part in calibration.parts:
        origin = part.origin
        height, width = origin.pixels
        facts.parts[part.kind] = {
            "digest": calibration.digests[part.kind],
            "captures": list(origin.captures),
            "frames": origin.frames,
            "pixels": [width, height],
            "periods_ns": list(origin.periods_ns),
            "waveform": origin.waveform,
            "created": origin.created,
            "version": origin.version,
            **_plain(part.tables()),
        }
    return facts


def _plain(value: Any) -> Any:
    """Return numpy's numbers as Python's own, wherever they stand."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if hasattr(value, "item") else value
