"""Checks what the metadata of a TIFF promises, before tifffile believes it.

tifffile makes a place for every plane that the metadata promises, and opens every other file that it names.
"""

import math
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.reading import require_regular
from cadtof_cli.files.tiff.ome import elements, parsed

_MOST_PLANES = 2**20
_LEAST_PAGE_BYTES = 50
"""Limits on the number of planes that metadata may promise: this many, or as many pages of this size as the file has room for."""


def require_sound_promises(path: Path, tiff: tifffile.TiffFile, /) -> None:
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
