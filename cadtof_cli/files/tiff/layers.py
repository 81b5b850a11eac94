"""Named layers as OME-TIFF: one float32 page each, the status bits of maps as whole numbers in the last."""

import threading
from pathlib import Path
from typing import Any

import tifffile
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.maps import STATUS, DepthMaps
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.images import reading_tiff
from cadtof_cli.files.tiff.ome import channel_names, ome_xml


class _Last(threading.local):
    """The names, size and software of the maps that a thread last wrote, and what stands around their pixels."""

    kind: object = None
    envelope: Envelope | None = None


_last = _Last()


def write_maps(path: Path, maps: DepthMaps, /, *, software: str) -> None:
    """Write the maps to `path`; no date and no random identifier goes in.

    So files of maps with the same names and size differ in their pixels alone: tifffile makes the first of them.
    """
    maps.pages[-1] = maps.status
    kind = (maps.names, maps.pages.shape, software)
    if _last.kind == kind and _last.envelope:
        _last.envelope.write(path, maps.pages)
        return
    height, width = maps.status.shape
    tifffile.imwrite(
        path,
        maps.pages,
        photometric="minisblack",
        description=ome_xml((*maps.names, STATUS), size=(height, width), software=software),
        software=software,
        metadata=None,
    )
    _last.kind, _last.envelope = kind, _envelope(path, maps)


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
    with reading_tiff(path), tifffile.TiffFile(path) as file:
        names = channel_names(file.ome_metadata) if file.ome_metadata else ()
        planes = [page.asarray() for page in file.pages]
    if not names or len(names) != len(planes):
        raise FrameError(
            f"{path}: found {len(planes)} pages and {len(names)} channel names, expected an OME-TIFF of named maps"
        )
    return dict(zip(names, planes, strict=True))
