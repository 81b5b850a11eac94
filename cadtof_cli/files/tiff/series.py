"""Finds which images a TIFF holds, in which order.

It starts from the series that tifffile finds in the metadata of the file. What the metadata promises is checked before:
tifffile makes a place for every plane that the metadata promises, and opens every other file that it names.
"""

import math
import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import shape_text
from cadtof_cli.files.reading import require_regular
from cadtof_cli.files.tiff.contents import is_plain_page
from cadtof_cli.files.tiff.ndtiff import require_sound_index
from cadtof_cli.files.tiff.ome import elements, parsed

_MOST_PLANES = 2**20
_LEAST_PAGE_BYTES = 50
"""Limits on the number of planes that metadata may promise: this many, or as many pages of this size as the file has room for."""


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
    """Return the series that tifffile finds, or a series for each page in the order of the file, plain or not.

    If tifffile finds several plain series, it has sorted the pages by how they are stored. That is not the order of a
    stack, because pages that another program has rewritten differ in their strips. The description of a file that holds
    a single plane is not used, because a page that was split off keeps the description of its old file.
    """
    if not _is_alone(tiff):
        _require_sound_promises(path, tiff)
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
    return [tifffile.TiffPageSeries([page]) for page in pages]


def _is_alone(tiff: tifffile.TiffFile) -> bool:
    """Return whether a file holds a single plane, whatever its description says.

    More planes may follow the first one without pages of their own; then the file is larger.
    """
    first = tiff.pages.first
    after = tiff.filehandle.size - min(first.dataoffsets, default=0)
    return len(tiff.pages) == 1 and len(first.shape) == 2 and after < 2 * first.nbytes


def _require_sound_promises(path: Path, tiff: tifffile.TiffFile) -> None:
    """Check the metadata by which tifffile would order the planes of a file.

    Raises:
        FrameError: the metadata promises far more planes than the file can hold, or names another file that exists.
        OSError: a file that belongs to the same data set is no regular file.
    """
    if tiff.is_mmstack:
        _require_sound_stack(path, tiff)
    elif tiff.is_ome:
        _require_sound_ome(path, tiff)


def _require_sound_ome(path: Path, tiff: tifffile.TiffFile) -> None:
    root = parsed(tiff.ome_metadata or "")
    for pixels in elements(root, "Pixels"):
        _require_plausible(path, tiff, math.prod(int(pixels.get(f"Size{axis}", 1)) for axis in "CZT"))
    for data in elements(root, "TiffData"):
        _require_plausible(path, tiff, max(int(data.get(count, 0)) for count in ("PlaneCount", "NumPlanes")))
    for along in (one for axis in "CZT" for one in elements(root, f"ModuloAlong{axis}") if "Start" in one.attrib):
        start, end, step = (float(along.get(name, 1)) for name in ("Start", "End", "Step"))
        _require_plausible(path, tiff, (end - start) / step)
    for uuid in elements(root, "UUID"):
        named = path.parent / uuid.get("FileName", path.name)
        if uuid.text != root.get("UUID") and os.path.lexists(named) and not named.samefile(path):
            raise FrameError(f"{path}: its OME metadata spreads it over several files, expected all planes in one file")


def _require_sound_stack(path: Path, tiff: tifffile.TiffFile) -> None:
    """Check the metadata of Micro-Manager. Other files of the data set have similar names, and tifffile opens them."""
    written_by = tiff.micromanager_metadata or {}
    summary, places = written_by.get("Summary", {}), np.asarray(written_by.get("IndexMap", ()))
    lengths: Iterable[int] = (places[:, :4].max(axis=0).astype(int) + 1).tolist() if places.size else ()
    keys = ("Channels", "Slices", "Frames", "Positions")
    promised = math.prod(max(length, int(summary.get(key, 1))) for length, key in zip(lengths, keys, strict=False))
    _require_plausible(path, tiff, promised)
    if promised > len(places):
        for other in path.parent.glob("*_MMStack*.tif"):
            require_regular(other)


def _require_plausible(path: Path, tiff: tifffile.TiffFile, planes: float) -> None:
    if planes > max(_MOST_PLANES, tiff.filehandle.size // _LEAST_PAGE_BYTES):
        raise FrameError(
            f"{path}: damaged TIFF: its metadata promises {planes:,.0f} planes, found a file of {tiff.filehandle.size:,} bytes"
        )
