"""Frames in TIFF files: one per file, or stacks of them."""

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames
from cadtof_cli.files.plane_table import plane_table
from cadtof_cli.files.reading import damage_as_frame_error
from cadtof_cli.files.system import codes_of_the_system
from cadtof_cli.files.tiff.images import TiffImages

_MENDED_BY = "tifffile.imwrite(PATH, tifffile.imread(PATH)", ", photometric='minisblack')"
"""The Python call that saves a file again: the parts before and after the place of the transposition."""


class _LastRead(threading.local):
    """The stack that this thread read last: its pages and the table of its planes; `key` is different after the file changed."""

    key: object = None
    opened: tuple[TiffImages, NDArray[np.intp]]


_last = _LastRead()


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Open a TIFF or BigTIFF file of either byte order.

    The pages of the last stack are remembered. So a worker that reads a stack frame by frame looks for its thousands of
    pages only once.
    """
    images, table = _opened(path, layout)
    shape = (len(layout.harmonics), CHANNELS, *images.plane_shape)
    with closing(images):
        with damage_as_frame_error(path, "TIFF"):
            envelope = images.envelope(table[0].ravel()) if len(table) == 1 else None
        read_like = partial(envelope.read, shape=shape, dtype=images.dtype) if envelope else None

        def read(index: int) -> Stored:
            return images.planes(table[index].ravel()).reshape(shape)

        yield Frames(len(table), shape, images.dtype, read, read_like)


def _opened(path: Path, layout: FrameLayout) -> tuple[TiffImages, NDArray[np.intp]]:
    """Return the images of a file, which is open then, and the table that says where each plane is, (T, H, C)."""
    with damage_as_frame_error(path, "TIFF"):
        state = path.stat()
    key = path, layout, state.st_ino, state.st_size, state.st_mtime_ns
    if _last.key == key:
        _last.opened[0].open()
        return _last.opened
    images = TiffImages(path)
    try:
        table = plane_table(images.labels, images.sizes, layout, where=images.found, names=images.names)
    except FrameError:
        # imported here because few files are such arrays
        from cadtof_cli.files.array_frames import lengths_text
        from cadtof_cli.files.axis_orders import transpositions

        images.close()
        # a program that saves arrays makes pages of whatever axes are last
        shape = (*(size for size in images.sizes if size > 1), *images.plane_shape)
        if ways := transpositions(_MENDED_BY, shape, len(layout.harmonics)):
            raise FrameError(
                f"{path}: found an array of {lengths_text(shape)}, expected axes [T] H C Y X, rows and columns last; {ways}"
            ) from None
        raise
    if len(table) > 1:
        _last.key, _last.opened = key, (images, table)
    return images, table


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of a TIFF file, shape (Y, X), native byte order."""
    with closing(TiffImages(path)) as images:
        if max(images.sizes) > 1:
            raise FrameError(f"{images.found}, expected a single plane")
        plane: Stored = images.planes(np.zeros(1, np.intp))[0]
        return plane


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write a frame, shape (H, C, Y, X), with one page per plane and the axes H C Y X in the metadata.

    If planes have only one column, no axes are given: with axes, tifffile would put several such planes into one page.
    """
    columns = stored.shape[-1]
    with codes_of_the_system(path, stored.nbytes):
        tifffile.imwrite(
            path,
            stored if columns > 1 else stored.reshape(-1, *stored.shape[-2:]),
            photometric="minisblack",
            metadata={"axes": "HCYX"} if columns > 1 else None,
            compression="zlib" if compress else None,
        )
