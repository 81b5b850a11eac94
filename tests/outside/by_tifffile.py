"""Cases that tifffile writes."""

from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from cadtof_cli.arrays import Stored
from tests.outside.cases import SHUFFLED, Case, Writer, planes_of, shuffled_planes
from tests.support.captures import PLANE_NAMES


def _whole(axes: tuple[int, ...] = (0, 1, 2, 3), **options: Any) -> Writer:
    """Return a writer that transposes the axes of a frame and writes it by one call."""

    def write(folder: Path, frame: Stored) -> Path:
        data = np.ascontiguousarray(frame.transpose(axes))
        tifffile.imwrite(folder / "frame.tif", data, **{"photometric": "minisblack", **options})
        return folder / "frame.tif"

    return write


def _stack(*, shuffled: bool = False, **options: Any) -> Writer:
    """Return a writer of four pages by one call."""

    def write(folder: Path, frame: Stored) -> Path:
        pages = np.stack(shuffled_planes(frame) if shuffled else planes_of(frame))
        tifffile.imwrite(folder / "frame.tif", pages, **{"photometric": "minisblack", **options})
        return folder / "frame.tif"

    return write


def _named_pages(tag: int) -> Writer:
    """Return a writer of four pages in the order `SHUFFLED`; a tag of each page holds its name."""

    def write(folder: Path, frame: Stored) -> Path:
        with tifffile.TiffWriter(folder / "frame.tif") as writer:
            for name, plane in zip(SHUFFLED, shuffled_planes(frame), strict=True):
                named: dict[str, Any] = {"extratags": [(tag, 2, None, name, True)]}
                writer.write(plane, photometric="minisblack", metadata=None, **named)
        return folder / "frame.tif"

    return write


def _last_axis(**options: Any) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        data = np.ascontiguousarray(np.stack(planes_of(frame), axis=-1))
        tifffile.imwrite(folder / "frame.tif", data, **options)
        return folder / "frame.tif"

    return write


def _pyramid(folder: Path, frame: Stored) -> Path:
    with tifffile.TiffWriter(folder / "frame.tif") as writer:
        for plane in planes_of(frame):
            writer.write(plane, photometric="minisblack", subifds=1, metadata=None)
            writer.write(plane[::2, ::2], photometric="minisblack", subfiletype=1, metadata=None)
    return folder / "frame.tif"


def _planes(folder: Path, frame: Stored) -> tuple[Path, ...]:
    files = tuple(folder / f"{name}.tif" for name in PLANE_NAMES)
    for file, plane in zip(files, planes_of(frame), strict=True):
        tifffile.imwrite(file, plane, photometric="minisblack")
    return files


def _foreign_tag(folder: Path, frame: Stored) -> Path:
    """Write private tags of a maker: whole numbers, a text that is no UTF-8, and a number where readers expect text."""
    tags = [(65000, 4, 3, (1, 2, 3), True), (65001, 2, None, b"\xff\xfe\x80", True), (51023, 4, 1, 7, True)]
    tifffile.imwrite(
        folder / "frame.tif", np.stack(planes_of(frame)), photometric="minisblack", metadata=None, extratags=tags
    )
    return folder / "frame.tif"


def _numbered_description(folder: Path, frame: Stored) -> Path:
    tags = [(270, 4, 1, 12, True), (285, 3, 1, 4, True)]
    tifffile.imwrite(
        folder / "frame.tif", np.stack(planes_of(frame)), photometric="minisblack", metadata=None, extratags=tags
    )
    return folder / "frame.tif"


def _in_several_files(folder: Path, frame: Stored) -> Path:
    """Write an OME-TIFF whose description says that the second harmonic is in another file."""
    path = folder / "frame.tif"
    tifffile.imwrite(path, frame[:1], ome=True, photometric="minisblack", metadata={"axes": "ZCYX"})
    xml = tifffile.tiffcomment(path)
    assert isinstance(xml, str)
    other = (
        '<TiffData FirstC="0" FirstZ="1" IFD="0" PlaneCount="2"><UUID FileName="other.tif">urn:uuid:1</UUID></TiffData>'
    )
    xml = xml.replace('SizeZ="1"', 'SizeZ="2"').replace("</Pixels>", f"{other}</Pixels>")
    tifffile.tiffcomment(path, xml)
    return path


def _of_two_sizes(folder: Path, frame: Stored) -> Path:
    with tifffile.TiffWriter(folder / "frame.tif") as writer:
        for plane in (*planes_of(frame[:1]), *planes_of(frame[1:, :, 1:])):
            writer.write(plane, photometric="minisblack", metadata=None)
    return folder / "frame.tif"


