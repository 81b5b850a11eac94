"""`frames.jsonl`, the lines of a run's frames: how the file grows, what a line says, and the map that it names."""

import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from cadtof_cli.errors import FrameError
from cadtof_cli.files.atomic import atomic_write, not_written, writing
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.reports import FrameReport, report_of
from cadtof_cli.workflows.resolve.run_json import resumable

FRAMES_FILE = "frames.jsonl"


@dataclass
class LineFile:
    """A file that grows by a line at a time. A line is known by its place: where it begins, in bytes.

    Attributes:
        path: path of the file.
        file: the open file. It is not buffered, so that closing it has nothing to write.
        say: called with messages for the user.
    """

    path: Path
    file: BinaryIO
    say: Callable[[str], None]

    def append(self, line: bytes, /) -> int:
        """Add a line, which is in the file whole or not at all, and return its place."""
        self._require_there()
        place, written = self.file.seek(0, os.SEEK_END), 0
        try:
            while written < len(line):
                written += self.file.write(line[written:])
        except OSError:
            # a full disk may have taken a part of the line
            self.file.truncate(place)
            raise
        return place

    def line_at(self, place: int, /) -> bytes:
        """Return the line at a place."""
        line, size = b"", 1024
        while not line.endswith(b"\n"):
            piece = read_at(self.file.fileno(), size, place + len(line))
            if not piece:
                return line
            line += piece[: piece.find(b"\n") + 1 or None]
        return line

    def complete_lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield place and text of each line. Cut off a last line that is incomplete because the run was killed.

        Lines with a gap are left out.
        """
        end = 0
        with writing(self.path), self.path.open("rb") as lines:
            for line in lines:
                if not line.endswith(b"\n"):
                    break
                if not has_gap(line):
                    yield end, line
                end += len(line)
            self.file.truncate(end)

    def sync(self) -> None:
        """Make sure that all lines are on the disk."""
        with writing(self.path):
            self._require_there()
            os.fsync(self.file.fileno())

    def keep(self, places: Sequence[int], /) -> None:
        """Keep only the lines at these places, in this order; then no more lines can be added."""
        if not places:
            # `atomic_write` refuses an empty file
            self.file.truncate(0)
            return
        with atomic_write(self.path) as temporary, temporary.open("wb") as ordered:
            ordered.writelines(map(self.line_at, places))
            # some systems cannot replace an open file
            self.file.close()

    def _require_there(self) -> None:
        """Write the file anew from the open file, if somebody has removed or replaced it."""
        try:
            if os.path.samestat(os.lstat(self.path), os.fstat(self.file.fileno())):
                return
        except FileNotFoundError:
            pass
        with atomic_write(self.path) as temporary:
            copy = temporary.open("r+b", buffering=0)
            size, place = os.fstat(self.file.fileno()).st_size, 0
            while place < size:
                place += copy.write(read_at(self.file.fileno(), 2**20, place))
        self.file.close()
        self.file = copy
        self.say(f"{self.path}: was removed or replaced while frames were resolved; written anew")


@contextmanager
def open_lines(path: Path, /, *, anew: bool, say: Callable[[str], None]) -> Iterator[LineFile]:
    """Open a file of lines, or make it; `anew`: in place of one that is there. Raises OutputError if it cannot be written."""
    with writing(path):
        if anew:
            path.unlink(missing_ok=True)
        lines = LineFile(path, os.fdopen(os.open(path, OPEN_OR_CREATE_FLAGS, 0o666), "r+b", buffering=0), say)
    try:
        if not stat.S_ISREG(os.fstat(lines.file.fileno()).st_mode):
            raise not_written(path, OSError("found no regular file there"))
        # a share that failed tells so once more when the file is synced next; the lines that it lost are found missing
        with suppress(OSError):
            os.fsync(lines.file.fileno())
        yield lines
    finally:
        # on a network share that is gone even closing fails; what was to be reported has been raised already
        with suppress(OSError):
            lines.file.close()


def has_gap(line: bytes, /) -> bool:
    """Return whether a network share lost a part of a line that had been written: zero bytes stand there."""
    return b"\0" in line


def required_report(line: bytes, path: Path, /) -> FrameReport:
    """Return the report that a line of the `frames.jsonl` at `path` holds; raises OutputError if it holds none."""
    with resumable(path):
        report = report_of(line)
        if report is None:
            raise ValueError(f"found: {line[:40].decode(errors='replace').rstrip()}")
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
