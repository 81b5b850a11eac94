"""The record of a run: `run.json`, and `frames.jsonl` with a line per frame. Both are written during the run.

However a run ends, the record of all finished frames is on the disk, and another run can continue from there.
"""

import json
import os
import stat
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import BinaryIO

from cadtof_cli.errors import FrameError, OutputError
from cadtof_cli.files.atomic import atomic_write, not_written, write_json, writing
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.records import dataclass
from cadtof_cli.units import first_of
from cadtof_cli.workflows.resolve.frame_task import FrameTask
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals, report_of
from cadtof_cli.workflows.resolve.run_json import RUN_FILE, RunRecord, resumable

FRAMES_FILE = "frames.jsonl"


@dataclass
class RunRecorder:
    """Writes `run.json` and `frames.jsonl`.

    A line is appended to `frames.jsonl` as soon as its frame is finished. A run that continues an earlier one appends too. When
    such a run ends, the lines are put into the order of the frames, one line per frame, as if there had been no interruption.
    Before these come the lines of earlier maps for which this run had no frame, because their recorded frames were removed.
    An earlier map goes if its recorded frames are in other maps now: means of frames, if frames were added or removed.

    If frames arrive during the run, it may name frames twice, or not name those of the earlier run. Then the lines of both
    runs stay, but of several lines about a frame only the last.

    Attributes:
        path: path of `frames.jsonl`.
        document: content of `run.json`.
        lines: the open file at `path`. It is not buffered, so that closing it has nothing to write.
        resumed: whether the run continues an earlier one.
        arriving: whether frames arrive during the run.
        say: called with messages for the user.
    """

    path: Path
    document: RunRecord
    lines: BinaryIO
    resumed: bool
    arriving: bool
    say: Callable[[str], None]
    _totals: RunTotals = field(default_factory=RunTotals)
    _before: dict[str, int] = field(default_factory=dict)
    _earlier_places: "array[int]" = field(default_factory=lambda: array("q"))
    _places: "array[int]" = field(default_factory=lambda: array("q"))
    _not_met: set[str] = field(default_factory=set)
    _failed: set[str] = field(default_factory=set)
    _recorded: set[str] = field(default_factory=set)
    _removed: list[str] = field(default_factory=list)

    def before(self, output: Path, /) -> FrameReport | None:
        """Return the report of an earlier run on the frame whose maps it wrote into `output`; None: there is none."""
        place = self._known_place(str(output))
        return None if place is None else report_of(self._line_at(place))

    def meet(self, task: FrameTask, /) -> None:
        """Remember the recorded frames of a task: maps of the earlier run may show the same frames."""
        folder = place_in(self.path.parent, task.output).rpartition("/")[0]
        self._recorded.update(f"{folder}/{Path(str(source)).name}" for source in task.sources)

    def add(self, report: FrameReport, /) -> None:
        """Append a frame's line. If the maps were kept, the line may be there already; then nothing is written.

        Raises:
            OutputError: the line cannot be written; PlaceError: no other line could be written either.
        """
        line = report.kept or report
        self._totals.add(line)
        text = json.dumps(line.as_json()).encode() + b"\n"
        try:
            place = self._known_place(line.output) if report.kept else None
            if place is None or self._line_at(place) != text:
                self._require_there()
                place, written = self.lines.seek(0, os.SEEK_END), 0
                try:
                    while written < len(text):
                        written += self.lines.write(text[written:])
                except OSError:
                    # a full disk may have taken a part of the line
                    self.lines.truncate(place)
                    raise
        except OSError as error:
            raise not_written(self.path, error) from error
        if self.resumed or self.arriving:
            self._places.append(place)
            self._not_met.discard(place_in(self.path.parent, Path(line.output or "")))
            if line.status == "failed":
                self._failed.add(line.source)

    def _known_place(self, output: str | None) -> int | None:
        """Return where the earlier run's line about the maps in `output` begins, in bytes; None: there is no such line."""
        return self._before.get(place_in(self.path.parent, Path(output or "")))

    def finish(self, seconds: float, /) -> None:
        """Complete both files. The totals count all frames, whichever run resolved them."""
        with writing(self.path):
            self._require_there()
            os.fsync(self.lines.fileno())
        places, totals = self._last_lines() if self.arriving else self._lines_in_order()
        if self._removed:
            names = first_of(self._removed, 3)
            self.say(f"{self.path.parent}: removed {names}, because other maps show their recorded frames now")
        is_new_order = self.resumed or len(places) < len(self._places)
        if is_new_order and not places:
            # `atomic_write` refuses an empty file
            self.lines.truncate(0)
        elif is_new_order:
            with atomic_write(self.path) as temporary, temporary.open("wb") as ordered:
                ordered.writelines(map(self._line_at, places))
                # some systems cannot replace an open file
                self.lines.close()
        counts = asdict(replace(totals, seconds=seconds))
        del counts["already_there"]  # always 0: kept maps count by the line of the run that made them
        write_json(self.path.with_name(RUN_FILE), {**self.document, "finished": True, "totals": counts})

    def _last_lines(self) -> tuple["array[int]", RunTotals]:
        """Return where the last line about each frame begins, and their totals. A frame is known by its file and by its map.

        A line whose map has been removed since an earlier run does not count.
        """
        out, last, key_of, totals = self.path.parent, dict[str, int](), dict[str, str](), RunTotals()
        for place in (*self._earlier_places, *self._places):
            report = report_of(self._line_at(place))
            assert report is not None
            if report.output and not self._stays(place_in(out, Path(report.output)), report):
                continue
            names = [name for name in (report.output, report.source) if name]
            key, *others = [*dict.fromkeys(key_of[name] for name in names if name in key_of), report.source]
            for other in others:
                if other != key:
                    last.pop(other, None)
            key_of.update(dict.fromkeys(names, key))
            last[key] = place
        for report in filter(None, map(report_of, map(self._line_at, last.values()))):
            totals.add(report)
        return array("q", last.values()), totals

    def _lines_in_order(self) -> tuple["array[int]", RunTotals]:
        """Return where lines begin, and their totals: those of maps without a frame in this run, then those of this run."""
        kept, totals = array("q"), replace(self._totals)
        for name in filter(self._not_met.__contains__, self._before):
            report = report_of(self._line_at(self._before[name]))
            if report and report.source not in self._failed and self._stays(name, report):
                totals.add(report)
                kept.append(self._before[name])
        return kept + self._places, totals

    def _stays(self, name: str, report: FrameReport) -> bool:
        """Return whether a line about the map called `name` stays. The map is removed if other maps show its frames now."""
        out = self.path.parent
        if name in self._not_met and (out / name).is_file():
            frames = {Path(report.source).name, *(file.name for file in report.files or ())}
            folder = name.rpartition("/")[0]
            if not self._recorded.isdisjoint(f"{folder}/{frame}" for frame in frames):
                remove_map(out, out / name, report)
                self._removed.append(name)
                return False
        return (out / name).is_file()

    def find_lines(self) -> None:
        """Find the lines of frames that have maps. Cut off a last line that is incomplete because the run was killed.

        The lines have been renamed (`rename_lines`): they call the folder of the run as this run does.

        Raises:
            OutputError: a line is not a report on a frame.
        """
        end = 0
        with writing(self.path), self.path.open("rb") as lines:
            for line in lines:
                if not line.endswith(b"\n"):
                    break
                report = required_report(line, self.path)
                self._earlier_places.append(end)
                if report.output is not None:
                    self._before[place_in(self.path.parent, Path(report.output))] = end
                end += len(line)
            self.lines.truncate(end)
        self._not_met = set(self._before)

    def _line_at(self, place: int) -> bytes:
        """Return the line that begins at a place of the file, given in bytes."""
        line, size = b"", 1024
        while not line.endswith(b"\n"):
            piece = read_at(self.lines.fileno(), size, place + len(line))
            if not piece:
                return line
            line += piece[: piece.find(b"\n") + 1 or None]
        return line

    def _require_there(self) -> None:
        """Write `frames.jsonl` anew from the open file, if somebody has removed or replaced it during the run."""
        try:
            if os.path.samestat(os.lstat(self.path), os.fstat(self.lines.fileno())):
                return
        except FileNotFoundError:
            pass
        with atomic_write(self.path) as temporary:
            copy = temporary.open("r+b", buffering=0)
            size, place = os.fstat(self.lines.fileno()).st_size, 0
            while place < size:
                place += copy.write(read_at(self.lines.fileno(), 2**20, place))
        self.lines.close()
        self.lines = copy
        self.say(f"{self.path}: was removed or replaced while frames were resolved; written anew")


