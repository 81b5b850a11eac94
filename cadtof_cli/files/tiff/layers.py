"""Named layers as OME-TIFF: one float32 page each, the status bits of maps as whole numbers in the last."""

from pathlib import Path
from typing import Any

import tifffile
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.maps import STATUS, DepthMaps, MapsAbout
from cadtof_cli.files.tiff.images import reading_tiff
from cadtof_cli.files.tiff.ome import annotations, channel_names, gdal_xml, ome_xml

_PAGE_NAME, _GDAL_METADATA, _ASCII = 285, 42112, 2


def write_maps(path: Path, maps: DepthMaps, /, *, about: MapsAbout) -> None:
    """Write the maps to `path`; no date and no random identifier goes in.

    OME-XML in front says what the pages are; each page has its name too, as a page name and as the description of a band, since
    GDAL and what is built on it (rasterio, QGIS) know a page without the others.
    """
    maps.pages[-1] = maps.status
    names = (*maps.names, STATUS)
    with tifffile.TiffWriter(path) as writer:
        for index, (name, page) in enumerate(zip(names, maps.pages, strict=True)):
            band = gdal_xml(name, about.units.get(name, ""), about.facts if index == 0 else {})
            writer.write(
                page,
                photometric="minisblack",
                description=ome_xml(names, size=maps.status.shape, about=about) if index == 0 else None,
                software=about.facts["software"] if index == 0 else None,
                metadata=None,
                contiguous=False,
                extratags=[(_PAGE_NAME, _ASCII, None, name, True), (_GDAL_METADATA, _ASCII, None, band, True)],
            )


def read_facts(path: Path, /) -> dict[str, str]:
    """Return what the OME-XML of a file says about its maps."""
    with reading_tiff(path), tifffile.TiffFile(path) as file:
        return annotations(file.ome_metadata) if file.ome_metadata else {}


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the pages of an OME-TIFF by the names of its channels.

    Raises:
        FrameError: the file cannot be read, is damaged, or its channels have no names.
    """
    with reading_tiff(path), tifffile.TiffFile(path) as file:
        names = channel_names(file.ome_metadata) if file.ome_metadata else ()
        planes = [page.asarray() for page in file.pages]
    if not names or len(names) != len(planes):
        raise FrameError(
            f"{path}: found {len(planes)} pages and {len(names)} channel names, expected an OME-TIFF of named maps"
        )
    return dict(zip(names, planes, strict=True))
