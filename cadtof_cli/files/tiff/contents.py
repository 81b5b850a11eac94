"""Checks that the pages of a TIFF may be voltages: no colour pictures, no inverted or turned images, no maps."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import NotAFrameError
from cadtof_cli.files.maps import is_map_layer
from cadtof_cli.files.named_planes import plane_label
from cadtof_cli.files.tiff.pages import LOOKED_INTO, Page

_ORIENTATION = 274

_MIN_IS_WHITE, _RGB = 0, 2

_COLOURS = {
    _RGB: "RGB", 3: "a palette", 5: "CMYK", 6: "YCbCr", 8: "CIELAB", 9: "ICCLAB", 10: "ITULAB", 32844: "LogL", 32845:
    "LogLUV"
}  # fmt: skip
"""Photometric interpretations of colour pictures."""

_CONTIGUOUS = 1

_OPACITY = frozenset({1, 2})
"""Values of the tag ExtraSamples that mean opacity."""

_MASK_OR_REDUCED = 4 | 1


def is_plain_page(page: Page, /) -> bool:
    """Return whether a page is an image in full size, not a mask or a smaller copy in a pyramid."""
    return page.keyframe is None or not page.keyframe.subfiletype & _MASK_OR_REDUCED


def require_voltages(path: Path, pages: Iterable[Page], names: Sequence[str], /) -> None:
    """Raise NotAFrameError if a file holds maps, or a colour picture; `names` are the names of its planes.

    A picture whose planes have names of voltages is accepted, if its pages are stored plainly.
    """
    layers = list(dict.fromkeys(filter(is_map_layer, names)))
    if layers:
        raise NotAFrameError(f"{path}: holds maps ({', '.join(layers)}), expected voltages")
    named = any(map(plane_label, names))
    for page in _first_pages(pages):
        if not named:
            _require_no_colours(path, page)
        _require_plain_page(path, page)


def require_stored_plainly(path: Path, pages: Iterable[Page], /) -> None:
    """Raise FrameError if values of pages are inverted (min-is-white), or their rows and columns are turned."""
    for page in _first_pages(pages):
        _require_plain_page(path, page)


def _first_pages(pages: Iterable[Page]) -> Iterator[tifffile.TiffPage]:
    """Yield the first pages of a file that are images in full size."""
    for page in itertools.islice(pages, LOOKED_INTO):
        if isinstance(page, tifffile.TiffPage) or not page.is_virtual:
            whole = page if isinstance(page, tifffile.TiffPage) else page.aspage()
            if is_plain_page(whole):
                yield whole


def _require_no_colours(path: Path, page: tifffile.TiffPage) -> None:
    """Make sure that a page, whose planes have no names, is no colour picture."""
    photometric, samples = int(page.photometric), page.samplesperpixel
    # software that is not told that four planes are no colours stores them as RGBA, with planar configuration 2
    apart = photometric == _RGB and page.planarconfig != _CONTIGUOUS and samples > 3
    if photometric in _COLOURS and not apart:
        alpha = "A" if photometric == _RGB and samples == 4 else ""
        raise NotAFrameError(
            f"{path}: holds a colour picture ({_COLOURS[photometric]}{alpha}), expected voltages; software that stores"
            " four channels as RGBA may swap them: write a page for each, or name them H1.SC1, H1.SC2, …"
        )
    if photometric not in _COLOURS and not _OPACITY.isdisjoint(page.extrasamples):
        raise NotAFrameError(
            f"{path}: holds grey and opacity, {samples} samples a pixel, expected voltages; write a page for each plane,"
            " or name them H1.SC1, H1.SC2, …"
        )


def _require_plain_page(path: Path, page: tifffile.TiffPage) -> None:
    """Make sure that a page is neither inverted nor turned."""
    if int(page.photometric) == _MIN_IS_WHITE:
        raise FrameError(
            f"{path}: found min-is-white pages, whose values may be stored inverted; expected min-is-black"
        )
    orientation = page.tags.valueof(_ORIENTATION, default=1)
    if orientation != 1:
        raise FrameError(
            f"{path}: found orientation {orientation}, so rows or columns are turned; expected 1, the first row on top"
        )
