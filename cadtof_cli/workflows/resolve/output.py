"""The folder that a run writes into: only one run at a time may use it, no file in it gets lost, and a run can be resumed in it
only with the same inputs and settings."""

import contextlib
import json
import os
import platform
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from cadtof_cli.capture.frames import Capture, frame_names
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import OutputError
from cadtof_cli.files.atomic import writing
from cadtof_cli.files.formats import MAP_FORMATS
from cadtof_cli.files.reading import real_path
from cadtof_cli.files.system import OPEN_OR_CREATE_FLAGS, read_at, remove_and_close, sync_folder, try_lock
from cadtof_cli.units import first_of
from cadtof_cli.workflows.resolve.record import FRAMES_FILE, place_in, remove_map
from cadtof_cli.workflows.resolve.reports import report_of
from cadtof_cli.workflows.resolve.run_json import NOT_OF_A_RUN, RUN_FILE, RunRecord, earlier_record, read_record
from cadtof_cli.workflows.resolve.settings import ResolveSettings

LOCK_FILE = ".cadtof.lock"

_HELD: set[tuple[int, int]] = set()
"""Folders that this process has locked: the system's locks work between processes only."""

_PLACE_IN_STACK = r"_\d{4,}$"


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


def require_own_places(captures: Sequence[Capture], out: Path, /) -> None:
    """Make sure that every frame has an output file of its own.

    Raises:
        OutputError: the output folder is the folder of a capture; or two frames would be written to one file; or a folder
            below belongs to another run, or is a link that leads out of the output folder.
    """
    if (out / CAPTURE_FILE).exists() or real_path(out) in {real_path(capture.root) for capture in captures}:
        raise OutputError(f"{out}: the maps would be written among recorded frames; choose another folder with -o")
    # the names within a capture differ
    if len(captures) > 1:
        _require_different(captures, out)
    below = {frame.name.rpartition("/")[0] for capture in captures for frame in capture.frames} - {""}
    for folder in sorted(below):
        require_inside(out, out / folder)
        if os.path.lexists(out / folder / RUN_FILE):
            raise OutputError(
                f"{out / folder}: holds a run of its own; move it elsewhere, or choose another folder with -o"
            )


def require_inside(out: Path, folder: Path, /) -> None:
    """Raise OutputError if a folder of maps does not lie in the output folder, because a link below it leads elsewhere."""
    if not Path(real_path(folder)).is_relative_to(real_path(out)):
        raise OutputError(
            f"{folder}: is a link to {real_path(folder)}, and maps are written only inside {out}; remove the link, or choose "
            "another folder with -o"
        )


def require_own_names(captures: Sequence[Capture], out: Path, /) -> Callable[[str], str]:
    """Make sure that every frame has an output file of its own also where capital and small letters are the same in names.

    The run must hold the lock of the folder. Return a function that gives names of the same file the same value.

    Raises:
        OutputError: two frames would be written to one file.
    """
    if not (out / LOCK_FILE.upper()).exists():
        return str
    _require_different(captures, out, str.lower, ", because capital and small letters are the same there")
    return str.lower


def _require_different(
    captures: Sequence[Capture], out: Path, same: Callable[[str], str] = str, because: str = ""
) -> None:
    named: dict[str, Path] = {}
    for frame in (frame for capture in captures for frame in capture.frames):
        name = same(frame.name)
        if name in named:
            raise OutputError(
                f"{named[name]} and {frame.paths[0]} would both be written as {out}/{frame.name}{because}; "
                "resolve them into folders of their own, one command each"
            )
        named[name] = frame.paths[0]


def earlier_run(
    captures: Sequence[Capture], document: RunRecord, /, *, settings: ResolveSettings, arriving: bool
) -> RunRecord | None:
    """Return the record of the earlier run that a run continues, after checking that no files get lost. Nothing is changed.

    None: there is no earlier run. If inputs are still `arriving`, the inputs are not compared, and metadata only
    of the captures that both runs know.

    Raises:
        OutputError: the folder holds files of a run, and neither `overwrite` nor `resume` is set; or the run to be resumed had
            other inputs or settings.
    """
    out = settings.out
    there = [] if settings.overwrite else _existing_outputs(out, captures)
    if there and not settings.resume:
        raise OutputError(
            f"{out}: {first_of(there, 3)} would be replaced; add --overwrite to replace, --resume to go on where a run "
            "stopped, or choose another folder with -o"
        )
    if not there:
        return None
    if not os.path.lexists(out / RUN_FILE):
        raise OutputError(
            f"{out}: cannot resume: found {first_of(there, 3)} and no {RUN_FILE}, so nothing tells what was resolved and how; "
            "add --overwrite, or choose another folder with -o"
        )
    return earlier_record(out, document, arriving=arriving)


def _existing_outputs(out: Path, captures: Sequence[Capture]) -> list[str]:
    """Return the files in a run's folder that the run would replace."""
    names = frame_names(captures)
    folders = {out / folder for folder in {name.rpartition("/")[0] for name in names}} | {out}
    paths = (path for folder in folders if folder.is_dir() for path in folder.iterdir())
    replaced: list[str] = []
    for file in sorted(path.relative_to(out).as_posix() for path in paths):
        stem, _, suffix = file.rpartition(".")
        is_map = suffix in MAP_FORMATS and not names.isdisjoint({stem, re.sub(_PLACE_IN_STACK, "", stem)})
        if is_map or file in {RUN_FILE, FRAMES_FILE}:
            replaced.append(file)
    return replaced


def remove_run(out: Path, /) -> None:
    """Remove the maps of an earlier run and its `frames.jsonl`. Maps that stayed would be taken for maps of the next run.

    A map is removed only if it lies in the folder and has the size that its line records. Files without a line stay.

    Raises:
        OutputError: a file cannot be removed.
    """
    path, called = out / FRAMES_FILE, out
    with contextlib.suppress(OSError, *NOT_OF_A_RUN):
        called = read_record(out).out
    with writing(path):
        if path.is_file() and not path.is_symlink():
            with path.open("rb") as lines:
                for report in map(report_of, lines):
                    if report and report.output:
                        remove_map(out, out / place_in(called, Path(report.output)), report)
        path.unlink(missing_ok=True)
        sync_folder(out)
