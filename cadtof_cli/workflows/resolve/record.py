"""The record of a run: `run.json`, and `frames.jsonl` with a line per frame, written while the run goes on.

Whatever ends a run, what was finished is on disk, and another run can go on from there.
"""

import json
import os
import stat
from array import array
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, field, fields, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal, get_args

from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import atomic_write, not_written, write_json, writing
from cadtof_cli.files.reading import read_text
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at
from cadtof_cli.records import dataclass

RUN_FILE = "run.json"
FRAMES_FILE = "frames.jsonl"

ALREADY_THERE = "exists already"
"""How the reason ends of a frame that is skipped since its maps are there."""

FrameStatus = Literal["ok", "failed", "skipped"]


@dataclass(frozen=True)
class SourceFile:
    """A file that a frame was read from, as it was then."""

    name: str
    bytes: int
    mtime_ns: int


@dataclass(frozen=True)
class FrameReport:
    """A line of `frames.jsonl`; the fields are its keys, `more_paths` only where pixels may have more than two.

    Attributes:
        source: where the frame lies.
        output: its maps; None where there are none.
        status: what has become of it.
        reason: why, or what there is to know besides.
        seconds: that it took.
        one_path, two_paths, more_paths, diffuse, invalid: pixels.
        files: that it was read from; None where one of them is missing.
        digest: of the values that were read, see `content_digest`.
        output_bytes: size of its maps' file.
        output_digest: digest of that file's bytes.
        line: the frame's line, where that is not this report: of maps that an earlier run made and this one kept.
        note: what the user should know, and the record should not.
        stops: whether the next frame could not be written either.
    """

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
    files: tuple[SourceFile, ...] | None = None
    digest: str | None = None
    output_bytes: int | None = None
    output_digest: str | None = None
    line: "FrameReport | None" = None
    note: str | None = None
    stops: bool = False

    @property
    def is_valid(self) -> bool:
        """Whether the fields hold what they should: a line may come from anywhere."""
        texts = (self.output, self.reason, self.digest, self.output_digest)
        counts = (self.one_path, self.two_paths, self.more_paths, self.diffuse, self.invalid, self.output_bytes)
        return (
            isinstance(self.source, str)
            and self.status in get_args(FrameStatus)
            and isinstance(self.seconds, int | float)
            and all(isinstance(text, str | None) for text in texts)
            and (self.output is None or Path(self.output).name != "")
            and all(isinstance(count, int | None) for count in counts)
        )

    @property
    def is_already_there(self) -> bool:
        """Whether an earlier run has made the maps."""
        return self.status == "skipped" and str(self.reason).endswith(ALREADY_THERE)

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        line = {name: value for name, value in vars(self).items() if name in _JSON_FIELDS}
        if self.more_paths is None:
            del line["more_paths"]
        line["files"] = self.files and [vars(file) for file in self.files]
        return line


_JSON_FIELDS = frozenset(one.name for one in fields(FrameReport)) - {"line", "note", "stops"}


def report_of(line: bytes, /) -> FrameReport | None:
    """Return the report that a line of `frames.jsonl` holds; None where it holds none."""
    try:
        values = json.loads(line)
        files = values.get("files")
        known = None if files is None else tuple(SourceFile(**one) for one in files)
        report = FrameReport(**{**values, "files": known})
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None
    return report if report.is_valid else None


@dataclass
class RunTotals:
    """What has become of the frames so far.

    `diffuse_frames` are those whose MPI was taken for diffuse, `already_there` those that were skipped since their maps are.
    """

    frames: int = 0
    ok: int = 0
    failed: int = 0
    skipped: int = 0
    already_there: int = 0
    one_path: int = 0
    two_paths: int = 0
    more_paths: int = 0
    diffuse: int = 0
    diffuse_frames: int = 0
    invalid: int = 0
    seconds: float = 0.0

    def add(self, report: FrameReport) -> None:
        """Count one more frame."""
        self.frames += 1
        setattr(self, report.status, getattr(self, report.status) + 1)
        if report.status == "skipped":
            self.already_there += report.is_already_there
        for kind in ("one_path", "two_paths", "more_paths", "diffuse", "invalid"):
            setattr(self, kind, getattr(self, kind) + (getattr(report, kind) or 0))
        self.diffuse_frames += bool(report.diffuse)


def read_record(folder: Path, /) -> dict[str, Any]:
    """Return what the `run.json` of a folder holds.

    Raises:
        OSError, ValueError, TypeError: there is none, or it is no JSON object.
    """
    try:
        return dict(json.loads(read_text(folder / RUN_FILE, most_bytes=None)))
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 text: byte {error.start}") from error
    except RecursionError as error:
        raise ValueError("lists or objects within each other, hundreds deep") from error


