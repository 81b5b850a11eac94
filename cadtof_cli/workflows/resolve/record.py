"""The record of a run: what `run.json` says of it, and `frames.jsonl` while it goes on.

Whatever ends a run, what was finished is on disk, and another run can go on from there.
"""

import json
import os
import stat
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from cadtof_cli import __version__
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import atomic_write, not_written, write_json, writing
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.resolver.two_path.kernel import chosen_kernel
from cadtof_cli.workflows.frame_report import FrameReport, RunTotals, report_of
from cadtof_cli.workflows.resolve.plans import AppliedCalibration, CapturePlan
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.run_folder import FRAMES_FILE, RUN_FILE, read_record


def run_document(
    inputs: Sequence[Path],
    overrides: Mapping[str, Any],
    settings: ResolveSettings,
    plans: Sequence[CapturePlan],
    calibration: AppliedCalibration | None,
) -> dict[str, Any]:
    """Return what `run.json` says of a run that begins; its arguments have the names of the options."""
    maps, applied = settings.maps, None
    if calibration is not None:
        folder = calibration.use.folder
        applied = {
            "folder": str(folder),
            "digest": calibration.use.digest,
            "applied": dict(calibration.parts),
            "absolute_folder": str(folder.absolute()),
            "folder_from_out": os.path.relpath(folder, settings.out),
        }
    document = {
        "cadtof": __version__,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "finished": False,
        "kernel": chosen_kernel(),
        "arguments": {
            "inputs": [str(path) for path in inputs],
            "absolute_inputs": [str(path.absolute()) for path in inputs],
            "inputs_from_out": [os.path.relpath(path, settings.out) for path in inputs],
            "resolved_inputs": [real_path(path) for path in inputs],
            "out": str(settings.out),
            **asdict(maps.resolver),
            "min_confidence": maps.min_confidence_v,
            "depth": maps.depth,
            "pool": maps.pool,
            "average": maps.average,
            "calibration": settings.calibration and str(settings.calibration),
            "map_format": settings.map_format,
            "roi": maps.roi,
            "recursive": settings.recursive,
            "settings": settings.settings_file and str(settings.settings_file.absolute()),
            "frames": settings.frames and [settings.frames.start, settings.frames.stop],
            "overrides": dict(overrides),
        },
        "captures": list[dict[str, Any]](),
        "calibration": applied,
        "layers": {name: unit for one in plans for name, unit in one.plan.header.units.items()},
        "status_bits": {bit.name: int(bit) for bit in MEANING},
    }
    record_captures(document, plans)
    return document


def recorded_arrivals(
    batches: Iterable[tuple[Path, ...]], document: Mapping[str, Any], out: Path
) -> Iterator[tuple[Path, ...]]:
    """Yield the batches of paths, each added to the inputs that `run.json` will name."""
    for paths in batches:
        document["arguments"]["inputs"] += map(str, paths)
        document["arguments"]["absolute_inputs"] += (str(path.absolute()) for path in paths)
        document["arguments"]["inputs_from_out"] += (os.path.relpath(path, out) for path in paths)
        document["arguments"]["resolved_inputs"] += map(real_path, paths)
        yield paths


def record_captures(document: Mapping[str, Any], plans: Iterable[CapturePlan]) -> None:
    """Add captures, or their further files, to those that `run.json` names."""
    for one in plans:
        capture = one.capture
        known = next((entry for entry in document["captures"] if entry["root"] == str(capture.root)), None)
        if known is None:
            known = {
                "root": str(capture.root),
                "resolved_root": real_path(capture.root),
                "files": 0,
                "metadata": asdict(capture.source.metadata),
                "origins": dict(capture.source.origins),
                "lossy_compression": one.lossy_compression,
            }
            document["captures"].append(known)
        known["files"] += len(capture.frames)