def required_report(line: bytes, path: Path, /) -> FrameReport:
    """Return the report that a line of the `frames.jsonl` at `path` holds; raises OutputError if it holds none."""
    report = report_of(line)
    if report is None:
        found = line[:40].decode(errors="replace").rstrip()
        raise OutputError(f"{path}: not the record of a run, so it cannot be resumed (found: {found})")
    return report


def place_in(out: Path, output: Path, /) -> str:
    """Return the path of a map file from the run's folder `out`; if it does not lie below `out`, only its name."""
    try:
        return output.relative_to(out).as_posix()
    except ValueError:
        return output.name


def remove_map(out: Path, place: Path, report: FrameReport, /) -> None:
    """Remove the map of a line if the file there is a map of the recorded size, and no link leads out of the folder.

    Lines of 0.1.0 record no size: the file must then hold maps.

    Raises:
        OutputError: it cannot be removed.
    """
    with suppress(FileNotFoundError, NotADirectoryError, ValueError):
        found = place.lstat()
        inside = Path(real_path(place.parent)).is_relative_to(real_path(out))
        is_map = place.suffix in MAP_SUFFIXES and stat.S_ISREG(found.st_mode)
        if inside and is_map and (found.st_size == report.output_bytes or _is_old_map(place, report)):
            with writing(place):
                place.unlink(missing_ok=True)


