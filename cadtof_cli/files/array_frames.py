"""Frames and planes in the one array of a file, each read when it is asked for."""

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
from cadtof_cli.files.axis_orders import transpositions
from cadtof_cli.files.frames import CHANNELS, SAMPLE_TYPES, FrameLayout, Frames, shape_text
from cadtof_cli.files.plane_table import plane_table
from cadtof_cli.files.reading import damage_as_frame_error, open_regular
from cadtof_cli.files.system import read_parts
from cadtof_cli.units import counted


@dataclass(frozen=True)
class ArrayInFile:
    """The array of a file: where it begins, in bytes, and what it holds; it is C-contiguous, or in Fortran order.

    Its shape is (…, Y, X). It holds no open file and maps none into memory: Windows could not replace such a file, even
    after an error whose traceback is kept.
    """

    path: Path
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    offset: int
    c_contiguous: bool = True

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    def require_planes(self) -> None:
        """Raise FrameError unless the array holds planes, of one of the `SAMPLE_TYPES`."""
        if self.dtype.name not in SAMPLE_TYPES:
            raise FrameError(
                f"{self.path}: found values of type {self.dtype}, expected one of {', '.join(SAMPLE_TYPES)}"
            )
        if len(self.shape) < 2 or not self.size:
            raise FrameError(f"{self.path}: found an array of {lengths_text(self.shape)}, expected planes (…, Y, X)")

    def planes(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their index in the file, native byte order, shape (n, Y, X), C-contiguous.

        The pixels are read from the file, not taken from mapped memory. If the file is cut off meanwhile, or the disk fails,
        access to mapped memory would make the system end the process.
        """
        in_order = self.c_contiguous
        size = self.shape[-2] * self.shape[-1]
        found = np.empty((indices.size, size) if in_order else (1, self.size), self.dtype)
        begins = indices * size if in_order else (0,)
        with damage_as_frame_error(self.path, "array"), os.fdopen(open_regular(self.path), "rb", buffering=0) as file:
            for begin, part in zip(begins, found, strict=True):
                file.seek(self.offset + int(begin) * self.dtype.itemsize)
                if not read_parts(file.fileno(), [part.view(np.uint8).data]):
                    raise FrameError(
                        f"{self.path}: was cut off or replaced while it was read; expected a complete file"
                    )
        if not in_order:
            # Fortran order: the first axis varies fastest
            found = found.reshape(self.shape, order="F").reshape(-1, size)[indices]
        return np.ascontiguousarray(found.reshape(-1, *self.shape[-2:]), self.dtype.newbyteorder("="))


@contextmanager
def open_array(array: ArrayInFile, layout: FrameLayout, /, *, mended_by: tuple[str, str]) -> Iterator[Frames]:
    """Yield the frames of an array that a file holds. Each frame is read from the file when it is asked for.

    Args:
        array: its axes before Y and X are [frame,] harmonic, channel in this order; harmonic and channel may be a single
            axis.
        layout: harmonics of the capture, and the number of frames in a stack if the metadata gives it.
        mended_by: the Python call that saves the array in our order of axes: the parts before and after the place of
            the transposition. Messages show it.
    """
    array.require_planes()
    outer, size = array.shape[:-2], array.shape[-2:]
    where = f"{array.path}: found {counted(math.prod(outer), 'plane')} of {shape_text(size, array.dtype)}"
    try:
        table = plane_table("Q" * len(outer), outer, layout, where=where)
    except FrameError:
        ways = transpositions(mended_by, array.shape, len(layout.harmonics))
        if not ways:
            raise
        raise FrameError(
            f"{array.path}: found an array of {lengths_text(array.shape)}, expected axes [T] H C Y X, rows and columns last;"
            f" {ways}"
        ) from None
    shape = (len(layout.harmonics), CHANNELS, *size)

    def read(index: int) -> Stored:
        return array.planes(table[index].ravel()).reshape(shape)

    yield Frames(len(table), shape, array.dtype.newbyteorder("="), read)


def single_plane(array: ArrayInFile, /) -> Stored:
    """Return the one plane of an array, shape (Y, X), native byte order."""
    array.require_planes()
    if array.size != array.shape[-2] * array.shape[-1]:
        raise FrameError(f"{array.path}: found an array of {lengths_text(array.shape)}, expected a single plane")
    plane: Stored = array.planes(np.zeros(1, np.intp))[0]
    return plane


def lengths_text(shape: Sequence[int], /) -> str:
    """Return the lengths of an array's axes for a message."""
    return " × ".join(map(str, shape)) or "one value"
