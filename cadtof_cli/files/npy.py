"""Frames and planes in NPY files. Only the frame that is asked for is read."""

import os
from contextlib import AbstractContextManager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib.format import MAGIC_PREFIX, read_array_header_1_0, read_array_header_2_0, read_magic

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.array_frames import ArrayInFile, lengths_text, open_array, single_plane
from cadtof_cli.files.frames import FrameLayout, Frames
from cadtof_cli.files.reading import damage_as_frame_error, open_regular

_LONGEST_HEADER = 1000
"""Most bytes of a header that gives type and shape. The time to parse a header grows with the square of its length."""

_HEADERS = {(1, 0): read_array_header_1_0, (2, 0): read_array_header_2_0, (3, 0): read_array_header_2_0}
"""Readers of headers, by version of the format; 3.0 differs from 2.0 only in the names of fields, which no frame has."""

_LOOKED_AT_AFTER = 4096
"""Number of bytes after the array that are looked at; a device that writes whole blocks leaves zeros there."""


def open_frames(path: Path, layout: FrameLayout, /) -> AbstractContextManager[Frames]:
    """Open a file whose array has the axes [T] H C Y X, or [T·]2·H Y X."""
    return open_array(_array(path), layout, mended_by=("numpy.save(PATH, numpy.load(PATH)", ")"))


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of a file, shape (Y, X)."""
    return single_plane(_array(path))


def read_header(file: IO[bytes], /) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the header of the array that begins where a file is now: return shape, whether in Fortran order, and type.

    Raise ValueError if the version of the format is unknown, or the header is damaged.
    """
    version = read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"found version {version[0]}.{version[1]} of the format, expected one up to 3.0")
    return _HEADERS[version](file, max_header_size=_LONGEST_HEADER)


def _array(path: Path) -> ArrayInFile:
    with damage_as_frame_error(path, "NPY"), os.fdopen(open_regular(path), "rb") as file:
        shape, fortran, dtype = read_header(file)
        array = ArrayInFile(path, shape, dtype, file.tell(), not fortran)
        if dtype.hasobject:
            raise FrameError(
                f"{path}: found an array of Python objects, expected one of numbers: save it with its dtype, such as by"
                " numpy.save(PATH, numpy.asarray(FRAME, numpy.float32))"
            )
        found, end = file.seek(0, os.SEEK_END), array.offset + array.size * dtype.itemsize
        if found < end or min(shape, default=0) < 0:
            raise ValueError(f"found {found:,} bytes, expected {end:,} for an array of {lengths_text(shape)}")
        file.seek(end)
        after = file.read(_LOOKED_AT_AFTER)
        if after.startswith(MAGIC_PREFIX):
            raise FrameError(
                f"{path}: found several arrays, one after the other, expected one: call numpy.load for each of them, with the "
                "same open file, then numpy.save(PATH, numpy.stack(FRAMES))"
            )
        if any(after):
            raise FrameError(
                f"{path}: found further values after the array of {lengths_text(array.shape)} that its header describes, so the"
                " header is damaged, or the values were added later; expected a file that ends with its array"
            )
        return array
