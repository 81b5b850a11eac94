"""The folder of a run, written and read here alone: a map file per frame, `run.json`, and `frames.jsonl`, a line per frame."""

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from io import FileIO
from pathlib import Path
from typing import Any, Literal

from cadtof_cli.capture.discovery import Capture, base_of, find_captures, placed_below
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import single_frames
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.capture.tree import WRITTEN_BY_US
from cadtof_cli.errors import CadtofError, CaptureError, OutputError, SettingsError
from cadtof_cli.files.atomic import make_folder, remove_partial_files, write_json
from cadtof_cli.files.formats import MAP_FORMATS, MAP_SUFFIXES

RUN_FILE = "run.json"
FRAMES_FILE = "frames.jsonl"

_PLACE_IN_STACK = re.compile(r"_\d{4,}$")

CHANGES_NO_MAP = frozenset(
    {"overwrite", "resume", "inputs", "absolute_inputs", "out", "overrides", "recursive", "settings", "frames"}
)
"""Arguments that may differ between a run and its resumption; what `overrides` decides is in the metadata."""

FrameStatus = Literal["ok", "failed", "skipped"]

RecordedFrames = Mapping[str, tuple[Capture, FrameSource]]
"""Recorded frames and their captures, by the name of the maps that were made from them."""


@dataclass(frozen=True)
class FrameReport:
    """A line of `frames.jsonl`; the fields are its keys, `more_paths` only where pixels may have more than two."""

    source: str
    output: str | None
    status: FrameStatus
    reason: str | None
    seconds: float
    one_path: int | None = None
    two_paths: int | None = None
    more_paths: int | None = None
    diffuse: int | None = None
    invalid: int | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        line = asdict(self)
        if self.more_paths is None:
            del line["more_paths"]
        return line


@dataclass(frozen=True)
class Run:
    """The maps of a run, all of them or one, as what comes after a run finds them.

    Attributes:
        maps: folder or file, as it was given.
        files: its map files, in the order of their names.
        folder: of the run.
        record: what `run.json` there holds; None where there is none, or it is not the record of a run.
    """

    maps: Path
    files: tuple[Path, ...]
    folder: Path
    record: Mapping[str, Any] | None

    def name(self, file: Path, /) -> str:
        """Return the name of a map: its path from the run's folder, without suffix."""
        return file.relative_to(self.folder).with_suffix("").as_posix()

    def require_maps(self) -> tuple[Path, ...]:
        """Return the map files; raises CaptureError where there are none."""
        if not self.files:
            raise CaptureError(f"{self.maps}: found no maps (.exr, .tif), expected those of `cadtof resolve`")
        return self.files

    def require_range_depth(self) -> None:
        """Make sure that the maps can be held against truth, which is radial range."""
        if self.record is not None and self.record["arguments"].get("depth") == "z":
            raise SettingsError(
                f"{self.maps}: holds z depth, and truth is radial range; resolve with --depth range to evaluate"
            )

    def recorded_frames(self, say: Callable[[str], None], /) -> RecordedFrames:
        """Return the frames that the maps were made from; nothing, and a note, where they are not known or gone."""
        if self.record is None:
            say(f"no {RUN_FILE} beside the maps, so the first phasor is not evaluated")
            return {}
        arguments = self.record["arguments"]
        try:
            inputs = [Path(path) for path in arguments.get("absolute_inputs", arguments["inputs"])]
            settings = arguments.get("settings")
            captures = find_captures(
                inputs,
                overrides=arguments["overrides"],
                settings_file=Path(settings) if settings else None,
                recursive=bool(arguments.get("recursive")),
            )
            captures = placed_below(captures, base_of(inputs, captures))
            return {source.name: (capture, source) for capture in captures for source in single_frames(capture)}
        except (CadtofError, KeyError) as error:
            say(f"the recorded frames are not where they were, so the first phasor is not evaluated: {error}")
            return {}


def read_run(maps: Path, /) -> Run:
    """Return the run that a folder of maps, or one map file, belongs to.

    Raises:
        CaptureError: there is no such folder or file.
    """
    if not maps.exists():
        raise CaptureError(f"{maps}: no such file or folder; expected maps that `cadtof resolve` wrote")
    files, folder = map_files(maps), maps if maps.is_dir() else maps.parent
    folder = next((above for above in (folder, *folder.parents) if (above / RUN_FILE).exists()), folder)
    try:
        record = read_record(folder)
        return Run(maps, files, folder, record if record["arguments"].keys() >= {"inputs", "overrides"} else None)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return Run(maps, files, folder, None)


def is_run_folder(path: Path, /) -> bool:
    """Return whether a folder is one that `cadtof resolve` wrote."""
    return path.is_dir() and (path / RUN_FILE).exists() and not (path / CAPTURE_FILE).exists()


def map_files(maps: Path, /) -> tuple[Path, ...]:
    """Return a run's map files in the order of their names, those in folders below it last; or the one file."""
    if maps.is_file():
        return (maps,)
    entries = sorted(path for path in maps.iterdir() if not path.name.startswith("."))
    files = [path for path in entries if path.suffix in MAP_SUFFIXES and not path.is_dir()]
    below = (path for path in entries if path.is_dir() and WRITTEN_BY_US.isdisjoint(one.name for one in path.iterdir()))
    return (*files, *(file for folder in below for file in map_files(folder)))


def read_record(folder: Path, /) -> dict[str, Any]:
    """Return what the `run.json` of a folder holds.

    Raises:
        OSError, ValueError, TypeError: there is none, or it is no JSON object.
    """
    return dict(json.loads((folder / RUN_FILE).read_text(encoding="utf-8")))


