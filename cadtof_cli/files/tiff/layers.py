"""Named layers as OME-TIFF: one float32 page each, the status bits of maps as whole numbers in the last."""

from pathlib import Path
from typing import Any

import tifffile
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.maps import STATUS, DepthMaps
from cadtof_cli.files.tiff.images import reading_tiff
from cadtof_cli.files.tiff.ome import channel_names, ome_xml


def write_maps(path: Path, maps: DepthMaps, /, *, software: str) -> None:
    """Write the maps to `path`; no date and no random identifier goes in."""
    maps.pages[-1] = maps.status
    height, width = maps.status.shape
    tifffile.imwrite(
        path,
        maps.pages,
        photometric="minisblack",
        description=ome_xml((*maps.names, STATUS), size=(height, width), software=software),
        software=software,
        metadata=None,
    )


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
