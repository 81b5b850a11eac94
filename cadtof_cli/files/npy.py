"""Frames and planes in NPY files. The array is mapped into memory, so only the frame that is asked for is read."""

import os
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from numpy.lib.format import MAGIC_PREFIX

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.array_frames import Mapped, lengths_text, open_array, single_plane
from cadtof_cli.files.frames import FrameLayout, Frames
from cadtof_cli.files.reading import damage_as_frame_error, open_regular

_LONGEST_HEADER = 1000
"""Most bytes of a header that gives type and shape. The time to parse a header grows with the square of its length."""

_LOOKED_AT_AFTER = 4096
"""Number of bytes after the array that are looked at; a device that writes whole blocks leaves zeros there."""


def open_frames(path: Path, layout: FrameLayout, /) -> AbstractContextManager[Frames]:
    """Open a file whose array has the axes [T] H C Y X, or [T·]2·H Y X."""
    return open_array(path, _mapped(path), layout, mended_by=("numpy.save(PATH, numpy.load(PATH)", ")"))


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of a file, shape (Y, X)."""
    return single_plane(path, _mapped(path))


def _mapped(path: Path) -> Mapped:
    with damage_as_frame_error(path, "NPY"):
        try:
            array: Mapped = np.load(path, mmap_mode="r", allow_pickle=False, max_header_size=_LONGEST_HEADER)
        except ValueError as error:
            if "Python objects" not in str(error):
                raise
            raise FrameError(
                f"{path}: found an array of Python objects, expected one of numbers: save it with its dtype, such as by"
                " numpy.save(PATH, numpy.asarray(FRAME, numpy.float32))"
            ) from error
        with os.fdopen(open_regular(path), "rb") as file:
            file.seek(array.offset + array.nbytes)
            after = file.read(_LOOKED_AT_AFTER)
        if after.startswith(MAGIC_PREFIX):
            raise FrameError(
                f"{path}: found several arrays, one after the other, expected one: numpy.save(PATH, numpy.stack(FRAMES))"
            )
        if any(after):
            raise FrameError(
                f"{path}: found further values after the array of {lengths_text(array.shape)} that its header describes, so the"
                " header is damaged, or the values were added later; expected a file that ends with its array"
            )
        return array
