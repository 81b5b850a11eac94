"""Named layers as OME-TIFF: one float32 page per layer. The last page of maps holds the status bits as whole numbers.

OME-XML in the first page says what all pages are. Each page also has its own name, as a page name and as the
description of a GDAL band, because GDAL and programs that use it (rasterio, QGIS) read one page without the other
pages.
"""

import math
import os
import threading
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import tifffile
from numpy.typing import NDArray

from cadtof_cli.files.maps import SOFTWARE, SOURCE, STATUS, DepthMaps, MapHeader, NotMapsError, require_different_names
from cadtof_cli.files.system import BLOCK_BYTES, codes_of_the_system
from cadtof_cli.files.tiff.envelope import Envelope
from cadtof_cli.files.tiff.images import TiffImages
from cadtof_cli.files.tiff.names import GDAL_METADATA, PAGE_NAME
from cadtof_cli.files.tiff.ome import facts_in, ome_xml
from cadtof_cli.files.tiff.remarks import reading_tiff
from cadtof_cli.records import dataclass
from cadtof_cli.units import counted

_ASCII = 2

_REFERENCES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


class _LastWritten(threading.local):
    """The last file of maps that this thread wrote.

    `kind` is everything but pixels and source that the file depends on, `source` is the frame's name as it stands in
    the file, and `envelope` is the bytes around the pixels.
    """

    kind: object = None
    source: bytes = b""
    envelope: Envelope | None = None


_last = _LastWritten()


@dataclass(frozen=True)
class _Read:
    """A file of maps that was read: the stem of its name, and all that another file with the same envelope shares with it."""

    stem: str
    names: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    no_data: float
    envelope: Envelope | None

    def planes_like_it(self, path: Path, /) -> NDArray[Any] | None:
        """Return the pages of a file that differs from this one only in its pixels and its name; None: it is another file."""
        if self.envelope is None:
            return None
        envelope = self.envelope.replaced(_as_source(self.stem), _as_source(path.stem))
        # an error is ignored here: reading the file with tifffile finds it too and raises a better message
        with suppress(OSError, ValueError, MemoryError):
            return envelope.read(path, shape=self.shape, dtype=self.dtype)
        return None


class _LastRead(threading.local):
    """The last file of maps that this thread read in each of two folders: `cadtof compare` reads those of two runs in turns."""

    def __init__(self) -> None:
        self._files = dict[Path, _Read]()

    def get(self, folder: Path, /) -> _Read | None:
        """Return the last file in a folder."""
        return self._files.get(folder)

    def keep(self, folder: Path, file: _Read, /) -> None:
        """Keep a file, and at most one of another folder."""
        self._files = dict([*self._files.items()][-1:]) | {folder: file}


_last_read = _LastRead()


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader) -> Sequence[memoryview]:
    """Write the maps to `path`, which is an empty file, or return the parts of the file for the caller to write.

    The file holds no date and no random identifier. Files of maps with the same names, size and facts differ only in
    their pixels and in the name of the recorded frame. So tifffile writes the first file, and its envelope is used for
    the next.
    """
    maps.pages[-1] = maps.status
    others = {name: text for name, text in header.facts.items() if name != SOURCE}
    # with the character after it, which makes it unique
    source = _as_source(header.facts.get(SOURCE, "")) + b"<"
    kind = (maps.names, maps.pages.shape, others, dict(header.units), len(source))
    if _last.kind == kind and _last.envelope:
        return _last.envelope.around(maps.pages, maps.image, old=_last.source, new=source)
    _last.kind, _last.source, _last.envelope = kind, source, _write_pages(path, maps, header)
    return ()


def _as_source(name: str) -> bytes:
    """Return the name of a recorded frame as both kinds of XML hold it, with the characters before it."""
    return f'source">{name.translate(_REFERENCES)}'.encode("ascii", "xmlcharrefreplace")


