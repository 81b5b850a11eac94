"""Frames in the one array of a file, and numpy calls that bring axes into the right order."""

import itertools
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, SAMPLE_TYPES, FrameLayout, Frames, shape_text
from cadtof_cli.files.plane_table import plane_table
from cadtof_cli.files.reading import damage_as_frame_error, open_regular
from cadtof_cli.files.system import read_parts

_OURS = {3: ("PYX",), 4: ("HCYX", "TPYX"), 5: ("THCYX",)}
"""Orders of axes that we read, by the number of axes.

T is the frame, H the harmonic, C the channel; P is one axis for harmonic and channel together.
"""

_NAMED = 2
"""The most orders of axes that a message names with rows first, and the most with columns first.

With two harmonics, H and C have the same length, so two orders are possible.
"""


@dataclass(frozen=True)
class ArrayInFile:
    """Where the array of a file begins, in bytes, and what it holds; it is C-contiguous, or in Fortran order.

    It holds no open file and maps none into memory: Windows could not replace such a file, even after an error whose
    traceback is kept.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    offset: int
    c_contiguous: bool = True

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)


@contextmanager
def open_array(
    path: Path, array: ArrayInFile, layout: FrameLayout, /, *, mended_by: tuple[str, str]
) -> Iterator[Frames]:
    """Yield the frames of an array that a file holds. Each frame is read from the file when it is asked for.

    Args:
        path: the file that holds the array.
        array: of shape (…, Y, X). The axes before Y and X are [frame,] harmonic, channel in this order; harmonic and
            channel may be a single axis.
        layout: harmonics of the capture, and the number of frames in a stack if the metadata gives it.
        mended_by: the Python call that saves the array in our order of axes: the parts before and after the place of
            the transposition. Messages show it.
    """
    require_planes(path, array)
    where = f"{path}: found {math.prod(array.shape[:-2])} planes of {shape_text(array.shape, array.dtype)}"
    try:
        table = plane_table("Q" * (len(array.shape) - 2), array.shape[:-2], layout, where=where)
    except FrameError:
        ways = transpositions(mended_by, array.shape, len(layout.harmonics))
        if not ways:
            raise
        raise FrameError(
            f"{path}: found an array of {lengths_text(array.shape)}, expected axes [T] H C Y X, rows and columns last; {ways}"
        ) from None
    shape = (len(layout.harmonics), CHANNELS, *array.shape[-2:])

    def read(index: int) -> Stored:
        return _planes(path, array, table[index].ravel()).reshape(shape)

    yield Frames(len(table), shape, array.dtype.newbyteorder("="), read)


def single_plane(path: Path, array: ArrayInFile, /) -> Stored:
    """Return the one plane of an array, shape (Y, X), native byte order."""
    require_planes(path, array)
    if array.size != array.shape[-2] * array.shape[-1]:
        raise FrameError(f"{path}: found an array of {lengths_text(array.shape)}, expected a single plane")
    plane: Stored = _planes(path, array, np.zeros(1, np.intp))[0]
    return plane


def _planes(path: Path, array: ArrayInFile, indices: NDArray[np.intp]) -> Stored:
    """Return planes by their index in the file, native byte order, shape (n, Y, X), C-contiguous.

    The pixels are read from the file, not taken from mapped memory. If the file is cut off meanwhile, or the disk fails,
    access to mapped memory would make the system end the process.
    """
    in_order = array.c_contiguous
    size = array.shape[-2] * array.shape[-1]
    found = np.empty((indices.size, size) if in_order else (1, array.size), array.dtype)
    begins = indices * size if in_order else (0,)
    with damage_as_frame_error(path, "array"), os.fdopen(open_regular(path), "rb", buffering=0) as file:
        for begin, part in zip(begins, found, strict=True):
            file.seek(array.offset + int(begin) * array.dtype.itemsize)
            if not read_parts(file.fileno(), [part.view(np.uint8).data]):
                raise FrameError(f"{path}: was cut off or replaced while it was read; expected a complete file")
    if not in_order:
        # Fortran order: the first axis varies fastest
        found = found.reshape(array.shape, order="F").reshape(-1, size)[indices]
    return np.ascontiguousarray(found.reshape(-1, *array.shape[-2:]), array.dtype.newbyteorder("="))


def require_planes(path: Path, array: ArrayInFile, /) -> None:
    """Raise FrameError unless an array holds planes, of one of the `SAMPLE_TYPES`."""
    if array.dtype.name not in SAMPLE_TYPES:
        raise FrameError(f"{path}: found values of type {array.dtype}, expected one of {', '.join(SAMPLE_TYPES)}")
    if len(array.shape) < 2 or not array.size:
        raise FrameError(f"{path}: found an array of {lengths_text(array.shape)}, expected planes (…, Y, X)")


def lengths_text(shape: Sequence[int], /) -> str:
    """Return the lengths of an array's axes for a message."""
    return " × ".join(map(str, shape)) or "one value"


def transpositions(call: tuple[str, str], shape: Sequence[int], harmonics: int, /) -> str:
    """Return, in words for a message, the calls that bring an array of this shape into our order of axes.

    The shape tells which orders of axes the array may have: rows and columns are neighbours, and each is longer than
    the number of planes in a frame. Columns may come first, as MATLAB stores them; that is considered only if the array
    would then have more columns than rows. The text is empty if the array may already be in our order, or if no frame
    can have this shape. `call` is a Python call that saves the array: the parts before and after the place of the
    transposition.
    """
    lengths = {"H": harmonics, "C": CHANNELS, "P": CHANNELS * harmonics}

    def may_be(axis: str, size: int) -> bool:
        return size == lengths[axis] if axis in lengths else size > lengths["P"] or axis == "T"

    found = [
        (axes, tuple(axes.index(axis) for axis in ours))
        for ours in _OURS.get(len(shape), ())
        for axes in map("".join, itertools.permutations(ours))
        if ("YX" in axes or "XY" in axes) and all(map(may_be, axes, shape))
    ]
    if any(order == tuple(range(len(shape))) for _, order in found):
        return ""
    found.sort(key=lambda one: -one[0].index("X"))
    columns_first = [one for one in found if "XY" in one[0] and shape[one[0].index("X")] > shape[one[0].index("Y")]]
    rows_first = [one for one in found if "YX" in one[0]]
    planes = str(lengths["P"])
    return "; ".join(
        f"if its axes are {' '.join(axes).replace('P', planes)}: {call[0]}.transpose{order}{call[1]}"
        for axes, order in columns_first[:_NAMED] + rows_first[:_NAMED]
    )
