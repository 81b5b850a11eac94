"""Frames and planes in NPY files, the arrays of numpy: (H, C, Y, X), or (Y, X) for one plane."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.damage import damage_as_frame_error
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, LoneFrame


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Read the frame in one NPY file."""
    stored = _array(path)
    if stored.shape[:-2] != (len(layout.harmonics), CHANNELS):
        raise FrameError(f"{path}: found shape {stored.shape}, expected {(len(layout.harmonics), CHANNELS)} then Y, X")
    yield LoneFrame("npy", stored)


def read_plane(path: Path, /) -> Stored:
    """Return the one plane of an NPY file, shape (Y, X)."""
    plane = _array(path)
    if plane.ndim != 2:
        raise FrameError(f"{path}: found shape {plane.shape}, expected a single plane Y, X")
    return plane


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write one frame, shape (H, C, Y, X)."""
    np.save(path, stored)


def _array(path: Path) -> Stored:
    with damage_as_frame_error(path, "NPY"):
        array = np.load(path, allow_pickle=False)
        return np.ascontiguousarray(array, array.dtype.newbyteorder("="))
