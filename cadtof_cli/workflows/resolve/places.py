"""Where the captures of a run lie, and in which folders their maps are: found out from the record of the run."""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import absolute
from cadtof_cli.workflows.resolve.record import FRAMES_FILE, FrameReport, place_in, report_of


def capture_folders(record: Mapping[str, Any], /) -> list[Path]:
    """Return the absolute folder of each capture in a `run.json`.

    Raises:
        LookupError, TypeError: it is not the record of a run.
    """
    start = _start_folder(record["arguments"])
    return [absolute(start / capture["root"]) for capture in record["captures"]]


def shared_folder(out: Path, record: Mapping[str, Any], /) -> Path:
    """Return the folder whose tree a run's folder mirrors, as `find_placed_captures` chose it.

    Inputs that arrived later did not change this folder. So it follows from the first frame that has maps, if its line is there.

    Args:
        out: folder of the run.
        record: content of its `run.json`; it names at least one capture.

    Raises:
        LookupError, TypeError: it is not the record of a run.
    """
    arguments, roots = record["arguments"], capture_folders(record)
    if first := _first_with_maps(out):
        place = Path(place_in(Path(arguments.get("out", "")), Path(str(first.output)))).parent.parts
        source = absolute(_start_folder(arguments) / first.source)
        # a frame belongs to the deepest capture above it
        for root in sorted(roots, key=lambda one: len(one.parts), reverse=True):
            if source.is_relative_to(root) and root.parts[len(root.parts) - len(place) :] == place:
                return Path(*root.parts[: len(root.parts) - len(place)])
    inputs = [absolute(Path(path)) for path in arguments.get("absolute_inputs", arguments["inputs"])]
    folders = [path if any(root.is_relative_to(path) for root in roots) else path.parent for path in inputs]
    return Path(os.path.commonpath([*folders, *roots]))


def _start_folder(arguments: Mapping[str, Any]) -> Path:
    """Return the folder in which a run was started. If all inputs were typed as absolute paths, this does not matter."""
    for typed, whole in zip(arguments["inputs"], arguments.get("absolute_inputs", ()), strict=False):
        # an absolute path is the folder in which the run was started, and then the path as it was typed
        if typed != whole:
            return Path(*Path(whole).parts[: -len(Path(typed).parts) or None])
    return Path()


def _first_with_maps(out: Path) -> FrameReport | None:
    """Return the first line of `frames.jsonl` whose frame has maps; None: there is no such line."""
    with suppress(OSError), (out / FRAMES_FILE).open("rb") as lines:
        return next((one for one in map(report_of, lines) if one and one.output), None)
    return None
