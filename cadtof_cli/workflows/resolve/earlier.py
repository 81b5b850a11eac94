"""The run that was in the folder of a run before: it is continued with the same inputs and settings, or replaced."""

import contextlib
import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from cadtof_cli.errors import FrameError, OutputError
from cadtof_cli.files.atomic import atomic_write, writing
from cadtof_cli.files.formats import MAP_FORMATS
from cadtof_cli.files.system import sync_folder
from cadtof_cli.units import first_of
from cadtof_cli.workflows.resolve.lines import FRAMES_FILE, has_gap, place_in, remove_map, required_report
from cadtof_cli.workflows.resolve.output import MapNames
from cadtof_cli.workflows.resolve.reports import report_of
from cadtof_cli.workflows.resolve.run_document import RunDocument
from cadtof_cli.workflows.resolve.run_json import NOT_OF_A_RUN, RUN_FILE, RunRecord, read_record, resumable
from cadtof_cli.workflows.resolve.settings import ResolveSettings

_PLACE_IN_STACK = r"_\d{4,}$"

_CHANGES_NO_MAP = frozenset(
    (
        "inputs",
        "absolute_inputs",
        "inputs_from_out",
        "out",
        "overrides",
        "calibration",
        "recursive",
        "settings",
        "frames",
    )
)
"""Arguments that may differ when a run is resumed. What they lead to is compared instead, such as the metadata of captures."""

_INPUTS, _FOLDERS, _VERSION = "resolved_inputs", "list of captures", "version of cadtof"
_CALIBRATION = "digest of the calibration"

_AS_BEFORE = {
    _INPUTS: "give the same inputs",
    _FOLDERS: "give the same inputs",
    _VERSION: "use that version",
    _CALIBRATION: "give the same calibration",
}
"""What to do if one of these differs from that of the earlier run."""


def earlier_run(
    names: MapNames, document: RunDocument, /, *, settings: ResolveSettings, arriving: bool
) -> RunRecord | None:
    """Return the record of the earlier run that a run continues, after checking that no files get lost. Nothing is changed.

    None: there is no earlier run. If inputs are still `arriving`, the inputs are not compared, and metadata only
    of the captures that both runs know.

    Raises:
        OutputError: the folder holds files of a run, and neither `overwrite` nor `resume` is set; or the run to be resumed had
            other inputs or settings; or files that are no maps would be replaced.
    """
    out = names.out
    ours = os.path.lexists(out / RUN_FILE)
    there = [] if settings.overwrite and ours else _existing_outputs(names)
    if not ours and (others := [file for file in there if _holds_no_maps(out / file)]):
        raise OutputError(
            f"{out}: would replace {first_of(others, 3)}, which no run made; choose another folder with -o"
        )
    if settings.overwrite:
        return None
    if there and not settings.resume:
        raise OutputError(
            f"{out}: {first_of(there, 3)} would be replaced; add --overwrite to replace, --resume to go on where a run "
            "stopped, or choose another folder with -o"
        )
    if not there:
        return None
    if not ours:
        raise OutputError(
            f"{out}: cannot resume: found {first_of(there, 3)} and no {RUN_FILE}, so nothing tells what was resolved and how; "
            "add --overwrite, or choose another folder with -o"
        )
    return _continued_record(out, document, arriving=arriving)


def _existing_outputs(names: MapNames) -> list[str]:
    """Return the files in a run's folder that the run would replace."""
    out, maps = names.out, names.files.keys()
    folders = {out / folder for folder in names.folders()} | {out}
    paths = (path for folder in folders if folder.is_dir() for path in folder.iterdir())
    replaced: list[str] = []
    for file in sorted(path.relative_to(out).as_posix() for path in paths):
        stem, _, suffix = file.rpartition(".")
        is_map = suffix in MAP_FORMATS and not maps.isdisjoint({stem, re.sub(_PLACE_IN_STACK, "", stem)})
        if is_map or file in {RUN_FILE, FRAMES_FILE}:
            replaced.append(file)
    return replaced


def _holds_no_maps(file: Path, /) -> bool:
    """Return whether a file holds something else than maps, such as a recorded frame."""
    # imported here because nearly every run is in a new folder or has its run.json
    from cadtof_cli.files.layers import read_layers
    from cadtof_cli.files.maps import NotMapsError, is_map_layer

    try:
        return not any(map(is_map_layer, read_layers(file)))
    except NotMapsError:
        return True
    except FrameError:
        # it cannot be read, or has no layers at all, such as `frames.jsonl`
        return False


