"""A lock on a folder that is written into: held by one process of all that share the file system, and gone when that ends."""

import contextlib
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from cadtof_cli.errors import OutputError
from cadtof_cli.files.system import KEEP, lock, read_at, remove_and_close

LOCK_FILE = ".cadtof.lock"

_HELD: set[tuple[int, int]] = set()
"""Folders that this process holds: the system's locks are between processes."""


@contextmanager
def locked(folder: Path, /) -> Iterator[None]:
    """Keep every other run out of a folder.

    A file in it carries the lock and says whose it is. The lock is the process's own, so that neither its end, however
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
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, json.dumps(owner).encode())
        yield
    finally:
        _HELD.discard(held)
        remove_and_close(path, descriptor)


def _locked_file(folder: Path, path: Path) -> int:
    """Return the descriptor of the file, locked."""
    while True:
        try:
            descriptor = os.open(path, KEEP, 0o666)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
        if not lock(descriptor):
            owner = _owner(descriptor)
            os.close(descriptor)
            raise OutputError(f"{folder}: {owner}; wait until it ends, or choose another folder with -o")
        with contextlib.suppress(OSError):
            # whoever held it may have removed the file just before it came to us
            if os.path.samestat(os.fstat(descriptor), path.lstat()):
                return descriptor
        os.close(descriptor)


def _owner(descriptor: int) -> str:
    try:
        owner = json.loads(read_at(descriptor, 4096, 0))
        return f"process {owner['pid']} on {owner['host']} has been writing into it since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process is writing into it"