class RunRecorder:
    """Writes `run.json` and `frames.jsonl`.

    A line is appended as soon as its frame is finished. A run that continues an earlier one appends too; at its end the lines are
    sorted into the order of the frames, one for each, as if nothing had been interrupted.
    """

    def __init__(self, out: Path, document: Mapping[str, Any], *, resume: bool, say: Callable[[str], None]) -> None:
        self._document, self._say, self._resumed = document, say, resume
        self._out, self._run, self._path = out, out / RUN_FILE, out / FRAMES_FILE
        self._totals, self._before, self._places = RunTotals(), dict[str, int](), array("q")
        with writing(self._path):
            if not resume:
                self._path.unlink(missing_ok=True)
            # not buffered, so that nothing is left to be written, and to fail, on closing
            self._lines: BinaryIO = os.fdopen(os.open(self._path, OPEN_OR_CREATE_FLAGS, 0o666), "r+b", buffering=0)
            if not stat.S_ISREG(os.fstat(self._lines.fileno()).st_mode):
                self._lines.close()
                raise OSError("found no regular file there")
        if resume:
            try:
                self._find_lines(Path(read_record(out)["arguments"]["out"]))
            except BaseException:
                self.close()
                raise

    def before(self, output: Path, /) -> FrameReport | None:
        """Return what an earlier run recorded of a frame whose maps it wrote; None where it did not."""
        place = self._known_place(str(output))
        return None if place is None else report_of(self._line_at(place))

    def add(self, report: FrameReport, /) -> None:
        """Append a frame's line; a frame whose maps were kept has it already, if nothing in it has changed."""
        line = report.line or report
        self._totals.add(line)
        text = json.dumps(line.as_json()).encode() + b"\n"
        try:
            place = self._known_place(line.output) if report.line else None
            if place is None or self._line_at(place) != text:
                self._require_there()
                place = self._append(text)
        except OSError as error:
            raise not_written(self._path, error) from error
        if self._resumed:
            self._places.append(place)

    def _known_place(self, output: str | None) -> int | None:
        """Return where the earlier run's line about a frame begins, by the place of its maps; None where there is none."""
        return self._before.get(_place_in(self._out, Path(output or "")))

    def _append(self, text: bytes) -> int:
        """Write a line behind the others, whole or not at all, and return its place."""
        place = self._lines.seek(0, os.SEEK_END)
        written = 0
        try:
            while written < len(text):
                written += self._lines.write(text[written:])
        except OSError:
            # a full disk may have taken a part of it
            self._lines.truncate(place)
            raise
        return place

    def finish(self, seconds: float, /) -> None:
        """Complete both files; the totals are those of all frames, whichever run resolved them."""
        with writing(self._path):
            self._require_there()
            os.fsync(self._lines.fileno())
        if self._resumed:
            with atomic_write(self._path) as temporary, temporary.open("wb") as ordered:
                ordered.writelines(map(self._line_at, self._places))
        totals = asdict(replace(self._totals, seconds=round(seconds, 3)))
        del totals["already_there"]  # a line of frames.jsonl is that of a frame that was resolved, whichever run did it
        write_json(self._run, {**self._document, "finished": True, "totals": totals})

    def close(self) -> None:
        """Close `frames.jsonl`."""
        self._lines.close()

    def _find_lines(self, out: Path) -> None:
        """Find the lines of frames that have maps; cut off a last line that a killed run did not complete.

        `out` is what the earlier run called its folder.
        """
        end = 0
        with writing(self._path), self._path.open("rb") as lines:
            for line in lines:
                if not line.endswith(b"\n"):
                    break
                report = report_of(line)
                if report is None:
                    raise OutputError(f"{self._path}: not the record of a run, so it cannot be resumed ({line[:40]!r})")
                if report.output is not None:
                    self._before[_place_in(out, Path(report.output))] = end
                end += len(line)
            self._lines.truncate(end)

    def _line_at(self, place: int) -> bytes:
        """Return the line that begins at a place of the file."""
        line, size = b"", 1024
        while not line.endswith(b"\n"):
            piece = read_at(self._lines.fileno(), size, place + len(line))
            if not piece:
                return line
            line += piece[: piece.find(b"\n") + 1 or None]
        return line

    def _require_there(self) -> None:
        """Write `frames.jsonl` anew from the open file, where somebody has removed or replaced it meanwhile."""
        try:
            if os.path.samestat(os.lstat(self._path), os.fstat(self._lines.fileno())):
                return
        except FileNotFoundError:
            pass
        with atomic_write(self._path) as temporary:
            copy = temporary.open("r+b", buffering=0)
            size, place = os.fstat(self._lines.fileno()).st_size, 0
            while place < size:
                place += copy.write(read_at(self._lines.fileno(), 2**20, place))
        self._lines.close()
        self._lines = copy
        self._say(f"{self._path}: was removed or replaced while frames were resolved; written anew")


def _place_in(out: Path, output: Path) -> str:
    """Return where maps lie in a run's folder, whatever that was called."""
    return str(output.relative_to(out)) if output.is_relative_to(out) else output.name


@contextmanager
def recorded_run(
    out: Path, document: Mapping[str, Any], /, *, resume: bool, say: Callable[[str], None]
) -> Iterator[RunRecorder]:
    """Write a run's `run.json`, and hold its `frames.jsonl` open for the reports on its frames.

    Raises:
        OutputError: one of them cannot be written; or the run to be resumed is none.
    """
    if not resume:
        # the settings first: without them, the lines would be taken for the next run's
        write_json(out / RUN_FILE, document)
    recorder = RunRecorder(out, document, resume=resume, say=say)
    try:
        if resume:
            write_json(out / RUN_FILE, document)
        yield recorder
    except BaseException:
        with suppress(OutputError):
            # what arrived while the run went on is recorded too
            write_json(out / RUN_FILE, document)
        raise
    finally:
        recorder.close()
