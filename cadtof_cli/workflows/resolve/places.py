"""Where the captures of a run lie, and in which folders their maps are: found out from the record of the run."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cadtof_cli.capture.discovery import absolute
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import atomic_write, writing
from cadtof_cli.workflows.resolve.record import FRAMES_FILE, RUN_FILE, read_record, required_report


def capture_folders(record: Mapping[str, Any], /) -> list[Path]:
    """Return the absolute folder of each capture in a `run.json`.

    Raises:
        LookupError, TypeError: it is not the record of a run.
    """
    start = _start_folder(record["arguments"])
    return [absolute(start / capture["root"]) for capture in record["captures"]]


def _start_folder(arguments: Mapping[str, Any]) -> Path:
    """Return the folder in which a run was started. If all inputs were typed as absolute paths, this does not matter."""
    for typed, whole in zip(arguments["inputs"], arguments.get("absolute_inputs", ()), strict=False):
        # an absolute path is the folder in which the run was started, and then the path as it was typed
        if typed != whole:
            return Path(*Path(whole).parts[: -len(Path(typed).parts) or None])
    return Path()


def rename_lines(out: Path, /) -> None:
    """Name frames and maps in `frames.jsonl` as a run does that is started here and calls its folder `out`.

    The lines of frames that a continued run does not name again are kept. Their paths are relative to the folder in which the
    earlier run was started.

    Raises:
        OutputError: the record of the earlier run cannot be read, a line is not a report, or the file cannot be written.
    """
    path = out / FRAMES_FILE
    try:
        arguments = read_record(out)["arguments"]
        called, start = Path(arguments["out"]), _start_folder(arguments)
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise OutputError(f"{out / RUN_FILE}: not the record of a run, so it cannot be resumed ({error})") from error
    is_here = start in (Path(), Path.cwd())
    if (called == out and is_here) or not path.is_file() or not path.stat().st_size:
        return
    with writing(path), atomic_write(path) as temporary, path.open("rb") as lines, temporary.open("wb") as renamed:
        for line in lines:
            # a last line without an end is incomplete, because the run was killed
            if line.endswith(b"\n"):
                report = required_report(line, path)
                output = report.output and Path(report.output)
                if output and output.is_relative_to(called):
                    report = replace(report, output=(out / output.relative_to(called)).as_posix())
                if not is_here:
                    report = replace(report, source=str(start / report.source))
                line = json.dumps(report.as_json()).encode() + b"\n"
            renamed.write(line)
