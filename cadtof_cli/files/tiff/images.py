"""The images of a TIFF file, in order, whatever software wrote it: plain pages, shaped, OME and ImageJ files."""

import contextlib
import logging
import math
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
from cadtof_cli.files.damage import damage_as_frame_error, require_plausible_size
from cadtof_cli.files.frames import NotAFrameError, shape_text
from cadtof_cli.files.maps import is_map_layer
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.pages import (
    Page,
    lies_in_one_run,
    require_sound_chain,
    require_sound_keyframe,
    require_sound_page,
)

_NEEDS_CODECS = re.compile(r"requires?\b.*\bimagecodecs\b")

Item = int | Page
"""One image of a series: the byte where its pixels begin, if they lie in one run, or the page that knows."""


class _Remarks(logging.Filter):
    """Keeps what tifffile logs while one of our threads reads, so that none of it reaches the terminal.

    tifffile logs an error and goes on with a guess, such as fewer strips or a plainer order of pages; for depth a guess
    is damage.
    """

    def __init__(self) -> None:
        super().__init__()
        self.kept = threading.local()

    def filter(self, record: logging.LogRecord) -> bool:
        errors: list[str] | None = getattr(self.kept, "errors", None)
        if errors is not None and record.levelno >= logging.ERROR:
            errors.append(record.getMessage())
        return errors is None


_remarks = _Remarks()
logging.getLogger("tifffile").addFilter(_remarks)


@contextlib.contextmanager
def reading_tiff(path: Path) -> Iterator[None]:
    """Turn whatever tifffile raises within the block, or only remarks on, into a FrameError."""
    errors: list[str] = []
    _remarks.kept.errors = errors
    try:
        with damage_as_frame_error(path, "TIFF"):
            yield
            if errors:
                raise FrameError(f"{path}: damaged TIFF: {'; '.join(errors)}")
    except FrameError as error:
        if _NEEDS_CODECS.search(str(error)):
            raise FrameError(
                f"{path}: its compression needs the imagecodecs package, which is not installed;"
                " try pip install 'cadtof[codecs]'"
            ) from error
        raise
    finally:
        _remarks.kept.errors = None


class TiffImages:
    """The images of one TIFF file, read by their place in the file; what is damaged or missing is found on opening.

    Parameters:
        path: a TIFF or BigTIFF file of either byte order.

    Attributes:
        plane_shape: (Y, X) of every image.
        dtype: native byte order.
        labels, sizes: of the axes that run over planes, slowest first.
        found: what the file holds, to begin a message with.

    Raises:
        NotAFrameError: the file holds maps, not voltages.
        FrameError: the file cannot be read, is damaged, or its pages differ from each other.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with contextlib.ExitStack() as opened:
            with reading_tiff(path):
                self._tiff = tiff = opened.enter_context(tifffile.TiffFile(path))
                require_sound_chain(path, tiff.filehandle.fileno(), tiff.filehandle.size)
                _require_voltages(path, tiff)
                series = _alike_series(path, tiff)
                labels, outer, page_axes = _divided_axes(path, series[0])
                page = series[0].keyframe
                self.dtype: np.dtype[Any] = np.dtype(page.dtype).newbyteorder("=")
                self._page_shape: tuple[int, ...] = page.shape
                self.plane_shape: tuple[int, ...] = tuple(page.shape[page_axes.index(axis)] for axis in "YX")
                self._samples = page.shape[page_axes.index("S")] if "S" in page_axes else 1
                self._samples_first = page_axes.startswith("S")
                self.labels = f"I{labels}S"
                self.sizes = (len(series), *outer, self._samples)
                self._items = _items(path, series, math.prod(outer))
                require_plausible_size(path, page.nbytes, tiff.filehandle.size)
                samples = f" of {self._samples} samples" if self._samples > 1 else ""
                self.found = (
                    f"{path}: found {len(self._items)} pages{samples} of {shape_text(self.plane_shape, self.dtype)}"
                )
            opened.pop_all()

    def open(self) -> None:
        """Open the file again, if it has been closed."""
        self._tiff.filehandle.open()

    def close(self) -> None:
        """Close the file; where its images lie is kept."""
        self._tiff.filehandle.close()

    def planes(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their place in the file, in native byte order, shape (n, Y, X), C-contiguous."""
        if self._samples == 1:
            return self._images(indices.tolist())
        images, samples = np.divmod(indices, self._samples)
        needed, place = np.unique(images, return_inverse=True)
        stored = self._images(needed.tolist())
        if not self._samples_first:
            stored = np.moveaxis(stored, -1, 1)
        return np.ascontiguousarray(stored[place, samples])

    def envelope(self, indices: NDArray[np.intp], /) -> Envelope | None:
        """Return what stands around planes; None where they do not lie in one run, in this order and native byte order."""
        native = self.dtype.newbyteorder(self._tiff.byteorder) == self.dtype
        start = self._start_of_run(indices.tolist()) if native and self._samples == 1 else None
        size = indices.size * math.prod(self.plane_shape) * self.dtype.itemsize
        return None if start is None else Envelope.of(self._tiff.filehandle, start, size)

    def _start_of_run(self, indices: Sequence[int]) -> int | None:
        first, size = self._items[indices[0]], math.prod(self._page_shape) * self.dtype.itemsize
        if not isinstance(first, int):
            return None
        in_a_run = range(first, first + size * len(indices), size)
        return first if all(self._items[index] == at for index, at in zip(indices, in_a_run, strict=True)) else None

    def _images(self, indices: Sequence[int]) -> Stored:
        """Return some of the file's images, shape (n, *page shape)."""
        whole: Stored = np.empty((len(indices), *self._page_shape), self.dtype)
        start = self._start_of_run(indices)
        items, parts = (
            ([self._items[index] for index in indices], whole) if start is None else ([start], whole[np.newaxis])
        )
        with reading_tiff(self.path):
            for item, part in zip(items, parts, strict=True):
                if isinstance(item, int):
                    stored_type = self.dtype.newbyteorder(self._tiff.byteorder)
                    self._tiff.filehandle.read_array(stored_type, part.size, item, out=part)
                else:
                    # one thread: the frames of a run are what is read side by side
                    item.asarray(out=part, maxworkers=1)
        return whole