@dataclass
class RunRecorder:
    """Writes `run.json` and `frames.jsonl`.

    A line is appended to `frames.jsonl` as soon as its frame is finished. A run that continues an earlier one appends too; at its
    end the lines are sorted into the order of the frames, one for each, as if nothing had been interrupted.

    Attributes:
        path: of `frames.jsonl`.
        document: what `run.json` says.
        lines: the file at `path`, open; not buffered, so that nothing is left to be written, and to fail, on closing.
        resumed: whether the run continues an earlier one.
        say: told of what the user should know.
    """

    path: Path
    document: Mapping[str, Any]
    lines: BinaryIO
    resumed: bool
    say: Callable[[str], None]
    _totals: RunTotals = field(default_factory=RunTotals)
    _before: dict[str, int] = field(default_factory=dict)
    _places: "array[int]" = field(default_factory=lambda: array("q"))

    def before(self, output: Path, /) -> FrameReport | None:
        """Return what an earlier run recorded of a frame whose maps it wrote; None where it did not."""
        place = self._known_place(str(output))
        return None if place is None else report_of(self._line_at(place))

    def add(self, report: FrameReport, /) -> None:
        """Append a frame's line; a frame whose maps were kept has it already, if nothing in it has changed.

        Raises:
            OutputError: it cannot be written; PlaceError: no other could be either.
        """
        line = report.line or report
        self._totals.add(line)
        text = json.dumps(line.as_json()).encode() + b"\n"
        try:
            place = self._known_place(line.output) if report.line else None
            if place is None or self._line_at(place) != text:
                self._require_there()
                place, written = self.lines.seek(0, os.SEEK_END), 0
                try:
                    while written < len(text):
                        written += self.lines.write(text[written:])
                except OSError:
                    # a full disk may have taken a part of it
                    self.lines.truncate(place)
                    raise
        except OSError as error:
            raise not_written(self.path, error) from error
        if self.resumed:
            self._places.append(place)

    def _known_place(self, output: str | None) -> int | None:
        """Return where the earlier run's line about a frame begins, by the place of its maps; None where there is none."""
        return self._before.get(place_in(self.path.parent, Path(output or "")))

    def finish(self, seconds: float, /) -> None:
        """Complete both files; the totals are those of all frames, whichever run resolved them."""
        with writing(self.path):
            self._require_there()
            os.fsync(self.lines.fileno())
        if self.resumed:
            with atomic_write(self.path) as temporary, temporary.open("wb") as ordered:
                ordered.writelines(map(self._line_at, self._places))
        totals = asdict(replace(self._totals, seconds=round(seconds, 3)))
        del totals["already_there"]  # a line of frames.jsonl is that of a frame that was resolved, whichever run did it
        write_json(self.path.with_name(RUN_FILE), {**self.document, "finished": True, "totals": totals})

    def find_lines(self, out: Path, /) -> None:
        """Find the lines of frames that have maps; cut off a last line that a killed run did not complete.

        `out` is what the earlier run called its folder.

        Raises:
            OutputError: there are other lines than those of a run.
        """
        end = 0
        with writing(self.path), self.path.open("rb") as lines:
            for line in lines:
                if not line.endswith(b"\n"):
                    break
                report = report_of(line)
                if report is None:
                    raise OutputError(f"{self.path}: not the record of a run, so it cannot be resumed ({line[:40]!r})")
                if report.output is not None:
                    self._before[place_in(out, Path(report.output))] = end
                end += len(line)
            self.lines.truncate(end)

    def _line_at(self, place: int) -> bytes:
        """Return the line that begins at a place of the file."""
        line, size = b"", 1024
        while not line.endswith(b"\n"):
            piece = read_at(self.lines.fileno(), size, place + len(line))
            if not piece:
                return line
            line += piece[: piece.find(b"\n") + 1 or None]
        return line

    def _require_there(self) -> None:
        """Write `frames.jsonl` anew from the open file, where somebody has removed or replaced it meanwhile."""
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


def place_in(out: Path, output: Path, /) -> str:
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
    path, run = out / FRAMES_FILE, out / RUN_FILE
    if not resume:
        # the settings first: without them, the lines would be taken for the next run's
        write_json(run, document)
    with writing(path):
        if not resume:
            path.unlink(missing_ok=True)
        lines = os.fdopen(os.open(path, OPEN_OR_CREATE_FLAGS, 0o666), "r+b", buffering=0)
    recorder = RunRecorder(path, document, lines, resume, say)
    try:
        if not stat.S_ISREG(os.fstat(lines.fileno()).st_mode):
            raise not_written(path, OSError("found no regular file there"))
        if resume:
            recorder.find_lines(Path(read_record(out)["arguments"]["out"]))
            write_json(run, document)
        try:
            yield recorder
        except BaseException:
            with suppress(OutputError):
                # what arrived while the run went on is recorded too
                write_json(run, document)
            raise
    finally:
        recorder.lines.close()
