"""What is written beside the maps of a run: `run.json`, and `frames.jsonl`, a line a frame."""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path
from typing import Any

from cadtof_cli import __version__
from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import make_folder, remove_partial_files, write_json
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.workflows.resolve.frame_task import FrameReport
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration

RUN_FILE = "run.json"
FRAMES_FILE = "frames.jsonl"

_PLACE_IN_STACK = re.compile(r"_\d{4,}$")

CHANGES_NO_MAP = frozenset(
    {"jobs", "start_method", "overwrite", "resume", "json", "quiet", "inputs", "out", "overrides"}
)
"""Arguments that may differ between a run and its resumption; what `overrides` decides is in the metadata."""


def prepare_output(captures: Sequence[Capture], out: Path, /, *, overwrite: bool, resume: bool) -> None:
    """Make the output folder, and make sure that a run loses nothing in it.

    Raises:
        OutputError: it cannot be written into; it is a capture's own folder; two frames would be written to one file; or
            it holds files of a run, and neither `overwrite` nor `resume` is set.
    """
    if (out / CAPTURE_FILE).exists() or out.resolve() in {capture.root.resolve() for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    named = _named(captures, out)
    make_folder(out)
    if overwrite or resume:
        remove_partial_files(out, token="*")
    else:
        _check_nothing_replaced(out, named)


def _named(captures: Sequence[Capture], out: Path) -> dict[str, Path]:
    """Return the file of every frame by the name that its maps get."""
    named: dict[str, Path] = {}
    for frame in (frame for capture in captures for frame in capture.frames):
        path = frame.paths[0]
        other = named.setdefault(frame.name, path)
        if other is path:
            continue
        if other == path:
            raise OutputError(f"{path} is among the inputs twice; give each frame once")
        raise OutputError(
            f"{other} and {path} would both be written as {out}/{frame.name}; "
            "resolve them into folders of their own, one command each"
        )
    return named


def _check_nothing_replaced(out: Path, named: Mapping[str, Path]) -> None:
    def would_be(path: Path) -> bool:
        in_stack = _PLACE_IN_STACK.sub("", path.stem)
        return path.suffix in {".exr", ".tif"} and (path.stem in named or in_stack in named)

    there = sorted(path.name for path in out.iterdir() if path.name in {RUN_FILE, FRAMES_FILE} or would_be(path))
    if there:
        more = f" and {len(there) - 3} more" if len(there) > 3 else ""
        raise OutputError(
            f"{out}: {', '.join(there[:3])}{more} would be replaced; add --overwrite to replace, --resume to go on where a run "
            "stopped, or choose another folder with -o"
        )


def _check_same_settings(path: Path, document: Mapping[str, Any]) -> None:
    if not path.exists():
        return
    try:
        before = _what_decides_maps(json.loads(path.read_text(encoding="utf-8")))
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


class RunRecord:
    """The record of one run, kept while it goes on: whatever ends it, what was finished is on disk."""

    def __init__(
        self,
        out: Path,
        /,
        *,
        arguments: Mapping[str, Any],
        captures: Sequence[Capture],
        layers: Mapping[str, str],
        calibration: AppliedCalibration | None = None,
    ) -> None:
        self._out = out
        self._lines: FileIO | None = None
        self._resolved_before: frozenset[str] = frozenset()
        self._document: dict[str, Any] = {
            "cadtof": __version__,
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "finished": False,
            "arguments": dict(arguments),
            "captures": [_capture_record(capture) for capture in captures],
            "calibration": calibration and calibration.as_json(),
            "layers": dict(layers),
            "status_bits": {bit.name: int(bit) for bit in MEANING},
        }

    def require_same_settings(self) -> None:
        """Make sure that the run whose record lies in the folder, if there is one, would make the same maps.

        Raises:
            OutputError: its options, metadata or calibration were others, or what lies there is no record of a run.
        """
        _check_same_settings(self._out / RUN_FILE, self._document)

    @contextmanager
    def opened(self, *, append: bool) -> Iterator["RunRecord"]:
        """Write `run.json`, and hold `frames.jsonl` open for `add`."""
        write_json(self._out / RUN_FILE, self._document)
        path = self._out / FRAMES_FILE
        with _reported(path):
            self._resolved_before = _whole_lines(path) if append else frozenset()
            # without a buffer, so that nothing is left to be written, and to fail, on closing
            lines = path.open("ab" if append else "wb", buffering=0)
        with lines:
            self._lines = lines
            yield self

    def add(self, report: FrameReport) -> None:
        """Append a frame's line, and hand it to the system at once; a frame that an earlier run resolved has its line."""
        if self._lines is None or (report.status == "skipped" and report.source in self._resolved_before):
            return
        with _reported(self._out / FRAMES_FILE):
            line = json.dumps(report.as_json()).encode() + b"\n"
            while line:
                line = line[self._lines.write(line) :]

    def finish(self, totals: Mapping[str, Any]) -> None:
        """Complete `run.json`."""
        self._document |= {"finished": True, "totals": dict(totals)}
        write_json(self._out / RUN_FILE, self._document)


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


def _capture_record(capture: Capture) -> dict[str, Any]:
    return {
        "root": str(capture.root),
        "files": len(capture.frames),
        "metadata": asdict(capture.source.metadata),
        "origins": dict(capture.source.origins),
    }
