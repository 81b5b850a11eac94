"""Named layers as OME-TIFF: one float32 page per layer. The last page of maps holds the status bits as whole numbers.

OME-XML in the first page says what all pages are. Each page also has its own name, as a page name and as the
description of a GDAL band, because GDAL and programs that use it (rasterio, QGIS) read one page without the other
pages.
"""

import math
import os
import threading
from collections.abc import Mapping, Sequence
from contextlib import closing
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


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader) -> Sequence[memoryview]:
    """Write the maps to `path`, which is an empty file, or return the parts of the file for the caller to write.

    The file holds no date and no random identifier. Files of maps with the same names, size and facts differ only in
    their pixels and in the name of the recorded frame. So tifffile writes the first file, and its envelope is used for
    the next.
    """
    maps.pages[-1] = maps.status
    others = {name: text for name, text in header.facts.items() if name != SOURCE}
    # the name of the recorded frame as both kinds of XML hold it, with the characters before and after it, which make
    # it unique
    name = header.facts.get(SOURCE, "").translate(_REFERENCES)
    source = f'source">{name}<'.encode("ascii", "xmlcharrefreplace")
    kind = (maps.names, maps.pages.shape, others, dict(header.units), len(source))
    if _last.kind == kind and _last.envelope:
        return _last.envelope.around(maps.pages, maps.image, old=_last.source, new=source)
    _last.kind, _last.source, _last.envelope = kind, source, _write_pages(path, maps, header)
    return ()


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
    """Return the pages of an OME-TIFF by the names of its channels; NaN where GDAL's value for no data stands for no answer."""
    with closing(TiffImages(path, voltages=False)) as images:
        planes = images.planes(np.arange(math.prod(images.sizes)))
        names = [name for name in images.names if name]
        no_data = images.no_data
    if not names or len(names) != len(planes):
        raise NotMapsError(
            f"{path}: found {counted(len(planes), 'page')} without the names of maps, expected an OME-TIFF as `cadtof resolve` "
            "writes it"
        )
    require_different_names(path, names)
    layers = dict(zip(names, planes, strict=True))
    if planes.dtype.kind == "f" and not math.isnan(no_data):
        with np.errstate(over="ignore"):
            absent = planes.dtype.type(no_data)
        for name in layers.keys() - {STATUS}:
            layers[name][layers[name] == absent] = np.nan
    return layers