def _require_voltages(path: Path, tiff: tifffile.TiffFile) -> None:
    description = tiff.pages.first.description
    if "<OME" in description and not tiff.is_ome:
        raise FrameError(f"{path}: damaged TIFF: its OME metadata breaks off, so the order of its planes is not known")
    if tiff.is_ome:
        from cadtof_cli.files.tiff.ome import channel_names

        layers = list(filter(is_map_layer, channel_names(description)))
        if layers:
            raise NotAFrameError(f"{path}: holds maps ({', '.join(layers)}), expected voltages")


def _alike_series(path: Path, tiff: tifffile.TiffFile) -> list[tifffile.TiffPageSeries]:
    """Return the series of a file; software that writes page by page makes a series of each."""
    series = list(tiff.series)
    if not series or not math.prod(series[0].shape):
        raise FrameError(f"{path}: found no image, expected pages of voltages")
    kinds = {(one.shape, one.dtype): one for one in series}
    if len(kinds) > 1:
        found = "; ".join(f"{len(one)} pages of {shape_text(one.keyframe.shape[:2], one.dtype)}" for one in series[:4])
        raise FrameError(f"{path}: found pages that differ ({found}), expected pages of one size and type")
    if series[0].is_multifile:
        raise FrameError(f"{path}: its OME metadata spreads it over several files, expected all planes in one file")
    return series


def _divided_axes(path: Path, series: tifffile.TiffPageSeries) -> tuple[str, tuple[int, ...], str]:
    """Return labels and lengths of the axes that run over images, and labels of the axes within an image."""
    axes, shape = series.get_axes(squeeze=False), series.get_shape(squeeze=False)
    page = series.keyframe
    if axes.endswith("S") and not page.axes.endswith("S"):
        axes, shape = axes[:-1], shape[:-1]
    outer = len(shape) - len(page.shape)
    if outer < 0 or shape[outer:] != page.shape or not set("YX") <= set(page.axes) <= set("SYX"):
        raise FrameError(
            f"{path}: found axes {axes} of lengths {shape} over pages of {page.shape}, expected whole pages of"
            " height × width"
        )
    return axes[:outer], shape[:outer], page.axes


def _items(path: Path, series: Sequence[tifffile.TiffPageSeries], images: int) -> list[Item]:
    """Return the place of every image, each checked to be within the file."""
    items: list[Item] = []
    for one in series:
        page = one.keyframe
        file_size = page.parent.filehandle.size
        # ImageJ and truncated files describe a whole stack by its first page
        run = one.dataoffset
        require_sound_keyframe(path, page, stored_bytes=page.nbytes * (images if run is not None else 1))
        if run is not None:
            end = run + images * page.nbytes
            if end > file_size:
                raise FrameError(
                    f"{path}: truncated TIFF: {images} pages reach to byte {end:,}, found a file of {file_size:,} bytes"
                )
            items += [run + place * page.nbytes for place in range(images)]
            continue
        pages = [image for image in one if image is not None]
        if len(pages) != images:
            raise FrameError(f"{path}: damaged TIFF: found {len(pages)} pages, its metadata promises {images}")
        for image in pages:
            require_sound_page(path, image, page, file_size)
            items.append(image.dataoffsets[0] if lies_in_one_run(image, page) else image)
    return items
