"""File operations that differ between operating systems. Only this module asks which system it runs on.

If a system lacks a feature, the nearest substitute is used. Windows cannot refuse to follow links, sync folders or read
at a position. Child processes do not inherit our open files; Python sees to that.
"""

import errno
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path

from cadtof_cli.errors import CadtofError

_BINARY = getattr(os, "O_BINARY", 0)

READ_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY
"""Flags to open a file for reading; if a FIFO is in its place, opening it does not wait."""

CREATE_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
"""Flags to create a file that must not exist yet."""

OPEN_OR_CREATE_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | _BINARY
"""Flags to open a file, or create it if it does not exist; a link is not followed."""

REMOVES_OPEN_FILES = os.name != "nt"
"""Whether an open file can be removed."""

SHELL_LEAVES_PATTERNS = os.name == "nt"
"""Whether the shell leaves it to programs to replace patterns of names, such as `rec/*`, by the names."""

BLOCK_BYTES = 4096
"""Size of a disk block. Data aligned to blocks, in the file and in memory, can be written without a copy."""

_ASKED_AGAIN_S = 0.02
"""Pause before a pipe of Windows is asked again whether it holds something."""

_LEAST_DIRECT_BYTES = 2**18

_LOCKED_BYTE = 2**30
"""Position of the byte that is locked.

It lies beyond the end of the lock file, because locked bytes cannot be read on Windows and on shares of SMB.
"""


def path_from(folder: Path, path: Path, /) -> str:
    """Return the path of a place from a folder, with `/` between steps; on another drive of Windows, it is absolute."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.absolute().as_posix()


def common_folder(paths: Iterable[Path], /) -> Path:
    """Return the deepest folder that contains all of the paths, as an absolute path.

    Raises:
        CadtofError: they lie on different drives of Windows.
    """
    whole = sorted(set(map(os.path.abspath, paths)))
    try:
        return Path(os.path.commonpath(whole))
    except ValueError:
        raise CadtofError(f"no folder holds both {whole[0]} and {whole[-1]}; expected inputs on one drive") from None


def path_of(name: bytes, /) -> Path:
    """Return the path whose name another program wrote.

    On Windows, a name that is not UTF-8 is in the code page of the console, as `dir /b` writes it.
    """
    try:
        return Path(os.fsdecode(name))
    except UnicodeDecodeError:
        return Path(name.decode("oem", errors="replace"))


def expanded(arguments: Iterable[str], /) -> list[str]:
    """Return arguments with each pattern, such as `rec/*`, replaced by the names that it matches, as shells of POSIX do.

    The shells of Windows leave that to programs. A pattern that matches nothing stays as it is. A bracket stands for
    itself, because names on Windows may hold brackets, but neither `*` nor `?`.
    """
    found = list[str]()
    for argument in arguments:
        matches = list[str]()
        # a drive such as `\\?\C:` is no pattern
        if SHELL_LEAVES_PATTERNS and argument[:1] != "-" and set("*?") & set(os.path.splitdrive(argument)[1]):
            from glob import glob

            matches = sorted(glob(argument.replace("[", "[[]")))  # noqa: PTH207, paths stay as they were typed
        found += matches or [argument]
    return found


def has_more(descriptor: int, /, *, pause_s: float) -> bool:
    """Return whether there is more to read, or the writer ends, before the pause is over.

    On Windows, `select` cannot wait for a pipe, so the pipe is asked again and again. A file that is no pipe can be read
    at once there, and a terminal counts as a pause.
    """
    import select

    try:
        return bool(select.select([descriptor], [], [], pause_s)[0])
    except OSError:
        if os.isatty(descriptor):
            return False
    until = time.monotonic() + pause_s
    try:
        pipe = import_module("msvcrt").get_osfhandle(descriptor)
        while not import_module("_winapi").PeekNamedPipe(pipe, 0)[0]:
            if time.monotonic() >= until:
                return False
            time.sleep(_ASKED_AGAIN_S)
    except OSError:
        # the pipe has ended, or this is no pipe: reading does not wait
        return True
    return True


def flush_c_streams() -> None:
    """Write out the text that C's `printf` holds in its buffers; it holds it long if stdout is not a terminal."""
    import ctypes

    ctypes.CDLL(None if os.name != "nt" else "ucrtbase").fflush(None)