def _continued_record(out: Path, document: RunDocument, /, *, arriving: bool) -> RunRecord:
    """Return the content of the `run.json` of the run in a folder, after checking that the run of `document` can continue it.

    `arriving`: see `earlier_run`.

    Raises:
        OutputError: it cannot be read, or is not the record of a run; or that run had other inputs or settings.
    """
    path = out / RUN_FILE
    with resumable(path):
        try:
            earlier = read_record(out)
        except OSError as error:
            raise OutputError(f"{path}: cannot be read: {error.strerror or error}") from error
        before = _what_decides_maps(earlier)
        # needed to find the lines of frames
        _ = earlier.out
        frames, frames_now = map(_range_of_frames, (earlier, document))
    # the lines of frames that are left out would be lost, while their maps would stay
    if frames_now[0] > frames[0] or frames_now[1] < frames[1]:
        raise OutputError(
            f"{path}: cannot resume: --frames may leave out frames of the earlier run; give the same --frames or more, or "
            "--overwrite"
        )
    now = _what_decides_maps(RunRecord(json.loads(json.dumps(document, default=str))))
    if arriving:
        del now[_INPUTS]
    if arriving or set(before[_FOLDERS]).issubset(now[_FOLDERS]):
        # a tree of captures may have grown; nothing is recorded of the new ones
        del now[_FOLDERS]
        now = {name: value for name, value in now.items() if name in before}
    for name, value in now.items():
        if before.get(name) != value:
            raise OutputError(
                f"{path}: cannot resume: {name} was {before.get(name)!r} and is {value!r} now; "
                f"{_AS_BEFORE.get(name, 'give the same options and settings')}, or --overwrite"
            )
    return earlier


def _what_decides_maps(record: RunRecord) -> dict[str, Any]:
    """Return all that decides the maps of a run (inputs, options, metadata, calibration), by names that a user knows."""
    captures = record["captures"]
    deciding: dict[str, Any] = {_VERSION: record["cadtof"]}
    deciding[_FOLDERS] = [str(capture.get("resolved_root")) for capture in captures]
    arguments = record["arguments"]
    deciding |= {name: value for name, value in arguments.items() if name not in _CHANGES_NO_MAP}
    deciding[_CALIBRATION] = (record["calibration"] or {}).get("digest")
    for capture in captures:
        for table, keys in capture["metadata"].items():
            deciding |= {f"{capture.get('resolved_root')}: {table}.{key}": value for key, value in keys.items()}
    return deciding


def _range_of_frames(record: RunRecord) -> tuple[float, float]:
    """Return where a range of `--frames` begins and ends."""
    chosen = record.frames
    return float(chosen.start or 0), math.inf if chosen.stop is None else float(chosen.stop)


def earlier_shared_folder(out: Path, /) -> Path | None:
    """Return the folder whose tree the run in `out` mirrors; None: there is no run in it whose record says so.

    A run that continues it may begin with other frames, whose own shared folder would put maps into other places.
    """
    try:
        return read_record(out).shared_folder
    except (OSError, *NOT_OF_A_RUN):
        return None


def rename_lines(out: Path, earlier: RunRecord, /) -> None:
    """Name frames and maps in `frames.jsonl` as a run does that is started here and calls its folder `out`.

    The lines of frames that a continued run does not name again are kept. Their paths are relative to the folder in which the
    earlier run was started; `earlier` is the content of its `run.json`.

    Raises:
        OutputError: `earlier` is not the record of a run, a line is not a report, or the file cannot be written.
    """
    with resumable(out / RUN_FILE):
        called, start = earlier.out, earlier.start_folder()
    is_here = start in (Path(), Path.cwd())
    path = out / FRAMES_FILE
    if (called == out and is_here) or not path.is_file() or not path.stat().st_size:
        return
    with writing(path), atomic_write(path) as temporary, path.open("rb") as lines, temporary.open("wb") as renamed:
        for line in lines:
            # a last line without an end is incomplete, because the run was killed
            if line.endswith(b"\n") and not has_gap(line):
                report = required_report(line, path)
                output = report.output and Path(report.output)
                if output and output.is_relative_to(called):
                    report = replace(report, output=(out / output.relative_to(called)).as_posix())
                if not is_here:
                    report = replace(report, source=str(start / report.source))
                line = json.dumps(report.as_json()).encode() + b"\n"
            renamed.write(line)


def remove_run(out: Path, /) -> None:
    """Remove the maps of an earlier run and its `frames.jsonl`. Maps that stayed would be taken for maps of the next run.

    A map is removed only if it lies in the folder and has the size that its line records. Files without a line stay.

    Raises:
        OutputError: a file cannot be removed.
    """
    path, called = out / FRAMES_FILE, out
    with contextlib.suppress(OSError, *NOT_OF_A_RUN):
        called = read_record(out).out
    with writing(path):
        if path.is_file() and not path.is_symlink():
            with path.open("rb") as lines:
                for report in map(report_of, lines):
                    if report and report.output:
                        remove_map(out, out / place_in(called, Path(report.output)), report)
        path.unlink(missing_ok=True)
        sync_folder(out)
