"""The frames of a capture, from files of whatever format: whole frames, stacks, or files of one plane each."""

import itertools
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.errors import FrameError
from cadtof_cli.files.formats import format_of, suffix_format
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, lone_frame, shape_text
from cadtof_cli.files.reading import is_there
from cadtof_cli.records import dataclass

_SIZES_LOOKED_AT, _FILES_OPENED = 1000, 15
"""How many of a capture's files, spread evenly over it, tell what is usual by their bytes and by what they hold."""


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
    with format_of(path, raw=layout.raw is not None).frames().open_frames(path, layout) as frames:
        yield frames


def _joined_planes(source: FrameSource, layout: FrameLayout) -> Frames:
    """Return the frame that files of one plane each make up."""
    if len(source.paths) != layout.planes:
        raise FrameError(f"frame {source.name}: found {len(source.paths)} files, expected {layout.planes}")
    for path, name in zip(source.paths, layout.plane_names, strict=True):
        if not is_there(path):
            raise FrameError(f"{path}: no such file, expected {name} of frame {source.name} there")
    planes = [format_of(path, raw=layout.raw is not None).frames().read_plane(path, layout) for path in source.paths]
    first = planes[0]
    for path, plane in zip(source.paths, planes, strict=True):
        if plane.shape != first.shape or plane.dtype != first.dtype:
            raise FrameError(
                f"{path}: found {shape_text(plane.shape, plane.dtype)}, expected"
                f" {shape_text(first.shape, first.dtype)} as in {source.paths[0].name}"
            )
    stored = np.stack(planes).reshape(len(layout.harmonics), CHANNELS, *first.shape)
    return lone_frame(stored)


def read_stored(source: FrameSource, layout: FrameLayout, /, *, usual: tuple[int, int] | None = None) -> Stored:
    """Return a frame as it is stored, (H, C, Y, X).

    Raises:
        NotAFrameError, FrameError: see `open_frames`; or its file holds several where the source names none, or it has another
            (Y, X) than is usual in its capture.
    """
    with open_frames(source, layout) as frames:
        if source.index is None and frames.count != 1:
            raise FrameError(f"{source}: found {frames.count} frames, expected one as in files of the same size")
        stored: Stored = frames.read(source.index or 0)
    found = stored.shape[2:]
    if usual is not None and found != usual:
        here, there = ("{1} × {0}".format(*size) for size in (found, usual))
        raise FrameError(f"{source}: found {here} pixels, expected {there} as most frames of the capture have")
    return stored


def single_frames(capture: Capture, /, *, taken: Collection[str] = ()) -> Iterator[FrameSource]:
    """Yield every frame of a capture, a stack's one by one, none under a name that is `taken` by another capture's.

    Opening each of thousands of files beforehand would cost as much as reading them, so a file of the very size of one that
    held a single frame is taken to hold one too (its reader checks). A file that cannot be opened is yielded as it is: it
    fails when its turn comes.
    """
    layout, names = capture.layout, taken or {source.name for source in capture.frames}
    size_of_one = 0
    for source in capture.frames:
        path = source.paths[0]
        named = suffix_format(path)
        may_be_stack = len(source.paths) == 1 and (named is None or named.stacks)
        size = file_size(path) if may_be_stack else 0
        if not size or size == size_of_one:
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


@dataclass(frozen=True)
class UsualFile:
    """A file such as most of a capture are: (Y, X) and type of its frames, how many they are, and its size."""

    pixels: tuple[int, int]
    dtype: np.dtype[Any]
    frames: int
    bytes: int


def usual_file(capture: Capture, /) -> UsualFile | None:
    """Return what most of the files hold that can be opened; None where none can.

    Files of as many bytes hold frames of one size, so it is enough to open one of the most common. Where no size is common, as
    with compressed files, a few are opened that are spread over the capture.
    """
    looked_at = list(capture.frames[:: -(-len(capture.frames) // _SIZES_LOOKED_AT)])
    sizes = [file_size(source.paths[0]) for source in looked_at]
    common, count = Counter(sizes).most_common(1)[0]
    if 2 * count > len(sizes):
        alike = (source for source, size in zip(looked_at, sizes, strict=True) if size == common)
        for source in itertools.islice(alike, _FILES_OPENED):
            if (found := _opened(source, capture.layout)) is not None:
                return found
    known = list(_openable(looked_at[:: -(-len(looked_at) // _FILES_OPENED)], capture.layout))
    known = known or list(itertools.islice(_openable(capture.frames, capture.layout), 1))
    if not known:
        return None
    usual, _ = Counter(one.pixels for one in known).most_common(1)[0]
    return next(one for one in known if one.pixels == usual)


def _opened(source: FrameSource, layout: FrameLayout) -> UsualFile | None:
    try:
        with open_frames(source, layout) as frames:
            return UsualFile((frames.shape[2], frames.shape[3]), frames.dtype, frames.count, file_size(source.paths[0]))
    except FrameError:
        return None


def _openable(sources: Iterable[FrameSource], layout: FrameLayout) -> Iterator[UsualFile]:
    """Yield what each file holds that can be opened."""
    for source in sources:
        found = _opened(source, layout)
        if found is not None:
            yield found


def file_size(path: Path, /) -> int:
    """Return the size of a file in bytes, 0 where it cannot be told."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