def read_at(descriptor: int, count: int, place: int, /) -> bytes:
    """Return `count` bytes of an open file, beginning at byte `place`, or fewer if the file ends before.

    The position of the file does not change: a library may have the same file open and go on reading there.
    """
    if hasattr(os, "pread"):
        return os.pread(descriptor, count, place)
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, place, os.SEEK_SET)
    try:
        return os.read(descriptor, count)
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)


def read_parts(descriptor: int, parts: Sequence[memoryview], /) -> bool:
    """Fill all parts, one after the other, from an open file; return False if the file ended before they were full."""
    rest = [part for part in parts if part.nbytes]
    while rest:
        count = os.readv(descriptor, rest) if hasattr(os, "readv") else _read_into(descriptor, rest[0])
        if not count:
            return False
        while rest and count >= rest[0].nbytes:
            count -= rest.pop(0).nbytes
        if count:
            rest[0] = rest[0][count:]
    return True


def _read_into(descriptor: int, part: memoryview) -> int:
    found = os.read(descriptor, part.nbytes)
    part[: len(found)] = found
    return len(found)


def write_parts(descriptor: int, parts: Sequence[memoryview], /) -> None:
    """Write all parts, one after the other, to an empty file that was opened only for writing; the caller syncs it.

    A part that is aligned to blocks, in the file and in memory, bypasses the page cache (O_DIRECT), because copying
    maps into the cache takes half as long as computing them. If the file system does not support that, the part is
    copied.
    """
    place = 0
    for part in parts:
        written, whole = 0, part.nbytes - part.nbytes % BLOCK_BYTES
        if whole >= _LEAST_DIRECT_BYTES and place % BLOCK_BYTES == 0 and hasattr(os, "O_DIRECT"):
            import fcntl

            try:
                fcntl.fcntl(descriptor, fcntl.F_SETFL, os.O_DIRECT)
                while written < whole:
                    written += os.write(descriptor, part[written:whole])
            except OSError as error:
                # the file system does not support O_DIRECT, or the memory is not aligned as it needs
                if error.errno not in {errno.EINVAL, errno.EOPNOTSUPP}:
                    raise
            finally:
                fcntl.fcntl(descriptor, fcntl.F_SETFL, 0)
        while written < part.nbytes:
            written += os.write(descriptor, part[written:])
        place += part.nbytes


@contextmanager
def codes_of_the_system(path: Path, size: int, /) -> Iterator[None]:
    """Give errors in writing a file of about `size` bytes the error code of the system, which numpy and OpenEXR drop.

    To learn the code, zeros are written into the file, whose content is lost already; that fails for the same reason.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:
            _write_zeros(path, size)
        raise


def _write_zeros(path: Path, count: int) -> None:
    zeros = memoryview(bytes(2**20))
    with path.open("r+b", buffering=0) as file:
        while count > 0:
            count -= file.write(zeros[:count])


def most_bytes_of_a_file() -> int | None:
    """Return the largest size in bytes that this process may give a file (`ulimit -f`); None: there is no limit."""
    try:
        import resource
    except ImportError:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return None if limit == resource.RLIM_INFINITY else limit


def sync_folder(folder: str | Path, /) -> None:
    """Sync a folder, which holds the names of its files, to the disk, if the system and the file system can do so."""
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
    """Remove an open file, if possible, and close it; it is closed first on a system that cannot remove open files.

    Nobody needs the file, so nothing is raised, also if its network share is gone, where even closing a file fails.
    """
    remove, close = path.unlink, partial(os.close, descriptor)
    for step in (remove, close) if REMOVES_OPEN_FILES else (close, remove):
        with suppress(OSError):
            step()


def try_lock(descriptor: int, /) -> bool:
    """Lock an open file until this process ends; return False if another process holds the lock.

    If the file system has no locks, return True without a lock.
    """
    try:
        try:
            import fcntl
        except ImportError:
            os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
            msvcrt = import_module("msvcrt")
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _LOCKED_BYTE)
    except OSError as error:
        return error.errno not in {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
    return True