def _is_old_map(place: Path, report: FrameReport) -> bool:
    """Return whether a file holds maps, and its line is of 0.1.0."""
    with suppress(FrameError):
        return report.output_bytes is None and DIRECT_DEPTH in read_layers(place)
    return False


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
            if line.endswith(b"\n"):
                report = required_report(line, path)
                output = report.output and Path(report.output)
                if output and output.is_relative_to(called):
                    report = replace(report, output=(out / output.relative_to(called)).as_posix())
                if not is_here:
                    report = replace(report, source=str(start / report.source))
                line = json.dumps(report.as_json()).encode() + b"\n"
            renamed.write(line)


@contextmanager
def recorded_run(
    out: Path, document: RunRecord, /, *, resume: bool, arriving: bool, say: Callable[[str], None]
) -> Iterator[RunRecorder]:
    """Write a run's `run.json`, and yield a recorder that holds its `frames.jsonl` open for the reports on its frames.

    Raises:
        OutputError: one of the two cannot be written; or the `frames.jsonl` to be resumed holds other lines than reports.
    """
    path, run = out / FRAMES_FILE, out / RUN_FILE
    if not resume:
        # the settings come first: without them, the lines would be taken for lines of the next run
        write_json(run, document)
    with writing(path):
        if not resume:
            path.unlink(missing_ok=True)
        lines = os.fdopen(os.open(path, OPEN_OR_CREATE_FLAGS, 0o666), "r+b", buffering=0)
    recorder = RunRecorder(path, document, lines, resume, arriving, say)
    try:
        if not stat.S_ISREG(os.fstat(lines.fileno()).st_mode):
            raise not_written(path, OSError("found no regular file there"))
        if resume:
            recorder.find_lines()
            write_json(run, document)
        try:
            yield recorder
        except BaseException:
            with suppress(OutputError):
                # inputs that arrived during the run are recorded too
                write_json(run, document)
            raise
    finally:
        # on a network share that is gone even closing fails; what was to be reported has been raised already
        with suppress(OSError):
            recorder.lines.close()
