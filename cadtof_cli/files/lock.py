"""A lock on a folder that is written into: held by one process of all that share the file system, and gone when that ends."""

import contextlib
import errno
import fcntl
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from cadtof_cli.errors import OutputError

LOCK_FILE = ".cadtof.lock"

_HELD: set[tuple[int, int]] = set()
"""Folders that this process holds: the system's locks are between processes."""


@contextmanager
def locked(folder: Path, /) -> Iterator[None]:
    """Keep every other run out of a folder.

    A file in it carries the lock and says whose it is. The lock is the process's own (`fcntl`), so that neither its end, however
    sudden, nor a worker that outlives it leaves the folder locked. Where the file system has no locks there is none.

    Raises:
        OutputError: somebody else holds it, who is named; or the file cannot be made.
    """
    place = folder.stat()
    held = (place.st_dev, place.st_ino)
    if held in _HELD:
        raise OutputError(
            f"{folder}: this process ({os.getpid()}) is writing into it already; choose another folder with -o"
        )
    path = folder / LOCK_FILE
    descriptor = _locked_file(folder, path)
    _HELD.add(held)
    try:
        with contextlib.suppress(OSError):
            owner = {
                "pid": os.getpid(),
                "host": platform.node(),
                "since": datetime.now(UTC).isoformat(timespec="seconds"),
            }
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, json.dumps(owner).encode(), 0)
        yield
    finally:
        _HELD.discard(held)
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _locked_file(folder: Path, path: Path) -> int:
    """Return the descriptor of the file, locked."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in {errno.EACCES, errno.EAGAIN}:
                owner = _owner(descriptor)
                os.close(descriptor)
                raise OutputError(f"{folder}: {owner}; wait until it ends, or choose another folder with -o") from error
        with contextlib.suppress(OSError):
            # whoever held it may have removed the file just before it came to us
            if os.path.samestat(os.fstat(descriptor), path.lstat()):
                return descriptor
        os.close(descriptor)


def _owner(descriptor: int) -> str:
    try:
        owner = json.loads(os.pread(descriptor, 4096, 0))
        return f"process {owner['pid']} on {owner['host']} has been writing into it since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process is writing into it"
