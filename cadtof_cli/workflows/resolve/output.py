"""The output folder of a run: one run at a time writes into it, and every frame has a file of its own in it.

It is no folder of recorded frames.
"""

import contextlib
import json
import os
import platform
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from datetime import UTC, datetime
from pathlib import Path

from cadtof_cli.capture.frames import Capture
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import OutputError
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at, remove_and_close, try_lock
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.run_json import RUN_FILE

LOCK_FILE = ".cadtof.lock"

_HELD: set[tuple[int, int]] = set()
"""Folders that this process has locked: the system's locks work between processes only."""


@dataclass
class MapNames:
    """The names of the maps of a run, and the recorded file that each map is made from.

    Attributes:
        out: folder of the run.
        files: the first file of each frame, by the name of its map, and by `same` of this name.
        same: gives names of the same file in `out` the same value.
    """

    out: Path
    files: dict[str, Path] = field(default_factory=dict)
    same: Callable[[str], str] = str

    def take(self, name: str, file: Path, /) -> Path:
        """Take a name for the map of a recorded file, and return the file that has it: another one if the name was taken."""
        owner = self.files.setdefault(self.same(name), file)
        return self.files.setdefault(name, owner)

    def taken(self) -> Collection[str]:
        """Return the names that no frame of a stack may get."""
        return self.files.keys()

    def folders(self) -> set[str]:
        """Return the folders of the maps below the folder of the run."""
        return {name.rpartition("/")[0] for name in self.files} - {""}

    def tell_letters_apart(self) -> None:
        """Make sure that names differ also where capital and small letters are the same in names of files.

        The run must hold the lock of the folder.

        Raises:
            OutputError: two frames would be written to one file.
        """
        if (self.out / LOCK_FILE.upper()).exists():
            known, self.files, self.same = self.files, {}, str.lower
            self.require_different(known.items(), ", because capital and small letters are the same there")

    def require_different(self, named: Iterable[tuple[str, Path]], because: str = "", /) -> None:
        """Add names with their recorded files; raises OutputError if two frames would be written to one file."""
        for name, file in named:
            if (other := self.take(name, file)) is not file:
                raise OutputError(
                    f"{other} and {file} would both be written as {self.out}/{name}{because}; "
                    "resolve them into folders of their own, one command each"
                )


def map_names(captures: Sequence[Capture], out: Path, /) -> MapNames:
    """Return the names of the maps of captures, after making sure that each frame has an output file of its own.

    Raises:
        OutputError: the output folder is the folder of a capture; or two frames would be written to one file; or a folder
            below belongs to another run, or is a link that leads out of the output folder.
    """
    if os.path.lexists(out / CAPTURE_FILE) or real_path(out) in {real_path(capture.root) for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    names = MapNames(out)
    names.require_different((frame.name, frame.paths[0]) for capture in captures for frame in capture.frames)
    for folder in sorted(names.folders()):
        require_inside(out, out / folder)
        if os.path.lexists(out / folder / RUN_FILE):
            raise OutputError(
                f"{out / folder}: holds a run of its own; move it elsewhere, or choose another folder with -o"
            )
    return names


def require_inside(out: Path, folder: Path, /) -> None:
    """Raise OutputError if a folder of maps does not lie in the output folder, because a link below it leads elsewhere."""
    if not Path(real_path(folder)).is_relative_to(real_path(out)):
        raise OutputError(
            f"{folder}: is a link to {real_path(folder)}, and maps are written only inside {out}; remove the link, or choose "
            "another folder with -o"
        )


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
            _close(descriptor)
            raise OutputError(f"{folder}: {owner}; wait until it ends, or choose another folder with -o")
        with contextlib.suppress(OSError):
            # its last owner may have removed the file before we got the lock
            if os.path.samestat(os.fstat(descriptor), path.lstat()):
                return descriptor
        _close(descriptor)


def _close(descriptor: int) -> None:
    # a network share reports here that it lost what the last owner wrote
    with contextlib.suppress(OSError):
        os.close(descriptor)


def _owner(descriptor: int) -> str:
    try:
        owner = json.loads(read_at(descriptor, 4096, 0))
        return f"process {owner['pid']} on {owner['host']} has been writing into it since {owner['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process is writing into it"
