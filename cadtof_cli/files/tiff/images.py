"""The images of a TIFF file in their order, whichever software wrote it: plain pages, shaped, OME and ImageJ files."""

import contextlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.files.frames import shape_text
from cadtof_cli.files.reading import require_plausible_size
from cadtof_cli.files.tiff.contents import require_stored_plainly, require_voltages
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.names import names_of_planes
from cadtof_cli.files.tiff.pages import require_sound_chain
from cadtof_cli.files.tiff.planes import planes_of
from cadtof_cli.files.tiff.remarks import reading_tiff
from cadtof_cli.files.tiff.series import alike_series
from cadtof_cli.units import counted

_GDAL_NO_DATA = 42113
"""Code of the tag with the value that stands for no value."""


class TiffImages:
    """The images of one TIFF file, read by their index in the file. Opening the file finds damaged and missing pages.

    It is a TIFF or BigTIFF file of either byte order. If it must hold `voltages`, maps and pictures are refused
    (NotAFrameError).
    """

    def __init__(self, path: Path, *, voltages: bool = True) -> None:
        self.path = path
        with contextlib.ExitStack() as opened:
            with reading_tiff(path):
                self._tiff = opened.enter_context(tifffile.TiffFile(path))
                require_sound_chain(path, self._tiff.filehandle.fileno(), self._tiff.filehandle.size)
                series = alike_series(path, self._tiff)
                page = series[0].keyframe
                self.dtype: np.dtype[Any] = np.dtype(page.dtype).newbyteorder("=")
                names_files = "FileName=" in (self._tiff.ome_metadata or "")
                self._described_beside = names_files or series[0].kind == "ndtiff"
                self._planes = planes = planes_of(path, series)
                self.labels, self.sizes, self.plane_shape = planes.labels, planes.sizes, planes.plane_shape
                self.names = names_of_planes(self._tiff, series, self.labels, self.sizes)
                if voltages:
                    require_voltages(path, self._tiff.pages, self.names)
                else:
                    require_stored_plainly(path, self._tiff.pages)
                require_plausible_size(path, page.nbytes, self._tiff.filehandle.size)
            opened.pop_all()

    @property
    def found(self) -> str:
        """What was found in the file, as the beginning of a message."""
        samples = f" of {self.sizes[-1]} samples" if self.sizes[-1] > 1 else ""
        pages = math.prod(self.sizes[:-1])
        return f"{self.path}: found {counted(pages, 'page')}{samples} of {shape_text(self.plane_shape, self.dtype)}"

    @property
    def no_data(self) -> float:
        """The value that stands for no value, as GDAL writes it; NaN if the file names none."""
        with reading_tiff(self.path):
            tag = self._tiff.pages.first.tags.get(_GDAL_NO_DATA)
            with contextlib.suppress(TypeError, ValueError):
                return math.nan if tag is None else float(tag.value)
        return math.nan

    def open(self) -> None:
        """Open the file again, if it has been closed."""
        self._tiff.filehandle.open()

    def close(self) -> None:
        """Close the file; the places of its images are kept, so that `open` is quick."""
        self._tiff.filehandle.close()

    def planes(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their index in the file, in native byte order, shape (n, Y, X), C-contiguous."""
        return self._planes.read(indices)

    def envelope(self, indices: NDArray[np.intp], /) -> Envelope | None:
        """Return the envelope around these planes.

        None: the planes do not lie in one run, in this order and in native byte order; or the envelope is too large; or
        another file (an NDTiff index, one that OME metadata name) says which plane is which, because it may say something
        else for the next file.
        """
        start = None if self._described_beside else self._planes.native_run(indices)
        size = indices.size * math.prod(self.plane_shape) * self.dtype.itemsize
        return None if start is None else Envelope.of(self._tiff.filehandle, start, size)
