"""Frames from files, whatever their form: the first bytes of a file say which reader it needs."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.capture.planes import PlaneFrames
from cadtof_cli.files.formats import FileState, container_of
from cadtof_cli.files.frames import FrameLayout, Frames, FrameSource

if TYPE_CHECKING:
    from cadtof_cli.files.tiff.frames import TiffFrames


@contextmanager
def open_frames(source: FrameSource, layout: FrameLayout) -> Iterator[Frames]:
    """Open the file, or the files of single planes, in which a frame lies.

    Parameters:
        source: where the frame lies.
        layout: how the capture's files are laid out.

    Returns:
        The frames of the file; where there are several and the source names none, it was a stack all along.

    Raises:
        NotAFrameError: the file is sound but holds something else, such as a map.
        FrameError: the file cannot be read, is damaged, or lacks a harmonic or channel.
    """
    if len(source.paths) > 1:
        yield PlaneFrames(source, layout)
        return
    path = source.paths[0]
    container, state = container_of(path)
    if container == "exr":
        from cadtof_cli.files.exr.frames import ExrFrames

        yield ExrFrames(path, layout)
        return
    with _tiff_frames(path, layout, state) as frames:
        yield frames


@dataclass(frozen=True)
class _Stack:
    """A stack whose pages are known; its file is closed between frames."""

    key: tuple[object, ...]
    frames: "TiffFrames"


_last = threading.local()


@contextmanager
def _tiff_frames(path: Path, layout: FrameLayout, state: FileState) -> Iterator[Frames]:
    """Open a TIFF file; a worker that takes a stack frame by frame finds its thousands of pages once."""
    from cadtof_cli.files.tiff.frames import TiffFrames

    key = (path, layout, state)
    stack: _Stack | None = getattr(_last, "stack", None)
    frames = stack.frames if stack and stack.key == key else TiffFrames(path, layout)
    _last.stack = _Stack(key, frames) if frames.count > 1 else None
    with frames:
        yield frames
