"""Where the captures of a run lie, and in which folders their maps are: found out from the record of the run."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import absolute
from cadtof_cli.files.atomic import atomic_write, writing
from cadtof_cli.files.system import common_folder
from cadtof_cli.workflows.resolve.record import FRAMES_FILE
from cadtof_cli.workflows.resolve.reports import FrameReport, report_of


def capture_folders(record: Mapping[str, Any], /) -> list[Path]:
    """Return the absolute folder of each capture in a `run.json`.

    Raises:
        LookupError, TypeError: it is not the record of a run.
    """
    start = _start_folder(record["arguments"])
    return [absolute(start / capture["root"]) for capture in record["captures"]]


def shared_folder(out: Path, record: Mapping[str, Any], /) -> Path:
    """Return the folder whose tree a run's folder mirrors, as `placed_captures` chose it.

    Inputs that arrived later did not change this folder. So it follows from the first frame that has maps, if its line is there.

    Args:
        out: folder of the run.
        record: content of its `run.json`; it names at least one capture.

    Raises:
        LookupError, TypeError: it is not the record of a run.
    """
    arguments, roots = record["arguments"], capture_folders(record)
    called = Path(arguments.get("out", ""))
    if first := _first_with_maps(out, called):
        place = Path(str(first.output)).relative_to(called).parent.parts
        source = absolute(_start_folder(arguments) / first.source)
        # a frame belongs to the deepest capture above it
        for root in sorted(roots, key=lambda one: len(one.parts), reverse=True):
            if source.is_relative_to(root) and root.parts[len(root.parts) - len(place) :] == place:
                return Path(*root.parts[: len(root.parts) - len(place)])
    inputs = [absolute(Path(path)) for path in arguments.get("absolute_inputs", arguments["inputs"])]
    folders = [path if any(root.is_relative_to(path) for root in roots) else path.parent for path in inputs]
    return common_folder([*folders, *roots])


def _start_folder(arguments: Mapping[str, Any]) -> Path:
    """Return the folder in which a run was started. If all inputs were typed as absolute paths, this does not matter."""
    for typed, whole in zip(arguments["inputs"], arguments.get("absolute_inputs", ()), strict=False):
        # an absolute path is the folder in which the run was started, and then the path as it was typed
        if typed != whole:
            return Path(*Path(whole).parts[: -len(Path(typed).parts) or None])
    return Path()


def _first_with_maps(out: Path, called: Path) -> FrameReport | None:
    """Return the first line of `frames.jsonl` with maps in the folder that its run `called` so; None: there is no such line."""
    path = out / FRAMES_FILE
    if not path.is_file():
        # opening a FIFO would wait for ever
        return None
    with suppress(OSError), path.open("rb") as lines:
        reports = (one for one in map(report_of, lines) if one and one.output)
        return next((one for one in reports if Path(str(one.output)).is_relative_to(called)), None)
    return None


def rename_lines(out: Path, earlier: Mapping[str, Any], /) -> None:
    """Name frames and maps in `frames.jsonl` as a run does that is started here and calls its folder `out`.

    The lines of frames that a continued run does not name again are kept. Their paths are relative to the folder in which the
    earlier run was started.

    Args:
        out: folder of both runs.
        earlier: content of the earlier run's `run.json`.

    Raises:
        LookupError, TypeError: it is not the record of a run.
        OutputError: the file cannot be written.
    """
    called, start = Path(earlier["arguments"]["out"]), _start_folder(earlier["arguments"])
    is_here = start in (Path(), Path.cwd())
    path = out / FRAMES_FILE
    if (called == out and is_here) or not path.is_file():
        return
    with writing(path), path.open("rb") as lines, atomic_write(path) as temporary, temporary.open("wb") as renamed:
        for line in lines:
            if report := report_of(line):
                output = report.output and Path(report.output)
                if output and output.is_relative_to(called):
                    report = replace(report, output=(out / output.relative_to(called)).as_posix())
                if not is_here:
                    report = replace(report, source=str(start / report.source))
                line = json.dumps(report.as_json()).encode() + b"\n"
            renamed.write(line)
