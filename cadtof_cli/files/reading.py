"""How folders are listed and names are ordered, how files are read, and how errors of reading libraries become FrameErrors.

Only regular files are read, because reading a FIFO or a device in place of a file may wait for ever or never end.
Whatever a library raises for a damaged file becomes a FrameError that names the file.
"""

import errno
import os
import re
import stat
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from cadtof_cli.errors import FrameError, UnlistedError, UnreadableError
from cadtof_cli.files.system import READ_FLAGS
from cadtof_cli.units import counted

MOST_TEXT_BYTES = 2**22
"""Limit for texts that are read into memory as a whole; it is larger than any text that people write."""

_PIECE_BYTES = 2**22

_PLAUSIBLE_BYTES = 2**26
_PLAUSIBLE_RATIO = 4096
"""Limits on the size of the pixels that a header promises: this many bytes, or this many times the size of the file.

A header that promises more than both is damaged. Deflate reaches a ratio of 1,032, and a frame of a megapixel holds 16 to
32 MB.
"""

_MOST_LETTERS = 300
"""Most letters of a library's remark that a message shows."""

_OBJECT = re.compile(r":? ?<[\w.]+ object at 0x[0-9a-fA-F]+>")

_DIGITS = re.compile(r"(\d+)")

_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def is_folder(path: Path, /) -> bool:
    """Return whether a path leads to a folder; False if the path cannot be followed."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def entries_of(folder: Path, pattern: str | None = None, /) -> list[tuple[str, bool]]:
    """Return the entries of a folder: their paths relative to the folder, with slashes, and whether each is a folder.

    If a pattern of their paths contains slashes, the entries are those of the folders that many levels below. A folder that
    cannot be listed raises an UnlistedError.
    """
    found, above = list[tuple[str, bool]](), [""]
    for _ in (pattern or "").split("/"):
        found = []
        for below in above:
            here = folder / below
            try:
                with os.scandir(here) as entries:
                    found += [
                        # a link in a loop is listed as a file; reading it raises the error
                        (
                            below + entry.name,
                            entry.is_dir(follow_symlinks=False) or (entry.is_symlink() and is_folder(Path(entry))),
                        )
                        for entry in entries
                    ]
            except PermissionError as error:
                raise UnlistedError(
                    f"{here}: no permission to list this folder; expected one that can be read"
                ) from error
            except OSError as error:
                raise UnlistedError(f"{here}: cannot be listed: {error.strerror}") from error
        above = [f"{name}/" for name, is_dir in found if is_dir and not name.rpartition("/")[2].startswith(".")]
    return found


def real_path(path: Path, /) -> str:
    """Return the absolute path with links resolved; links stay if they form a loop or if the name is impossible."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):
        return str(path.absolute())


def absolute(path: Path, /) -> Path:
    """Return an absolute path without `..`; links are not resolved."""
    return Path(os.path.normpath(path.absolute()))


def natural_key(name: str) -> str:
    """Return a sort key by which frame_2 comes before frame_10. Keys are single texts: there may be thousands."""
    pieces = _DIGITS.split(name.casefold())
    # each number becomes the count of its digits, then its digits; a name that ends before a number comes first
    for place in range(1, len(pieces), 2):
        digits = str(int(pieces[place]))
        pieces[place] = f"\0{len(digits):04}{digits}"
    return f"{''.join(pieces)}\0\0{name}"


def require_regular(path: Path, /) -> os.stat_result:
    """Return the `os.stat` result of a regular file, which is not opened; raise an OSError that says why if it is none."""
    try:
        state = path.stat()
    except ValueError as error:
        # the path contains a zero byte
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from error
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(state.st_mode):
        kind = _KINDS.get(stat.S_IFMT(state.st_mode), "no file")
        raise OSError(errno.EINVAL, f"found {kind}, expected a file", str(path))
    return state


def open_regular(path: Path, /) -> int:
    """Open a regular file for reading and return its descriptor."""
    require_regular(path)
    # READ_FLAGS: if a FIFO has replaced the file since the line above, opening it does not wait
    return os.open(path, READ_FLAGS)


def read_text(path: Path, /, *, encoding: str = "utf-8", most_bytes: int | None = MOST_TEXT_BYTES) -> str:
    """Return the text in a regular file.

    Raise OSError also if it holds more than `most_bytes`, UnicodeDecodeError if it is not text in this encoding.
    """
    size = require_regular(path).st_size
    if most_bytes is not None and size > most_bytes:
        raise OSError(errno.EFBIG, f"found {size:,} bytes, expected {most_bytes:,} or fewer", str(path))
    with os.fdopen(os.open(path, READ_FLAGS), "r", encoding=encoding) as file:
        return file.read()


def read_bytes(path: Path, /) -> bytes:
    """Return the content of a regular file."""
    with os.fdopen(open_regular(path), "rb") as file:
        return file.read()


def read_through(path: Path, /) -> None:
    """Read a regular file and keep nothing, to raise an error of the disk, network or system that a library did not pass on."""
    with os.fdopen(open_regular(path), "rb", buffering=0) as file:
        while file.read(_PIECE_BYTES):
            pass


def in_brief(remarks: Iterable[object], /) -> str:
    """Return the first remark of a library on a damaged file, shortened, and the number of different remarks after it.

    A library may make thousands of remarks on one file. Objects of Python go: their addresses differ from run to run.
    """
    first, *others = dict.fromkeys(_OBJECT.sub("", str(remark)) for remark in remarks)
    told = first if len(first) <= _MOST_LETTERS else f"{first[:_MOST_LETTERS]} …"
    return f"{told} (and {counted(len(others), 'more remark')})" if others else told


@contextmanager
def damage_as_frame_error(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever is raised in the block into a FrameError. The block must contain only calls of a reading library.

    The libraries do not document what they raise for damaged files. We have seen ValueError, TypeError, KeyError,
    ZeroDivisionError, struct.error, zlib.error, RuntimeError and more.
    """
    try:
        with warnings.catch_warnings():
            # the libraries' warnings say nothing about pixels; each reader checks the pixels itself
            warnings.simplefilter("ignore")
            yield
    except FrameError:
        raise
    except OSError as error:
        # errors of the system have a number; those that libraries raise on damaged files have none
        kind_of_error = FrameError if error.errno is None else UnreadableError
        raise kind_of_error(f"{path}: cannot be read: {error.strerror or error}") from error
    except MemoryError as error:
        raise FrameError(f"{path}: not enough memory for the {kind} image that its header describes") from error
    except UnicodeDecodeError as error:
        raise FrameError(
            f"{path}: damaged {kind}: it contains a name that is not UTF-8; expected a complete file"
        ) from error
    except Exception as error:
        words = in_brief([str(error) or f"the library stopped with {type(error).__name__}"])
        raise FrameError(f"{path}: damaged {kind}: {words}; expected a complete file, try copying it again") from error


def require_plausible_size(path: Path, promised: int, file_size: int) -> None:
    """Raise FrameError, before memory is allocated, if a header promises more bytes than its file can hold."""
    if promised > max(_PLAUSIBLE_BYTES, _PLAUSIBLE_RATIO * file_size):
        raise FrameError(
            f"{path}: damaged header: promises {promised:,} bytes of pixels, found a file of {file_size:,} bytes"
        )
