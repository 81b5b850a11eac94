"""What systems differ in about files, asked of them here and nowhere else.

Where a system lacks something (Windows has no links that must not be followed, no syncing of folders, no reading at a place), the
next best takes its place. No file of ours is inherited by other programs: Python sees to that.
"""

import errno
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from io import FileIO
from pathlib import Path

_BINARY = getattr(os, "O_BINARY", 0)

READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY
"""Flags to open a file that is read: nobody waits, whatever has taken its place."""

MAKE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
"""Flags to open a file that nobody has made before."""

KEEP = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | _BINARY
"""Flags to open a file that may be there, and is made where it is not; no link is followed to it."""

REMOVES_OPEN_FILES = os.name != "nt"
"""Whether a file can be removed that is open."""

BLOCK_BYTES = 4096
"""Of a disk: what begins and ends with one, in a file and in memory, needs no copy on its way there."""

_WORTH_IT_BYTES = 2**18

_BEYOND = 2**30
"""A byte that no lock file has: on Windows, bytes that are locked cannot be read."""


def read_at(descriptor: int, count: int, place: int, /) -> bytes:
    """Return so many bytes of an open file from a place on, or those that it has."""
    if hasattr(os, "pread"):
        return os.pread(descriptor, count, place)
    os.lseek(descriptor, place, os.SEEK_SET)
    return os.read(descriptor, count)


def read_parts(file: FileIO, parts: Sequence[memoryview], /) -> bool:
    """Fill all parts from a file, one after the other, and return whether there was enough for them."""
    descriptor = file.fileno()
    if hasattr(os, "readv"):
        return moved(parts, lambda rest: os.readv(descriptor, rest))
    return moved(parts, lambda rest: file.readinto(rest[0]))


def moved(parts: Sequence[memoryview], move: Callable[[list[memoryview]], int | None]) -> bool:
    """Move bytes until all parts are done, and return whether they are; `move` takes what is left, and says how many."""
    rest = [part for part in parts if part.nbytes]
    while rest:
        count = move(rest)
        if not count:
            return False
        while rest and count >= rest[0].nbytes:
            count -= rest.pop(0).nbytes
        if count:
            rest[0] = rest[0][count:]
    return True


def write_parts(descriptor: int, parts: Sequence[memoryview], /) -> None:
    """Write all parts to an empty file, one after the other, that will be synced.

    A part that lies on whole blocks, in the file and in memory, goes from there to the disk. Copying it for the system first,
    which would do the same later, takes half as long as computing it. Where the file system has no such way, it is copied.
    """
    place = 0
    for part in parts:
        direct = _written_directly(descriptor, part, place)
        moved([part[direct:]], lambda rest: os.write(descriptor, rest[0]))
        place += part.nbytes


def _written_directly(descriptor: int, part: memoryview, place: int) -> int:
    """Write the whole blocks of a part past the system's memory, where there are many and it can be; return how many bytes."""
    whole = part.nbytes - part.nbytes % BLOCK_BYTES
    if whole < _WORTH_IT_BYTES or place % BLOCK_BYTES or not hasattr(os, "O_DIRECT"):
        return 0
    if address_of(part) % BLOCK_BYTES:
        return 0
    fcntl = import_module("fcntl")
    written, flags = 0, fcntl.fcntl(descriptor, fcntl.F_GETFL)
    try:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_DIRECT)
        while written < whole:
            written += os.write(descriptor, part[written:whole])
    except OSError as error:
        if error.errno not in {errno.EINVAL, errno.EOPNOTSUPP}:
            raise
    finally:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags)
    return written


def address_of(memory: memoryview, /) -> int:
    """Return where bytes begin in memory; numpy's own way to tell it loads `ctypes`."""
    # numpy, which options that are only printed need not load
    import numpy as np

    place: int = np.frombuffer(memory, np.uint8).__array_interface__["data"][0]
    return place


def sync_folder(folder: str | Path, /) -> None:
    """Have the names in a folder on the disk, where the system and the file system can do so.

    Raises:
        OSError: the folder is gone, or the disk fails.
    """
    if not hasattr(os, "O_DIRECTORY"):
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(descriptor)


def remove_and_close(path: Path, descriptor: int, /) -> None:
    """Remove a file of ours that is open, if it can be, and close it: the other way round where no open file can be removed."""
    if not REMOVES_OPEN_FILES:
        os.close(descriptor)
    with suppress(OSError):
        path.unlink()
    if REMOVES_OPEN_FILES:
        os.close(descriptor)


def lock(descriptor: int, /) -> bool:
    """Lock an open file for this process until that ends, and return False where another process holds it.

    Where the file system has no locks, there is none.
    """
    try:
        try:
            fcntl = import_module("fcntl")
        except ImportError:
            os.lseek(descriptor, _BEYOND, os.SEEK_SET)
            msvcrt = import_module("msvcrt")
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
    return True
