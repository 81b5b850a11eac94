"""Frames in TIFF files, one a file or in stacks."""

from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, Container, FrameLayout
from cadtof_cli.files.tiff.axes import plane_table
from cadtof_cli.files.tiff.images import TiffImages


class TiffFrames:
    """The frames of one TIFF file, read one by one; entering opens the file, leaving closes it.

    Parameters:
        path: a TIFF or BigTIFF file of either byte order.
        layout: harmonics of the capture, and frames of a stack where the metadata says it.

    Raises:
        NotAFrameError: the file holds maps, not voltages.
        FrameError: the file cannot be read, is damaged, or its planes do not make up whole frames.
    """

    container: Container = "tif"

    def __init__(self, path: Path, layout: FrameLayout) -> None:
        self._images = TiffImages(path)
        try:
            self._table = plane_table(self._images.labels, self._images.sizes, layout, where=self._images.found)
        except FrameError:
            self._images.close()
            raise
        self.count = len(self._table)
        self.shape = (len(layout.harmonics), CHANNELS, *self._images.plane_shape)
        self.dtype: np.dtype[Any] = self._images.dtype

    def __enter__(self) -> "TiffFrames":
        self._images.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._images.close()

    def read(self, index: int = 0, /) -> Stored:
        """Return frame `index` as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""
        return self._images.planes(self._table[index].ravel()).reshape(self.shape)


def read_plane(path: Path) -> Stored:
    """Return the one plane of a TIFF file, shape (Y, X), native byte order.

    Raises:
        FrameError: the file cannot be read, is damaged, or holds more than one plane.
    """
    images = TiffImages(path)
    try:
        if max(images.sizes) > 1:
            raise FrameError(f"{images.found}, expected a single plane")
        plane: Stored = images.planes(np.zeros(1, np.intp))[0]
        return plane
    finally:
        images.close()
