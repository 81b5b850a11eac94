"""Whether a `run.json` is what those expect who come after a run: it may come from anywhere."""

import operator
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cadtof_cli.capture.metadata import Optics


def require_sound_record(record: Mapping[str, Any], /) -> Mapping[str, Any]:
    """Return what a `run.json` holds, after making sure that it is what those expect who come after a run.

    Raises:
        ValueError, LookupError, TypeError, AttributeError: it is something else.
    """
    arguments = record["arguments"]
    if not arguments.keys() >= {"inputs", "overrides"}:
        raise ValueError("its arguments name no inputs or no overrides")
    roi = arguments.get("roi")
    if roi is not None:
        x0, y0, x1, y1 = map(operator.index, roi)
        if not (0 <= x0 < x1 and 0 <= y0 < y1):
            raise ValueError(f"found the roi {roi}")
    for capture in record.get("captures", []):
        known = capture["metadata"]["optics"]
        Path(capture["root"])
        Optics(
            focal_length_px=known["focal_length_px"],
            principal_point_px=known["principal_point_px"] and tuple(map(float, known["principal_point_px"])),
        )
    return record
