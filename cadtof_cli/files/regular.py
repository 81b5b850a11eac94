"""Only regular files are read: a FIFO or a device that stands where a file should may never answer, or never end."""

import errno
import os
import stat
from pathlib import Path

from cadtof_cli.files.system import READ

MOST_TEXT_BYTES = 2**22
"""Larger than any text that people write; what is read into memory as a whole should not be without end."""

_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def is_there(path: Path, /) -> bool:
    """Tell whether a folder has something of this name, be it a link that leads nowhere; false where it cannot be looked into."""
    return os.path.lexists(path)


def is_folder(path: Path, /) -> bool:
    """Tell whether a path leads to a folder; false where it cannot be followed."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def real_path(path: Path, /) -> str:
    """Return where a path leads, links followed; where they lead in a circle, or nothing can have this name, what it says."""
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
    # whatever takes its place between the two: nobody waits
    return os.open(path, READ)


def read_text(path: Path, /, *, encoding: str = "utf-8", most_bytes: int | None = MOST_TEXT_BYTES) -> str:
    """Return the text in a regular file.

    Raises:
        OSError: there is none, it cannot be read, or it holds more than `most_bytes`.
        UnicodeDecodeError: it is no text.
    """
    size = require_regular(path).st_size
    if most_bytes is not None and size > most_bytes:
        raise OSError(errno.EFBIG, f"found {size:,} bytes, expected {most_bytes:,} or fewer", str(path))
    with os.fdopen(open_regular(path), "r", encoding=encoding) as file:
        return file.read()
