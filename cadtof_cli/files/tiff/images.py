"""The images of a TIFF file in their order, whichever software wrote it: plain pages, shaped, OME and ImageJ files."""

import contextlib
import logging
import math
import operator
import re
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import shape_text
from cadtof_cli.files.library_output import library_output
from cadtof_cli.files.reading import damage_as_frame_error, in_brief, require_plausible_size
from cadtof_cli.files.tiff import jpeg_xr
from cadtof_cli.files.tiff.contents import require_stored_plainly, require_voltages
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.names import names_of_planes
from cadtof_cli.files.tiff.pages import require_sound_chain
from cadtof_cli.files.tiff.series import (
    ScatteredPlanes,
    alike_series,
    divided_axes,
    is_scattered,
    sound_items,
)

_PRINTING = jpeg_xr.COMPRESSIONS | {34933}
"""Compressions whose libraries print their remarks on a damaged page: JPEG XR and PNG."""

_GDAL_NO_DATA = 42113
"""Code of the tag with the value that stands for no value."""

_PRIVATE_TAG_MESSAGE = r"TiffTag (?:3[3-9]\d{3}|[4-9]\d{4})\b"
"""Pattern of messages about private tags, which manufacturers define."""


class _Remarks:
    """Keeps the errors that tifffile logs while one of our threads reads, and keeps all its messages off the terminal.

    After an error, tifffile continues with a guess, such as fewer strips or a simpler order of pages. For us such a
    file is damaged. We replace methods of tifffile's logger and do not add a filter, because programs often silence
    that logger, or all loggers, and then no filter is called.
    """

    def __init__(self, log: logging.Logger) -> None:
        self.kept = threading.local()
        self._is_enabled_for, self._handle = log.isEnabledFor, log.handle
        vars(log).update(isEnabledFor=self._is_wanted, handle=self._keep)

    def _is_wanted(self, level: int) -> bool:
        return getattr(self.kept, "errors", None) is not None or self._is_enabled_for(level)

    def _keep(self, record: logging.LogRecord) -> None:
        errors: list[str] | None = getattr(self.kept, "errors", None)
        if errors is None:
            self._handle(record)
        elif record.levelno >= logging.ERROR and not re.search(_PRIVATE_TAG_MESSAGE, record.getMessage()):
            errors.append(record.getMessage())


_remarks = _Remarks(logging.getLogger("tifffile"))


@contextlib.contextmanager
def reading_tiff(path: Path) -> Iterator[None]:
    """Turn everything that tifffile raises in the block, and every error that it logs, into a FrameError."""
    errors: list[str] = []
    _remarks.kept.errors = errors
    try:
        with damage_as_frame_error(path, "TIFF"):
            yield
            if errors:
                raise FrameError(f"{path}: damaged TIFF: {in_brief(errors)}")
    finally:
        _remarks.kept.errors = None


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
                # tifffile accepts sizes that are no whole numbers
                self._page_shape = tuple(map(operator.index, page.shape))
                self._is_printing = page.compression in _PRINTING
                self._is_jpeg_xr = page.compression in jpeg_xr.COMPRESSIONS
                self._described_beside = series[0].kind == "ndtiff"
                self._scattered = ScatteredPlanes(path, series) if is_scattered(series[0]) else None
                if self._scattered is not None:
                    self.labels, self.sizes, self.plane_shape = self._scattered.described
                else:
                    self._divide(series)
                self.names = names_of_planes(self._tiff, series, self.labels, self.sizes)
                if voltages:
                    require_voltages(path, self._tiff.pages, self.names)
                else:
                    require_stored_plainly(path, self._tiff.pages)
                require_plausible_size(path, page.nbytes, self._tiff.filehandle.size)
            opened.pop_all()

    def _divide(self, series: Sequence[tifffile.TiffPageSeries]) -> None:
        """Find the images of a file whose pages are planes, or whose pixels hold a sample of each of several planes."""
        labels, outer, page_axes = divided_axes(self.path, series[0])
        height, width = (self._page_shape[page_axes.index(axis)] for axis in "YX")
        self.plane_shape = (height, width)
        self._samples = self._page_shape[page_axes.index("S")] if "S" in page_axes else 1
        self._samples_first = page_axes.startswith("S")
        self.labels = f"I{labels}S"
        self.sizes = (len(series), *outer, self._samples)
        self._items = sound_items(self.path, series, math.prod(outer))

    @property
    def found(self) -> str:
        """What was found in the file, as the beginning of a message."""
        samples = f" of {self.sizes[-1]} samples" if self.sizes[-1] > 1 else ""
        pages = math.prod(self.sizes[:-1])
        return f"{self.path}: found {pages} pages{samples} of {shape_text(self.plane_shape, self.dtype)}"

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
        if self._scattered is not None:
            with self._decoding():
                return self._scattered.planes(indices)
        if self._samples == 1:
            return self._images(indices.tolist())
        images, samples = np.divmod(indices, self._samples)
        needed, place = np.unique(images, return_inverse=True)
        stored = self._images(needed.tolist())
        if not self._samples_first:
            stored = np.moveaxis(stored, -1, 1)
        return np.ascontiguousarray(stored[place, samples])

    def envelope(self, indices: NDArray[np.intp], /) -> Envelope | None:
        """Return the envelope around these planes.

        None: the planes do not lie in one run, in this order and in native byte order; or the envelope is too large; or
        another file (an NDTiff index) says which plane is which, because it may say something else for the next file.
        """
        native = self.dtype.newbyteorder(self._tiff.byteorder) == self.dtype
        plain = self._scattered is None and self._samples == 1 and not self._described_beside
        start = self._start_of_run(indices.tolist()) if native and plain else None
        size = indices.size * math.prod(self.plane_shape) * self.dtype.itemsize
        return None if start is None else Envelope.of(self._tiff.filehandle, start, size)

    def _start_of_run(self, indices: Sequence[int]) -> int | None:
        first, size = self._items[indices[0]], math.prod(self._page_shape) * self.dtype.itemsize
        if not isinstance(first, int):
            return None
        in_a_run = range(first, first + size * len(indices), size)
        return first if all(self._items[index] == at for index, at in zip(indices, in_a_run, strict=True)) else None

    @contextlib.contextmanager
    def _decoding(self) -> Iterator[None]:
        """Turn everything that is raised, logged as an error or printed while pages are decoded into a FrameError."""
        with reading_tiff(self.path):
            if not self._is_printing:
                yield
                return
            with library_output() as printed:
                yield
            if printed:
                raise FrameError(f"{self.path}: damaged TIFF: {in_brief(printed)}")

    def _images(self, indices: Sequence[int]) -> Stored:
        """Return images by their index, shape (n, *page shape)."""
        size = len(indices) * math.prod(self._page_shape) * self.dtype.itemsize
        require_plausible_size(self.path, size, self._tiff.filehandle.size)
        whole: Stored = np.empty((len(indices), *self._page_shape), self.dtype)
        start = self._start_of_run(indices)
        items, parts = (
            ([self._items[index] for index in indices], whole) if start is None else ([start], whole[np.newaxis])
        )
        with self._decoding():
            for item, part in zip(items, parts, strict=True):
                if isinstance(item, int):
                    stored_type = self.dtype.newbyteorder(self._tiff.byteorder)
                    self._tiff.filehandle.read_array(stored_type, part.size, item, out=part)
                else:
                    if self._is_jpeg_xr:
                        jpeg_xr.require_plain_colours(self.path, item, self._tiff.filehandle.fileno())
                    # one thread, because several frames are read in parallel
                    item.asarray(out=part, maxworkers=1)
        return whole
