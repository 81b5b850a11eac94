"""The planes of a TIFF: pages, samples of the pixels of pages, or planes whose pixels are scattered over pages."""

import math
import operator
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.reading import require_plausible_size
from cadtof_cli.files.tiff import jpeg_xr
from cadtof_cli.files.tiff.pages import Page, lies_in_one_run, require_sound_keyframe, require_sound_page
from cadtof_cli.files.tiff.remarks import decoding

Item = int | Page
"""Place of an image: the byte at which its pixels begin, if they lie in one run; otherwise the page, to be decoded."""


class PagePlanes:
    """Planes that are whole pages, or samples of pages whose pixels hold a sample of each of several planes.

    Attributes:
        labels: labels of the axes besides Y and X, slowest first: I is the axis of images, S the axis of a pixel's samples.
        sizes: lengths of these axes.
        plane_shape: (Y, X) of a plane.
    """

    def __init__(self, path: Path, series: Sequence[tifffile.TiffPageSeries]) -> None:
        self._path, self._keyframe = path, series[0].keyframe
        # tifffile accepts sizes that are no whole numbers
        self._page_shape = tuple(map(operator.index, self._keyframe.shape))
        labels, outer, page_axes = _divided_axes(path, series[0])
        self._stored_type: np.dtype[Any] = np.dtype(self._keyframe.dtype).newbyteorder(self._keyframe.parent.byteorder)
        height, width = (self._page_shape[page_axes.index(axis)] for axis in "YX")
        self._samples = self._page_shape[page_axes.index("S")] if "S" in page_axes else 1
        self._samples_first = page_axes.startswith("S")
        self.labels, self.sizes = f"I{labels}S", (len(series), *outer, self._samples)
        self.plane_shape = (height, width)
        self._items = _sound_items(path, series, math.prod(outer))

    def read(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their index in the file, native byte order, shape (n, Y, X), C-contiguous."""
        if self._samples == 1:
            return self._images(indices.tolist())
        images, samples = np.divmod(indices, self._samples)
        needed, place = np.unique(images, return_inverse=True)
        stored = self._images(needed.tolist())
        if not self._samples_first:
            stored = np.moveaxis(stored, -1, 1)
        return np.ascontiguousarray(stored[place, samples])

    def native_run(self, indices: NDArray[np.intp], /) -> int | None:
        """Return the byte at which planes begin that lie in one run, in this order and native byte order; None: they do not."""
        return self._run(indices.tolist()) if self._samples == 1 and self._stored_type.isnative else None

    def _run(self, images: Sequence[int]) -> int | None:
        first, size = self._items[images[0]], math.prod(self._page_shape) * self._stored_type.itemsize
        if not isinstance(first, int):
            return None
        in_a_run = range(first, first + size * len(images), size)
        return first if all(self._items[index] == at for index, at in zip(images, in_a_run, strict=True)) else None

    def _images(self, images: Sequence[int]) -> Stored:
        """Return images by their index, shape (n, *page shape)."""
        file = self._keyframe.parent.filehandle
        size = len(images) * math.prod(self._page_shape) * self._stored_type.itemsize
        require_plausible_size(self._path, size, file.size)
        whole: Stored = np.empty((len(images), *self._page_shape), self._stored_type.newbyteorder("="))
        start = self._run(images)
        items, parts = (
            ([self._items[index] for index in images], whole) if start is None else ([start], whole[np.newaxis])
        )
        with decoding(self._path, self._keyframe):
            for item, part in zip(items, parts, strict=True):
                if isinstance(item, int):
                    file.read_array(self._stored_type, part.size, item, out=part)
                else:
                    if self._keyframe.compression in jpeg_xr.COMPRESSIONS:
                        jpeg_xr.require_plain_colours(self._path, item, file.fileno())
                    # one thread, because several frames are read in parallel
                    item.asarray(out=part, maxworkers=1)
        return whole


class ScatteredPlanes:
    """Planes whose pixels are spread over many pages: rows or columns are an axis over pages, as in the axes Y X C H.

    The whole series is read at once and its axes are reordered. The attributes are those of `PagePlanes`.
    """

    def __init__(self, path: Path, series: Sequence[tifffile.TiffPageSeries]) -> None:
        self._path, self._series = path, series[0]
        one = series[0]
        axes, shape = _axes(one)
        if len(series) > 1 or len(set(axes)) != len(axes):
            raise FrameError(f"{path}: found axes {axes} of lengths {shape}, expected each axis once")
        require_plausible_size(
            path, math.prod(shape) * np.dtype(one.dtype).itemsize, one.keyframe.parent.filehandle.size
        )
        _sound_items(path, series, math.prod(shape) // math.prod(one.keyframe.shape))
        self._order = [i for i, axis in enumerate(axes) if axis not in "YX"] + [axes.index("Y"), axes.index("X")]
        sizes = [shape[i] for i in self._order]
        labels = "".join(axes[i] for i in self._order[:-2])
        self.labels, self.sizes, self.plane_shape = f"I{labels}S", (1, *sizes[:-2], 1), (sizes[-2], sizes[-1])

    @cached_property
    def _planes(self) -> Stored:
        shape = _axes(self._series)[1]
        with decoding(self._path, self._series.keyframe):
            whole: Stored = self._series.asarray(maxworkers=1).reshape(shape).transpose(self._order)
        return whole.reshape(-1, *whole.shape[-2:])

    def read(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their index in the file, native byte order, shape (n, Y, X), C-contiguous."""
        found = self._planes[indices]
        return np.ascontiguousarray(found, found.dtype.newbyteorder("="))

    def native_run(self, _indices: NDArray[np.intp], /) -> None:
        """Return None: these planes lie in no run of bytes."""


def planes_of(path: Path, series: Sequence[tifffile.TiffPageSeries], /) -> PagePlanes | ScatteredPlanes:
    """Return the planes of series that are alike; raise FrameError unless all of them lie within the file."""
    return ScatteredPlanes(path, series) if _is_scattered(series[0]) else PagePlanes(path, series)


def _is_scattered(series: tifffile.TiffPageSeries) -> bool:
    """Return whether rows or columns are an axis over pages."""
    axes, within = _axes(series)[0], series.keyframe.axes
    pairs = zip(axes[::-1], within[::-1], strict=False) if len(axes) >= len(within) else ()
    return {"Y", "X"} <= set(axes) and any(axis != page_axis for axis, page_axis in pairs if page_axis in "YX")


def _axes(series: tifffile.TiffPageSeries) -> tuple[str, tuple[int, ...]]:
    """Return labels and lengths of a series' axes, without an axis of one sample per pixel that tifffile may add."""
    one: Any = series
    is_old = hasattr(one, "get_axes")  # until tifffile 2026.5
    axes, shape = (one.get_axes(squeeze=False), one.get_shape(squeeze=False)) if is_old else (one.axes, one.shape)
    if axes.endswith("S") and not series.keyframe.axes.endswith("S"):
        return axes[:-1], shape[:-1]
    return axes, shape


def _divided_axes(path: Path, series: tifffile.TiffPageSeries) -> tuple[str, tuple[int, ...], str]:
    """Return labels and lengths of the axes over images, and labels of the axes within an image.

    Raise FrameError if the pages of the series are no whole images.
    """
    axes, shape = _axes(series)
    page = series.keyframe
    outer = len(shape) - len(page.shape)
    if outer < 0 or shape[outer:] != page.shape or not set("YX") <= set(page.axes) <= set("SYX"):
        raise FrameError(
            f"{path}: found axes {axes} of lengths {shape} over pages of {page.shape}, expected whole pages of"
            " height × width"
        )
    return axes[:outer], shape[:outer], page.axes


def _sound_items(path: Path, series: Sequence[tifffile.TiffPageSeries], images: int) -> list[Item]:
    """Return the place of every image; raise FrameError unless each of them lies within the file."""
    items: list[Item] = []
    for one in series:
        page = one.keyframe
        file_size = page.parent.filehandle.size
        # the pixels of all images in one run; files of ImageJ and of tifffile's `truncate` then have only a first page
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
            raise FrameError(
                f"{path}: found {len(pages)} pages, its metadata promises {images}; the others are in other files, or are"
                " lost"
            )
        for image in pages:
            require_sound_page(path, image, page, file_size)
            items.append(image.dataoffsets[0] if lies_in_one_run(image, page) else image)
    return items