def _write_pages(path: Path, maps: DepthMaps, header: MapHeader) -> Envelope | None:
    """Write a file with tifffile, with all pixels in one run; then write the names of the pages into their tags.

    The pixels begin at a disk block and the file ends with a whole disk block, so that the next files can be written
    without the page cache. Return the envelope of the file; None: it is too large, or the pixels are not in one run.
    """
    names = (*maps.names, STATUS)
    bands = [
        _gdal_xml(name, header.units.get(name, ""), {} if place else header.facts) for place, name in enumerate(names)
    ]
    with codes_of_the_system(path, maps.pages.nbytes):
        tifffile.imwrite(
            path,
            maps.pages,
            photometric="minisblack",
            description=ome_xml(names, size=maps.status.shape, header=header),
            software=SOFTWARE,
            metadata=None,
            align=BLOCK_BYTES,
            extratags=[(code, _ASCII, None, " ", False) for code in (PAGE_NAME, GDAL_METADATA)],
        )
    with tifffile.TiffFile(path, mode="r+") as file:
        pages, page_bytes = list(file.pages), maps.status.nbytes
        for page, name, band in zip(pages, names, bands, strict=True):
            assert isinstance(page, tifffile.TiffPage)
            # tifffile writes a value that does not fit into the place of the old one to the end of the file
            page.tags[PAGE_NAME].overwrite(name)
            page.tags[GDAL_METADATA].overwrite(band if name != STATUS else _at_end_of_block(file.filehandle, band))
        starts = [page.dataoffsets[0] for page in pages if page.databytecounts == (page_bytes,)]
        if starts != [pages[0].dataoffsets[0] + place * page_bytes for place in range(len(maps.pages))]:
            return None
        return Envelope.of(file.filehandle, starts[0], maps.pages.nbytes)


def _at_end_of_block(file: tifffile.FileHandle, text: str) -> str:
    """Lengthen a file so that it ends with a whole disk block once the text and a zero byte follow; return the text.

    A blank is added to the text if text and zero byte together have an odd length, because values in TIFF begin at even
    places.
    """
    text += " " * ((len(text) + 1) % 2)
    end = file.seek(0, os.SEEK_END)
    file.write(bytes(-(end + len(text) + 1) % BLOCK_BYTES))
    return text


def _gdal_xml(name: str, unit: str, facts: Mapping[str, str]) -> str:
    """Return GDAL's metadata of one band as XML: its name, its unit, and facts about the file."""
    root = ElementTree.Element("GDALMetadata")
    for key, text in facts.items():
        ElementTree.SubElement(root, "Item", {"name": key}).text = text
    for key, text in (("description", name), ("unittype", unit)):
        if text:
            ElementTree.SubElement(root, "Item", {"name": key.upper(), "sample": "0", "role": key}).text = text
    # texts in TIFF are ASCII; without an encoding, `tostring` gives ASCII with references for other characters
    return ElementTree.tostring(root).decode()


def read_facts(path: Path, /) -> dict[str, str]:
    """Return the facts about the maps that the OME-XML of a file holds, by name."""
    with reading_tiff(path), tifffile.TiffFile(path) as file:
        return facts_in(file.ome_metadata or "")


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the pages of an OME-TIFF by the names of its channels; NaN where GDAL's value for no data stands for no answer.

    The maps of a run differ only in their pixels and in the name of the recorded frame, which is that of the map. So of the
    maps in a folder, only the first is read with tifffile and our checks.
    """
    last = _last_read.get(path.parent)
    planes = last.planes_like_it(path) if last else None
    if last is None or planes is None:
        last, planes = _read_pages(path)
        _last_read.keep(path.parent, last)
    layers = dict(zip(last.names, planes, strict=True))
    if planes.dtype.kind == "f" and not math.isnan(last.no_data):
        with np.errstate(over="ignore"):
            absent = planes.dtype.type(last.no_data)
        for name in layers.keys() - {STATUS}:
            layers[name][layers[name] == absent] = np.nan
    return layers


def _read_pages(path: Path) -> tuple[_Read, NDArray[Any]]:
    """Return what is known of a file for the next one, and its pages."""
    with closing(TiffImages(path, voltages=False)) as images:
        places = np.arange(math.prod(images.sizes))
        planes = images.planes(places)
        names = tuple(name for name in images.names if name)
        if not names or len(names) != len(planes):
            raise NotMapsError(
                f"{path}: found {counted(len(planes), 'page')} without the names of maps, expected an OME-TIFF as "
                "`cadtof resolve` writes it"
            )
        require_different_names(path, names)
        return _Read(path.stem, names, planes.shape, planes.dtype, images.no_data, images.envelope(places)), planes
