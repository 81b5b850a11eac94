"""Trees of folders: which `capture.toml` holds for a folder, what lies below it, and where its maps go below OUT."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from cadtof_cli.capture.frame_sources import FilesAsFrames, FrameSource, natural_key
from cadtof_cli.capture.toml import FILE_NAME
from cadtof_cli.errors import CaptureError
from cadtof_cli.files.formats import FRAME_SUFFIXES
from cadtof_cli.files.regular import is_there

WRITTEN_BY_US = frozenset({"run.json", "dark.toml", "response.toml", "petzval.toml"})
"""Files that make a folder one of maps, or a calibration: nothing in or below it is a recorded frame."""


def nearest_settings(folder: Path, /) -> Path | None:
    """Return the `capture.toml` that holds for a folder: its own, else that of the nearest folder above; None: there is none."""
    own = folder / FILE_NAME
    # what lies in a folder that cannot be looked into is not there for us; a link that leads nowhere is, and cannot be read
    if is_there(own):
        return own
    above = (parent / FILE_NAME for parent in absolute(folder).parents)
    return next((path for path in above if os.access(path, os.R_OK)), None)


def files_in(folder: Path, /, *, depth: int = 0, recursive: bool = False) -> list[str]:
    """Return the files that lie so many folders below a folder, by their path from there with slashes between.

    A folder that is called like a frame is among them, so that the frame fails by its name; where folders are looked into, only
    one that is empty.

    Raises:
        CaptureError: the folder cannot be listed.
    """

    def stands_for_a_frame(name: str) -> bool:
        return name.lower().endswith(FRAME_SUFFIXES) and not (recursive and any(_entries(folder / name, 0)))

    return [name for name, is_folder in _entries(folder, depth) if not is_folder or stands_for_a_frame(name)]


def folders_in(folder: Path, /) -> list[Path]:
    """Return the folders in a folder, in natural order, without hidden ones."""
    names = (name for name, is_folder in _entries(folder, 0) if is_folder and not name.startswith("."))
    return [folder / name for name in sorted(names, key=natural_key)]


def _entries(folder: Path, depth: int) -> Iterator[tuple[str, bool]]:
    try:
        with os.scandir(folder) as entries:
            found = [(entry.name, _is_folder(entry)) for entry in entries]
    except PermissionError as error:
        raise CaptureError(f"{folder}: no permission to list this folder; expected one that can be read") from error
    except OSError as error:
        raise CaptureError(f"{folder}: cannot be listed: {error.strerror}") from error
    if depth == 0:
        yield from found
        return
    for name, is_folder in found:
        if is_folder and not name.startswith("."):
            yield from ((f"{name}/{below}", inner) for below, inner in _entries(folder / name, depth - 1))


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        # a link that leads in a circle: whoever reads it says so
        return False


def common_folder(folders: Iterable[Path], /) -> Path:
    """Return the deepest folder that all the folders are, or lie in; links are taken as they are named."""
    return Path(os.path.commonpath([absolute(folder) for folder in folders]))


def absolute(path: Path, /) -> Path:
    """Return an absolute path without `..`."""
    return Path(os.path.normpath(path.absolute()))


def mirrored(frames: Sequence[FrameSource], root: Path, base: Path, /) -> Sequence[FrameSource]:
    """Return the frames of a folder with names that put their maps where the folder lies below `base`.

    A folder elsewhere is placed by the part of its path that it does not share with `base`.
    """
    steps = [step for step in Path(os.path.relpath(absolute(root), base)).parts if step != os.pardir]
    below = "".join(f"{step}/" for step in steps)
    if isinstance(frames, FilesAsFrames):
        return replace(frames, below=below + frames.below)
    return tuple(replace(frame, name=below + frame.name) for frame in frames)
