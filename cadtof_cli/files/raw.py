"""Frames and planes in raw dumps. `[layout.raw]` gives type, shape and offset; the file itself tells only its size."""

import math
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.array_frames import ArrayInFile, lengths_text, open_array, single_plane
from cadtof_cli.files.frames import FrameLayout, Frames
from cadtof_cli.files.reading import damage_as_frame_error, require_regular


def open_frames(path: Path, layout: FrameLayout, /) -> AbstractContextManager[Frames]:
    """Open a dump that holds one array of shape `layout.raw.shape`, or several one after the other: a stack."""
    array = _array(path, layout)
    assert layout.raw is not None
    read = f"numpy.fromfile(PATH, {layout.raw.dtype!r}, offset={layout.raw.offset_bytes})"
    # in what MATLAB writes, the first axis varies fastest
    mended_by = f"numpy.save(NPY, {read}.reshape({array.shape}, order='C')", "), or order='F' for a dump of MATLAB"
    return open_array(array, layout, mended_by=mended_by)


def read_plane(path: Path, layout: FrameLayout, /) -> Stored:
    """Return the one plane of a dump, shape (Y, X)."""
    return single_plane(_array(path, layout))


def _array(path: Path, layout: FrameLayout) -> ArrayInFile:
    raw = layout.raw
    # without it, no file counts as a dump: see `detect_format`
    assert raw is not None
    with damage_as_frame_error(path, "raw"):
        dtype, size = np.dtype(raw.dtype), require_regular(path).st_size
        once = math.prod(raw.shape) * dtype.itemsize
        times, rest = divmod(size - raw.offset_bytes, once)
        if rest or times < 1:
            raise FrameError(
                f"{path}: found {size:,} bytes, expected {raw.offset_bytes + once:,}: {lengths_text(raw.shape)} values of"
                f" {raw.dtype} after {raw.offset_bytes:,} bytes (layout.raw), or a whole multiple for a stack"
            )
        shape = raw.shape if times == 1 else (times, *raw.shape)
        return ArrayInFile(path, shape, dtype, raw.offset_bytes)
