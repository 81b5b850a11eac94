"""The names that a TIFF gives its planes: OME channels, GDAL bands, ImageJ slice labels, page names, descriptions."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile

from cadtof_cli.files.named_planes import channel_in_words, harmonic_in_words, plane_label
from cadtof_cli.files.tiff.ndtiff import index_names
from cadtof_cli.files.tiff.ome import channel_names, parsed

_FIRST_PAGES = 2
"""How many pages are asked for a name. If they have none, no page has one, so files without names are opened quickly.

Two, because the first page may be a preview, or a program may have put other facts into its description.
"""

_DESCRIPTION = 270
PAGE_NAME = 285
GDAL_METADATA = 42112
"""Codes of the tags in which names stand."""


def names_of_planes(
    tiff: tifffile.TiffFile, series: Sequence[tifffile.TiffPageSeries], axes: str, sizes: Sequence[int]
) -> tuple[str, ...]:
    """Return a name for every plane, in the order of the file; it is an empty text for a plane without a name.

    The result is empty if no plane has a name. `axes` and `sizes` are labels and lengths of the axes besides Y and X,
    slowest first: I is the axis of images, S the axis of a pixel's samples.
    """
    first, samples, images = tiff.pages.first, sizes[-1], math.prod(sizes[:-1])
    if tiff.is_ome:
        return _channels(channel_names(first.description), axes, sizes)
    if tiff.is_gdal and images == 1:
        return _bands(first, samples)
    if samples > 1:
        return ()
    if series[0].kind == "ndtiff":
        return index_names(Path(tiff.filehandle.path), list(series[0]))
    labels = (tiff.imagej_metadata or {}).get("Labels", ()) if tiff.is_imagej else ()
    if len(labels) == images:
        # the first line is the name; after it ImageJ adds lines about the image that the slice came from
        return tuple(str(label).partition("\n")[0] for label in labels)
    pages = itertools.chain.from_iterable(series)
    names = [_page_name(page) for page in itertools.islice(pages, _FIRST_PAGES)]
    if any(names):
        names += map(_page_name, pages)
    return tuple(names) if len(names) == images and any(names) else ()


def _channels(names: Sequence[str], axes: str, sizes: Sequence[int]) -> tuple[str, ...]:
    """Return the name of each plane's channel; `names` are those of all images in turn, or of one image for all."""
    along = axes.find("C") if "C" in axes and sizes[axes.find("C")] > 1 else axes.rindex("S")
    images, place = np.indices(sizes)[[0, along]].reshape(2, -1)
    channels = sizes[along]
    if not any(names) or len(names) not in (channels, sizes[0] * channels):
        return ()
    index = place if len(names) == channels else images * channels + place
    return tuple(names[i] for i in index)


def _bands(page: tifffile.TiffPage, samples: int) -> tuple[str, ...]:
    """Return the descriptions of a GeoTIFF's bands, which GDAL wrote."""
    root = parsed(str(page.tags.valueof(GDAL_METADATA)))
    items = [item for item in root.iter("Item") if item.get("role") == "description"]
    names = {item.get("sample"): item.text or "" for item in items}
    return tuple(names.get(str(sample), "") for sample in range(samples)) if names else ()


def _page_name(page: object) -> str:
    """Return the name or the description of a page, whichever names a plane; empty if neither does."""
    if isinstance(page, tifffile.TiffFrame):
        page = page.aspage()
    if not isinstance(page, tifffile.TiffPage):
        return ""
    values = (page.tags.valueof(code) for code in (PAGE_NAME, _DESCRIPTION))
    texts = [text for text in values if isinstance(text, str)]
    return next(
        (text for says in (plane_label, channel_in_words, harmonic_in_words) for text in filter(says, texts)), ""
    )