def prepare_output(captures: Sequence[Capture], out: Path, /, *, overwrite: bool, resume: bool) -> None:
    """Make the output folder, and make sure that a run loses nothing in it.

    Raises:
        OutputError: it cannot be written into; it is a capture's own folder; two frames would be written to one file; or
            it holds files of a run, and neither `overwrite` nor `resume` is set.
    """
    if (out / CAPTURE_FILE).exists() or out.resolve() in {capture.root.resolve() for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    named: dict[str, Path] = {}
    for frame in (frame for capture in captures for frame in capture.frames):
        path = frame.paths[0]
        other = named.setdefault(frame.name, path)
        if other == path and other is not path:
            raise OutputError(f"{path} is among the inputs twice; give each frame once")
        if other != path:
            raise OutputError(
                f"{other} and {path} would both be written as {out}/{frame.name}; "
                "resolve them into folders of their own, one command each"
            )
    make_folder(out)
    if overwrite or resume:
        remove_partial_files(out, token="*")
    else:
        _require_nothing_replaced(out, named)


def _require_nothing_replaced(out: Path, named: Mapping[str, Path]) -> None:
    def would_be(path: str) -> bool:
        stem, _, suffix = path.rpartition(".")
        return suffix in MAP_FORMATS and (stem in named or _PLACE_IN_STACK.sub("", stem) in named)

    folders = {(out / name).parent for name in named} | {out}
    present = (path for folder in folders if folder.is_dir() for path in folder.iterdir())
    names = (path.relative_to(out).as_posix() for path in present)
    there = sorted(name for name in names if name in {RUN_FILE, FRAMES_FILE} or would_be(name))
    if there:
        more = f" and {len(there) - 3} more" if len(there) > 3 else ""
        raise OutputError(
            f"{out}: {', '.join(there[:3])}{more} would be replaced; add --overwrite to replace, --resume to go on where a run "
            "stopped, or choose another folder with -o"
        )


@dataclass(frozen=True)
class RunRecorder:
    """Keeps the record of a run while it goes on: whatever ends it, what was finished is on disk.

    Attributes:
        out: folder of the run.
        document: what `run.json` says.
        lines: `frames.jsonl`, open.
        resolved_before: sources of frames that `frames.jsonl` of an earlier run calls resolved.
    """

    out: Path
    document: Mapping[str, Any]
    lines: FileIO
    resolved_before: frozenset[str]

    def add(self, report: FrameReport) -> None:
        """Append a frame's line, and hand it to the system at once; a frame that an earlier run resolved has its line."""
        if report.status == "skipped" and report.source in self.resolved_before:
            return
        with _reported(self.out / FRAMES_FILE):
            line = json.dumps(report.as_json()).encode() + b"\n"
            while line:
                line = line[self.lines.write(line) :]

    def finish(self, totals: Mapping[str, Any]) -> None:
        """Complete `run.json`."""
        write_json(self.out / RUN_FILE, {**self.document, "finished": True, "totals": dict(totals)})


@contextmanager
def recorded_run(out: Path, document: Mapping[str, Any], /, *, resume: bool) -> Iterator[RunRecorder]:
    """Write a run's `run.json`, and hold its `frames.jsonl` open for the reports on its frames.

    Raises:
        OutputError: one of them cannot be written; or the run to be resumed is none.
    """
    write_json(out / RUN_FILE, document)
    path = out / FRAMES_FILE
    with _reported(path):
        resolved_before = _whole_lines(path) if resume else frozenset()
        # without a buffer, so that nothing is left to be written, and to fail, on closing
        lines = path.open("ab" if resume else "wb", buffering=0)
    with lines:
        try:
            yield RunRecorder(out, document, lines, resolved_before)
        except BaseException:
            # what arrived while the run went on is recorded too
            write_json(out / RUN_FILE, document)
            raise


def require_same_maps(out: Path, document: Mapping[str, Any], /) -> None:
    """Make sure that the run whose record lies in the folder, if there is one, would make the same maps.

    Raises:
        OutputError: its options, metadata or calibration were others, or what lies there is no record of a run.
    """
    path = out / RUN_FILE
    if not path.exists():
        return
    try:
        before = _what_decides_maps(read_record(out))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(f"{path}: not the record of a run, so it cannot be resumed ({error})") from error
    now = _what_decides_maps(json.loads(json.dumps(document, default=str)))
    for name, value in now.items():
        if name in before and before[name] != value:
            raise OutputError(
                f"{path}: cannot resume: {name} was {before[name]!r} and is {value!r} now; "
                "give the same options, or --overwrite"
            )


def _what_decides_maps(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments and the metadata that decide what the maps of a run are, by the names they have for a user."""
    deciding = {name: value for name, value in document["arguments"].items() if name not in CHANGES_NO_MAP}
    deciding["digest of the calibration"] = (document["calibration"] or {}).get("digest")
    for capture in document["captures"]:
        for table, keys in capture["metadata"].items():
            deciding |= {f"{capture['root']}: {table}.{key}": value for key, value in keys.items()}
    return deciding


def _whole_lines(path: Path) -> frozenset[str]:
    """Return the sources that `frames.jsonl` calls resolved; what a full disk or a kill left of a last line is cut off."""
    if not path.exists():
        return frozenset()
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if len(whole) < len(content):
        os.truncate(path, len(whole))
    try:
        reports = [json.loads(line) for line in whole.splitlines()]
        return frozenset(report["source"] for report in reports if report["status"] == "ok")
    except (ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{path}: not the record of a run, so it cannot be resumed ({error})") from error


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
