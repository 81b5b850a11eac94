"""Finds which images a TIFF holds, in which order, and whether each is complete.

It starts from the series that tifffile finds in the metadata of the file.
"""

import math
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import shape_text
from cadtof_cli.files.reading import require_plausible_size
from cadtof_cli.files.tiff.contents import is_plain_page
from cadtof_cli.files.tiff.ndtiff import require_sound_index
from cadtof_cli.files.tiff.pages import Page, lies_in_one_run, require_sound_keyframe, require_sound_page
from cadtof_cli.files.tiff.promises import require_sound_promises

Item = int | Page
"""Place of an image: the byte at which its pixels begin, if they lie in one run; otherwise the page, to be decoded."""


def alike_series(path: Path, tiff: tifffile.TiffFile, /) -> list[tifffile.TiffPageSeries]:
    """Return the series of a file; software that writes page by page makes a series of every page.

    Raises:
        FrameError: there is no image, the images differ in size or type, some lie in other files, or the metadata is
            damaged.
    """
    first = tiff.pages.first
    if "<OME" in first.description and not tiff.is_ome:
        raise FrameError(f"{path}: damaged TIFF: its OME metadata breaks off, so the order of its planes is not known")
    require_sound_index(path, tiff)
    series = [one for one in _series(path, tiff) if is_plain_page(one.keyframe)]
    if not series or not math.prod(series[0].shape):
        raise FrameError(f"{path}: found no image, expected pages of voltages")
    if len({(one.shape, one.dtype) for one in series}) > 1:
        kinds = Counter(shape_text(one.keyframe.shape[:2], one.dtype) for one in series for _ in one)
        found = "; ".join(f"{count} of {kind}" for kind, count in kinds.items())
        raise FrameError(f"{path}: found different pages ({found}), expected pages of one size and type")
    if series[0].is_multifile:
        raise FrameError(f"{path}: its metadata spreads it over several files, expected all planes in one file")
    return series


def _series(path: Path, tiff: tifffile.TiffFile) -> list[tifffile.TiffPageSeries]:
    """Return the series that tifffile finds, or a series for each page in the order of the file.

    If tifffile finds several plain series, it has sorted the pages by how they are stored. That is not the order of a
    stack, because pages that another program has rewritten differ in their strips. The description of a file that holds
    a single plane is not used, because a page that was split off keeps the description of its old file.
    """
    if not _is_alone(tiff):
        require_sound_promises(path, tiff)
        try:
            found: Any = tiff.series
            # from tifffile 2026.5 on, axes of length 1 are left out unless `squeeze` is False
            series: list[tifffile.TiffPageSeries] = list(found(squeeze=False) if callable(found) else found)
        except RuntimeError:
            series = []
        if series and (len(series) == 1 or series[0].kind != "generic"):
            return series
    tiff.pages.useframes = False
    pages = (page.aspage() if isinstance(page, tifffile.TiffFrame) else page for page in tiff.pages)
    return [tifffile.TiffPageSeries([page]) for page in pages if is_plain_page(page)]


def _is_alone(tiff: tifffile.TiffFile) -> bool:
    """Return whether a file holds a single plane, whatever its description says.

    More planes may follow the first one without pages of their own; then the file is larger.
    """
    first = tiff.pages.first
    after = tiff.filehandle.size - min(first.dataoffsets, default=0)
    return len(tiff.pages) == 1 and len(first.shape) == 2 and after < 2 * first.nbytes


def _axes(series: tifffile.TiffPageSeries) -> tuple[str, tuple[int, ...]]:
    """Return labels and lengths of a series' axes, without an axis of one sample per pixel that tifffile may add."""
    one: Any = series
    is_old = hasattr(one, "get_axes")  # until tifffile 2026.5
    axes, shape = (one.get_axes(squeeze=False), one.get_shape(squeeze=False)) if is_old else (one.axes, one.shape)
    if axes.endswith("S") and not series.keyframe.axes.endswith("S"):
        return axes[:-1], shape[:-1]
    return axes, shape


def divided_axes(path: Path, series: tifffile.TiffPageSeries) -> tuple[str, tuple[int, ...], str]:
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


def sound_items(path: Path, series: Sequence[tifffile.TiffPageSeries], images: int) -> list[Item]:
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


def is_scattered(series: tifffile.TiffPageSeries, /) -> bool:
    """Return whether planes are spread over pages: rows or columns are an axis over pages, as in the axes Y X C H."""
    axes, within = _axes(series)[0], series.keyframe.axes
    pairs = zip(axes[::-1], within[::-1], strict=False) if len(axes) >= len(within) else ()
    return {"Y", "X"} <= set(axes) and any(axis != page_axis for axis, page_axis in pairs if page_axis in "YX")


class ScatteredPlanes:
    """Planes whose pixels are spread over many pages; the whole series is read at once and its axes are reordered."""

    def __init__(self, path: Path, series: Sequence[tifffile.TiffPageSeries]) -> None:
        self._series = one = series[0]
        axes, shape = _axes(one)
        if len(series) > 1 or len(set(axes)) != len(axes):
            raise FrameError(f"{path}: found axes {axes} of lengths {shape}, expected each axis once")
        require_plausible_size(
            path, math.prod(shape) * np.dtype(one.dtype).itemsize, one.keyframe.parent.filehandle.size
        )
        sound_items(path, series, math.prod(shape) // math.prod(one.keyframe.shape))
        self._order = [i for i, axis in enumerate(axes) if axis not in "YX"] + [axes.index("Y"), axes.index("X")]
        sizes = [shape[i] for i in self._order]
        labels = "".join(axes[i] for i in self._order[:-2])
        self.described = f"I{labels}S", (1, *sizes[:-2], 1), (sizes[-2], sizes[-1])

    @cached_property
    def _planes(self) -> Stored:
        shape = _axes(self._series)[1]
        whole: Stored = self._series.asarray(maxworkers=1).reshape(shape).transpose(self._order)
        return whole.reshape(-1, *whole.shape[-2:])

    def planes(self, indices: NDArray[np.intp], /) -> Stored:
        """Return planes by their index, native byte order, shape (n, Y, X), C-contiguous."""
        found = self._planes[indices]
        return np.ascontiguousarray(found, found.dtype.newbyteorder("="))
