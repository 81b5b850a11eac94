"""How files are read: regular ones alone, as a FIFO or a device that stands where a file should may never answer, or never end;
and whatever a library raises on a damaged one becomes one FrameError that names it.
"""

import errno
import os
import stat
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from cadtof_cli.errors import FrameError
from cadtof_cli.files.system import READ_FLAGS

MOST_TEXT_BYTES = 2**22
"""Larger than any text that people write; what is read into memory as a whole should not be without end."""

_PIECE_BYTES = 2**22

_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def is_folder(path: Path, /) -> bool:
    """Return whether a path leads to a folder; false where it cannot be followed."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def real_path(path: Path, /) -> str:
    """Return the absolute path with links resolved; as it is where they form a loop, or no file can have such a name."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):
        return str(path.absolute())


def require_regular(path: Path, /) -> os.stat_result:
    """Make sure that there is a regular file, without opening it; return its state.

    Raises:
        OSError: there is none, and why.
    """
    try:
        state = path.stat()
    except ValueError as error:
        # a zero byte
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from error
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(state.st_mode):
        kind = _KINDS.get(stat.S_IFMT(state.st_mode), "no file")
        raise OSError(errno.EINVAL, f"found {kind}, expected a file", str(path))
    return state


def open_regular(path: Path, /) -> int:
    """Return a descriptor of a regular file, to be read.

    Raises:
        OSError: there is none, or it cannot be opened.
    """
    require_regular(path)
    # READ_FLAGS: does not wait even if a FIFO takes its place between these two lines
    return os.open(path, READ_FLAGS)


def read_text(path: Path, /, *, encoding: str = "utf-8", most_bytes: int | None = MOST_TEXT_BYTES) -> str:
    """Return the text in a regular file.

    Raises:
        OSError: there is none, it cannot be read, or it holds more than `most_bytes`.
        UnicodeDecodeError: it is no text.
    """
    size = require_regular(path).st_size
    if most_bytes is not None and size > most_bytes:
        raise OSError(errno.EFBIG, f"found {size:,} bytes, expected {most_bytes:,} or fewer", str(path))
    with os.fdopen(os.open(path, READ_FLAGS), "r", encoding=encoding) as file:
        return file.read()


def read_bytes(path: Path, /) -> bytes:
    """Return what a regular file holds.

    Raises:
        OSError: there is none, or it cannot be read.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        return file.read()


def read_through(path: Path, /) -> None:
    """Read a regular file to its end and keep nothing: the system says what a library has not handed on.

    Raises:
        OSError: there is none, or it cannot be opened or read: no more files may be open, a disk or network fails.
    """
    with os.fdopen(open_regular(path), "rb", buffering=0) as file:
        while file.read(_PIECE_BYTES):
            pass


PLAUSIBLE_BYTES = 2**26
PLAUSIBLE_RATIO = 4096
"""A header may promise this many bytes, or this many times the size of its file. More is a flipped bit, not a picture:
deflate reaches a ratio of 1,032, and a frame of a megapixel holds 16 to 32 MB."""


_MOST_LETTERS = 300


def in_brief(remarks: Iterable[object], /) -> str:
    """Return the first of the remarks that a library makes on a damaged file, and how many others there are, often thousands."""
    first, *others = dict.fromkeys(map(str, remarks))
    told = first if len(first) <= _MOST_LETTERS else f"{first[:_MOST_LETTERS]} …"
    return f"{told} (and {len(others)} remarks more)" if others else told


@contextmanager
def damage_as_frame_error(path: Path, kind: str) -> Iterator[None]:
    """Turn what reading raises into a FrameError; wrap the calls of a reading library, never a caller's work.

    The libraries promise nothing about damaged input: ValueError, TypeError, KeyError, ZeroDivisionError, struct.error,
    zlib.error, RuntimeError and more have been seen.
    """
    try:
        with warnings.catch_warnings():
            # warnings of the libraries do not concern the pixels; what does is checked by each reader
            warnings.simplefilter("ignore")
            yield
    except FrameError:
        raise
    except OSError as error:
        raise FrameError(f"{path}: cannot be read: {error.strerror or error}") from error
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
    """Refuse a header that promises more bytes than its file can hold, before they are allocated."""
    if promised > max(PLAUSIBLE_BYTES, PLAUSIBLE_RATIO * file_size):
        raise FrameError(
            f"{path}: damaged header: promises {promised:,} bytes of pixels, found a file of {file_size:,} bytes"
        )
