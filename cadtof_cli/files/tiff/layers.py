"""Named layers as OME-TIFF: one float32 page each, the status bits of maps as whole numbers in the last."""

import math
import threading
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.direct import BLOCK_BYTES
from cadtof_cli.files.maps import SOURCE, STATUS, DepthMaps, MapsAbout
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.images import TiffImages, reading_tiff
from cadtof_cli.files.tiff.ome import annotations, gdal_xml, marked_source, ome_xml

_PAGE_NAME, _GDAL_METADATA, _ASCII = 285, 42112, 2


class _Last(threading.local):
    """What a thread last said about maps of which names and size, and what stands around their pixels then."""

    kind: object = None
    source: bytes = b""
    envelope: Envelope | None = None


_last = _Last()


def write_maps(path: Path, maps: DepthMaps, /, *, about: MapsAbout) -> Sequence[memoryview]:
    """Write the maps to `path`, or return the parts of the file; no date and no random identifier goes in.

    OME-XML in front says what the pages are; each page has its name too, as a page name and as the description of a band, since
    GDAL and what is built on it (rasterio, QGIS) know a page without the others.

    So files of maps with the same names and size differ in their pixels, and in the name of the recorded frame, alone: tifffile
    makes the first two of them, as the header of a lone one is of no further use.
    """
    maps.pages[-1] = maps.status
    others = {name: text for name, text in about.facts.items() if name != SOURCE}
    source = marked_source(about)
    kind = (maps.names, maps.pages.shape, others, dict(about.units), len(source))
    if _last.kind == kind and _last.envelope:
        return _last.envelope.written_as(_last.source, source).around(maps.pages)
    _write_pages(path, maps, about)
    _last.envelope = _envelope(path, maps) if _last.kind == kind else None
    _last.kind, _last.source = kind, source
    return ()


def _write_pages(path: Path, maps: DepthMaps, about: MapsAbout) -> None:
    """Write a file as tifffile does, all pixels in one run, then the names of the pages into their tags."""
    names = (*maps.names, STATUS)
    bands = [
        gdal_xml(name, about.units.get(name, ""), {} if place else about.facts) for place, name in enumerate(names)
    ]
    tifffile.imwrite(
        path,
        maps.pages,
        photometric="minisblack",
        description=ome_xml(names, size=maps.status.shape, about=about),
        software=about.facts["software"],
        metadata=None,
        align=BLOCK_BYTES,
        extratags=[(code, _ASCII, None, " ", False) for code in (_PAGE_NAME, _GDAL_METADATA)],
    )
    with tifffile.TiffFile(path, mode="r+") as file:
        for page, name, band in zip(file.pages, names, bands, strict=True):
            assert isinstance(page, tifffile.TiffPage)
            # what is longer than its place in the tag goes to the end of the file
            page.tags[_PAGE_NAME].overwrite(name)
            page.tags[_GDAL_METADATA].overwrite(band)


def read_facts(path: Path, /) -> dict[str, str]:
    """Return what the OME-XML of a file says about its maps."""
    with reading_tiff(path), tifffile.TiffFile(path) as file:
        return annotations(file.ome_metadata) if file.ome_metadata else {}


def _envelope(path: Path, maps: DepthMaps) -> Envelope | None:
    """Return what tifffile has written around the pixels of maps; None where these do not lie in one run, as they are."""
    page_bytes = maps.pages[0].nbytes
    with tifffile.TiffFile(path) as file:
        starts = [page.dataoffsets[0] for page in file.pages if page.databytecounts == (page_bytes,)]
        if not starts or starts != [starts[0] + place * page_bytes for place in range(len(maps.pages))]:
            return None
        return Envelope.of(file.filehandle, starts[0], maps.pages.nbytes)


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the pages of an OME-TIFF by the names of its channels.

    Raises:
        FrameError: the file cannot be read, is damaged, or its channels have no names.
    """
    with closing(TiffImages(path, voltages=False)) as images:
        planes = images.planes(np.arange(math.prod(images.sizes)))
        names = [name for name in images.names if name]
    if not names or len(names) != len(planes):
        raise FrameError(f"{path}: found {len(planes)} pages, expected an OME-TIFF of maps with a name for each")
    return dict(zip(names, planes, strict=True))
