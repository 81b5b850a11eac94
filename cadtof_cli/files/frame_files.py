"""Files of recorded frames, and of single planes, in every format that holds them.

A file that cannot be read raises a FrameError.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.files.formats import Format, detect_format
from cadtof_cli.files.frames import FrameLayout, Frames, NotAFrameError
from cadtof_cli.units import size_text


class _LastRead(threading.local):
    """The quick way (`Frames.read_like`) in which this thread can read the next file, and the layout of the last file.

    Most files of a capture differ from the last one only in their pixels. For these, neither the format has to be
    detected nor its library called.
    """

    layout: FrameLayout | None = None
    read_like: Callable[[Path], Stored | None] | None = None


_last = _LastRead()


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Open a file of whole frames, and yield the frames in it.

    Raises:
        NotAFrameError: the file is undamaged but holds something else, such as a map.
        FrameError: the file cannot be read, is damaged, or lacks a harmonic or channel.
    """
    frames = _like_the_last(path, layout)
    if frames is not None:
        yield frames
        return
    kind = _format(path, layout)
    if not kind.whole:
        plane = kind.frames().read_plane(path, layout)
        raise NotAFrameError(
            f"{path}: holds one plane of {size_text(plane.shape)}, {8 * plane.itemsize} bits; expected {layout.planes} planes"
            f" per frame: one {kind.title} each, and their names in [layout] pattern, such as"
            f' "{{frame}}_h{{harmonic}}_sc{{channel}}.{kind.name}"'
        )
    with kind.frames().open_frames(path, layout) as frames:
        _last.layout, _last.read_like = layout, frames.read_like
        yield frames


def _like_the_last(path: Path, layout: FrameLayout) -> Frames | None:
    """Return the single frame of a file in which all but the pixels is as in the last file; None: it is another file."""
    if _last.read_like is None or layout != _last.layout or layout.raw:
        return None
    # an error is ignored here: the reader of the format finds it too and raises a better message
    with suppress(OSError, ValueError, MemoryError):
        stored = _last.read_like(path)
        return None if stored is None else Frames.of(stored, read_like=_last.read_like)
    return None


def read_plane(path: Path, layout: FrameLayout, /) -> Stored:
    """Return the one plane of a file, shape (Y, X), native byte order."""
    return _format(path, layout).frames().read_plane(path, layout)


def lossy_compression(path: Path, layout: FrameLayout, dtype: np.dtype[Any], /) -> str | None:
    """Return the name of the file's compression if it is known to change values of type `dtype`, else None."""
    kind = _format(path, layout)
    return kind.compressions().lossy_compression(path, dtype) if kind.compressions else None


def _format(path: Path, layout: FrameLayout) -> Format:
    return detect_format(path, raw=layout.raw is not None)
