"""The frames of a capture, from files of whatever format: whole frames, stacks, or files of one plane each."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.errors import FrameError
from cadtof_cli.files.formats import format_of, suffix_format
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, LoneFrame, shape_text


@contextmanager
def open_frames(source: FrameSource, layout: FrameLayout, /) -> Iterator[Frames]:
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
        yield _joined_planes(source, layout)
        return
    path = source.paths[0]
    with format_of(path).frames().open_frames(path, layout) as frames:
        yield frames


def _joined_planes(source: FrameSource, layout: FrameLayout) -> LoneFrame:
    """Return the frame that files of one plane each make up."""
    if len(source.paths) != layout.planes:
        raise FrameError(f"frame {source.name}: found {len(source.paths)} files, expected {layout.planes}")
    for path, name in zip(source.paths, layout.plane_names, strict=True):
        if not path.exists():
            raise FrameError(f"{path}: no such file, expected {name} of frame {source.name} there")
    planes = [format_of(path).frames().read_plane(path) for path in source.paths]
    first = planes[0]
    for path, plane in zip(source.paths, planes, strict=True):
        if plane.shape != first.shape or plane.dtype != first.dtype:
            raise FrameError(
                f"{path}: found {shape_text(plane.shape, plane.dtype)}, expected"
                f" {shape_text(first.shape, first.dtype)} as in {source.paths[0].name}"
            )
    stored = np.stack(planes).reshape(len(layout.harmonics), CHANNELS, *first.shape)
    return LoneFrame(format_of(source.paths[0]).name, stored)


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
    first = first_frames(capture)
    return None if first is None else (first.shape[2], first.shape[3])


def first_frames(capture: Capture, /) -> Frames | None:
    """Return the first file that can be opened, closed again: shape and type of its frames; None where none can."""
    layout = capture.layout
    for source in capture.frames:
        try:
            with open_frames(source, layout) as frames:
                return frames
        except FrameError:
            continue
    return None


def _size(source: FrameSource) -> int | None:
    """Return a file's size where it could be a stack, else None: not every format has them."""
    path = source.paths[0]
    named = suffix_format(path)
    if len(source.paths) > 1 or (named is not None and not named.stacks):
        return None
    return file_size(path) or None


def file_size(path: Path, /) -> int:
    """Return the size of a file in bytes, 0 where it cannot be told."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
