"""From files to frames: which of a capture's files are stacks, found out only as far as it must be."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.reader import open_frames
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import Frames, FrameSource


def single_frames(capture: Capture, /) -> Iterator[FrameSource]:
    """Yield every frame of a capture, a stack's one by one.

    Opening each of thousands of files beforehand would cost as much as reading them, so a file of the very size of one that
    held a single frame is taken to hold one too (its reader checks). A file that cannot be opened is yielded as it is: it
    fails when its turn comes.
    """
    layout, names = capture.layout, {source.name for source in capture.frames}
    size_of_one: int | None = None
    for source in capture.frames:
        size = _size(source)
        if size is None or size == size_of_one:
            yield source
            continue
        try:
            with open_frames(source, layout) as frames:
                count = frames.count
        except FrameError:
            yield source
            continue
        if count == 1:
            size_of_one = size
            yield source
        else:
            yield from source.expanded(count, taken=names)


def first_pixels(capture: Capture, /) -> tuple[int, int] | None:
    """Return (Y, X) of the first frame that can be opened, which the others are held against; None where none can."""
    first = _first(capture)
    return None if first is None else (first.shape[2], first.shape[3])


def first_dtype(capture: Capture, /) -> np.dtype[Any] | None:
    """Return the type of the values in the first frame that can be opened; None where none can."""
    first = _first(capture)
    return None if first is None else first.dtype


def _first(capture: Capture) -> Frames | None:
    layout = capture.layout
    for source in capture.frames:
        try:
            with open_frames(source, layout) as frames:
                return frames
        except FrameError:
            continue
    return None


def _size(source: FrameSource) -> int | None:
    """Return a file's size where it could be a stack, else None: only TIFF files can."""
    path = source.paths[0]
    if len(source.paths) > 1 or path.suffix.lower() == ".exr":
        return None
    try:
        return path.stat().st_size
    except OSError:
        return None
