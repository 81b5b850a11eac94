"""Frames in one array, mapped into memory from a file."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.array_axes import transpositions
from cadtof_cli.files.frames import CHANNELS, SAMPLE_TYPES, FrameLayout, Frames, shape_text
from cadtof_cli.files.plane_table import plane_table


@contextmanager
def open_array(path: Path, array: Stored, layout: FrameLayout, /, *, mended_by: str | None = None) -> Iterator[Frames]:
    """Yield the frames of an array whose last axes are Y and X, read one by one from a file that is mapped into memory.

    Parameters:
        path: the file, for messages.
        array: shape (…, Y, X); the axes before come in the order [frame,] harmonic, channel, the last two perhaps as one.
        layout: harmonics of the capture, and frames of a stack where the metadata says it.
        mended_by: the call that saves the array in another order of axes, with `{}` where it is transposed; None: there is none.

    Raises:
        FrameError: the planes do not make up whole frames, or are of a type that we do not read.
    """
    require_planes(path, array)
    where = f"{path}: found {array[..., 0, 0].size} planes of {shape_text(array.shape, array.dtype)}"
    try:
        table = plane_table("Q" * (array.ndim - 2), array.shape[:-2], layout, where=where)
    except FrameError:
        ways = mended_by and transpositions(mended_by, array.shape, len(layout.harmonics))
        if not ways:
            raise
        raise FrameError(
            f"{path}: found an array of {_size_text(array.shape)}, expected axes [T] H C Y X, rows and columns last; {ways}"
        ) from None
    planes, dtype = array.reshape(-1, *array.shape[-2:]), array.dtype.newbyteorder("=")
    shape = (len(layout.harmonics), CHANNELS, *array.shape[-2:])

    def read(index: int = 0, /) -> Stored:
        return np.ascontiguousarray(planes[table[index].ravel()], dtype).reshape(shape)

    yield Frames(len(table), shape, dtype, read)


def single_plane(path: Path, array: Stored, /) -> Stored:
    """Return the one plane of an array, shape (Y, X), native byte order.

    Raises:
        FrameError: it holds more than one.
    """
    require_planes(path, array)
    if array.size != array.shape[-2] * array.shape[-1]:
        raise FrameError(f"{path}: found an array of {_size_text(array.shape)}, expected a single plane")
    return np.ascontiguousarray(array.reshape(array.shape[-2:]), array.dtype.newbyteorder("="))


def require_planes(path: Path, array: Stored, /) -> None:
    """Make sure that an array has planes of a type that we read."""
    if array.dtype.name not in SAMPLE_TYPES:
        raise FrameError(f"{path}: found values of type {array.dtype}, expected one of {', '.join(SAMPLE_TYPES)}")
    if array.ndim < 2 or not array.size:
        raise FrameError(f"{path}: found an array of {_size_text(array.shape)}, expected planes (…, Y, X)")


def _size_text(shape: Sequence[int]) -> str:
    return " × ".join(map(str, shape)) or "one value"
