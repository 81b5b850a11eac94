"""The lock of a run's folder: only one run at a time may write into it."""

import contextlib
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from cadtof_cli.errors import OutputError
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at, remove_and_close, try_lock

LOCK_FILE = ".cadtof.lock"

_HELD: set[tuple[int, int]] = set()
"""Folders that this process has locked: the system's locks work between processes only."""


@contextmanager
def locked(folder: Path, /) -> Iterator[None]:
    """Lock a folder against other runs.

    A file in the folder carries the lock and names its owner. The lock belongs to this process alone: the folder is free when
    the process ends, even if the process is killed or a worker outlives it. On a file system without locks nothing is locked.

    Raises:
        OutputError: another run holds the lock, and the message names its process; or the file cannot be made.
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
    """Return the descriptor of the lock file, locked."""
    while True:
        try:
            descriptor = os.open(path, OPEN_OR_CREATE_FLAGS, 0o666)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
        if not try_lock(descriptor):
            owner = _owner(descriptor)
            os.close(descriptor)
            raise OutputError(f"{folder}: {owner}; wait until it ends, or choose another folder with -o")
        with contextlib.suppress(OSError):
            # its last owner may have removed the file before we got the lock
            if os.path.samestat(os.fstat(descriptor), path.lstat()):
                return descriptor
        os.close(descriptor)


def _owner(descriptor: int) -> str:
    try:
        owner = json.loads(read_at(descriptor, 4096, 0))
        return f"process {owner['pid']} on {owner['host']} has been writing into it since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process is writing into it"