def _stored_in_two_ways(folder: Path, frame: Stored) -> Path:
    """Write four pages; every second page is compressed and in strips of another height."""
    with tifffile.TiffWriter(folder / "frame.tif") as writer:
        for index, plane in enumerate(planes_of(frame)):
            options: dict[str, Any] = {"rowsperstrip": 5, "compression": "zlib"} if index % 2 else {}
            writer.write(plane, photometric="minisblack", metadata=None, **options)
    return folder / "frame.tif"


_OME: dict[str, Any] = {"ome": True}
_LABELS = {"axes": "ZYX", "Labels": list(SHUFFLED)}
_NAMES = {"Channel": {"Name": list(SHUFFLED)}}

CASES = [
    Case("tifffile", "axes H C Y X", _whole(metadata={"axes": "HCYX"})),
    Case("tifffile", "axes C H Y X", _whole((1, 0, 2, 3), metadata={"axes": "CHYX"})),
    Case("tifffile", "axes Y X C H", _whole((2, 3, 1, 0), metadata={"axes": "YXCH"})),
    Case("tifffile", "axes Y X H C", _whole((2, 3, 0, 1), metadata={"axes": "YXHC"})),
    Case("tifffile", "axes H Y X C, float32", _whole((0, 2, 3, 1), metadata={"axes": "HYXC"}), "f4"),
    Case("tifffile", "axes X Y H C", _whole((3, 2, 0, 1), metadata={"axes": "XYHC"})),
    Case("tifffile", "no axes said", _whole()),
    Case("tifffile", "four pages, no metadata", _stack(metadata=None)),
    Case("tifffile", "one page for all (truncate)", _whole(truncate=True)),
    Case("tifffile", "big-endian BigTIFF, float64", _stack(bigtiff=True, byteorder=">"), "f8"),
    Case("tifffile", "LZW with predictor, float32", _stack(compression="lzw", predictor=True), "f4"),
    Case("tifffile", "Zstandard", _stack(compression="zstd")),
    Case("tifffile", "LZMA", _stack(compression="lzma")),
    Case("tifffile", "PackBits", _stack(compression="packbits")),
    Case("tifffile", "JPEG XL, lossless", _stack(compression="jpegxl")),
    Case("tifffile", "tiles, deflate, half floats", _stack(compression="zlib", tile=(16, 16)), "f2"),
    Case("tifffile", "with a pyramid in each page", _pyramid),
    Case("tifffile", "OME, axes Z C", _whole(**_OME, metadata={"axes": "ZCYX"})),
    Case("tifffile", "OME, channel names in another order", _stack(shuffled=True, **_OME, metadata={"axes": "CYX", **_NAMES})),
    Case(
        "tifffile", "OME, channels DAPI, GFP, Cy3, Cy5",
        _stack(**_OME, metadata={"axes": "CYX", "Channel": {"Name": ["DAPI", "GFP", "Cy3", "Cy5"]}}),
    ),
    Case(
        "tifffile", "OME, channels SC2, SC1 of each Z",
        lambda folder, frame: _whole(**_OME, metadata={"axes": "ZCYX", "Channel": {"Name": ["SC2", "SC1"]}})(
            folder, np.ascontiguousarray(frame[:, ::-1])
        ),
    ),
    Case(
        "tifffile", "OME, one name twice",
        _stack(**_OME, metadata={"axes": "CYX", "Channel": {"Name": ["H1.SC1", "H1.SC2", "H1.SC1", "H2.SC2"]}}),
        refused="no channel H2.SC1",
    ),
    Case("tifffile", "OME over two files", _in_several_files, refused="other files"),
    Case("tifffile", "ImageJ hyperstack, Z C", _whole(imagej=True, metadata={"axes": "ZCYX"})),
    Case("tifffile", "ImageJ, slice labels in another order", _stack(shuffled=True, imagej=True, metadata=_LABELS)),
    Case("tifffile", "page names in another order", _named_pages(285)),
    Case("tifffile", "page descriptions in another order", _named_pages(270)),
    Case("tifffile", "four samples a pixel", _last_axis(photometric="minisblack", planarconfig="contig")),
    Case("tifffile", "four samples a pixel, separate", _stack(planarconfig="separate", metadata=None)),
    Case("tifffile", "RGBA", _last_axis(photometric="rgb"), refused="colour picture"),
    Case("tifffile", "min-is-white", _stack(photometric="miniswhite"), refused="min-is-white"),
    Case("tifffile", "a file a plane", _planes),
    Case("tifffile", "every second page compressed", _stored_in_two_ways),
    Case("tifffile", "private tags of a maker", _foreign_tag),
    Case("tifffile", "whole numbers where text belongs", _numbered_description),
    Case("tifffile", "12 bits a sample", _stack(bitspersample=12), refused="12 bits a sample"),
    Case("tifffile", "complex numbers", lambda folder, frame: _stack()(folder, frame.astype("c8")), refused="64 bits"),
    Case("tifffile", "pages that differ", _of_two_sizes, refused="different pages"),
]  # fmt: skip
