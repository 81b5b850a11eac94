"""NDTiff, as Micro-Manager writes it: an index in a file of its own says which page is which plane."""

import math
from collections.abc import Sequence
from pathlib import Path

import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.reading import require_regular
from cadtof_cli.files.tiff.pages import Page

_INDEX = "NDTiff.index"

_FIRST_WITH_INDEX = 2
"""Major version of the format from which on there is an index."""


def require_sound_index(path: Path, tiff: tifffile.TiffFile, /) -> None:
    """Raise FrameError unless the index of an NDTiff file describes all pages of this file and no other file.

    This is checked before tifffile uses the index.
    """
    written_by = tiff.micromanager_metadata or {}
    if written_by.get("MajorVersion", 0) < _FIRST_WITH_INDEX:
        return
    index = path.with_name(_INDEX)
    try:
        require_regular(index)
    except FileNotFoundError:
        raise FrameError(
            f"{path}: found an NDTiff file without {_INDEX}, which says which page is which plane; expected it in the same folder"
        ) from None
    listed = list(tifffile.read_ndtiff_index(index))
    others = {file for _, file, *_ in listed} - {path.name}
    if others:
        raise FrameError(
            f"{path}: {index} spreads it over {', '.join(sorted(others))} too, expected all planes in one file"
        )
    names = {name for axes, *_ in listed for name in axes}
    promised = math.prod(map(_length, ([axes.get(name) for axes, *_ in listed] for name in names)))
    if promised != len(listed):
        raise FrameError(f"{path}: {index} lists {len(listed)} planes, its axes promise {promised}")


def _length(places: Sequence[object]) -> int:
    """Return the length of an axis on which planes have these places, which are whole numbers or names."""
    numbers = [place for place in places if isinstance(place, int)]
    return max(numbers) - min(numbers) + 1 if len(numbers) == len(places) else len(set(places))


def index_names(path: Path, pages: Sequence[Page | None], /) -> tuple[str, ...]:
    """Return the name that the index gives each page, such as H1.SC2: the names among its places, joined by dots.

    The name of a page is empty if all its places are numbers.
    """
    said = {
        offset: ".".join(place for place in axes.values() if isinstance(place, str))
        for axes, _, offset, *_ in tifffile.read_ndtiff_index(path.with_name(_INDEX))
    }
    return tuple("" if page is None else said.get(page.dataoffsets[0], "") for page in pages)
