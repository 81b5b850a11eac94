"""Metadata of a TIFF may come from anywhere: what it promises takes no memory, and the files that it names stay closed."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.errors import UnreadableError
from tests.files.forms import known_frame
from tests.files.refusals import LAYOUT, message


def _described(path: Path, inside: str, *, compression: str | None = None, times: int = 1) -> Path:
    """Write four planes with OME-XML, with `inside` between the tags of Pixels."""
    xml = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        f'<Pixels ID="P:0" DimensionOrder="XYCZT" Type="uint16" SizeX="7" SizeY="5" SizeZ="1" SizeC="4" SizeT="{times}">{inside}'
        "</Pixels></Image></OME>"
    )
    planes = known_frame("u2", shape=(5, 7)).reshape(4, 5, 7)
    tifffile.imwrite(path, planes, photometric="minisblack", description=xml, metadata=None, compression=compression)
    return path


@pytest.mark.parametrize(
    ("inside", "times"),
    [
        ('<TiffData IFD="0" PlaneCount="1000000000"/>', 1),
        ('<TiffData IFD="0" NumPlanes="1000000000"/>', 1),
        ("<TiffData/>", 100_000_000),
    ],
)
def test_metadata_that_promises_endless_planes_takes_no_memory(tmp_path: Path, inside: str, times: int) -> None:
    """A file of a kilobyte took 15 GB."""
    path = _described(tmp_path / "frame.ome.tif", inside, times=times)
    assert "0,000,000 planes, found a file of " in message(path)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_metadata_that_names_another_file_does_not_lead_there(tmp_path: Path, compression: str | None) -> None:
    """Compressed planes were read from that file, wherever it was: a file from one sender showed the frame of another."""
    other = _described(tmp_path / "other.tif", "<TiffData/>", compression=compression)
    (tmp_path / "sent").mkdir()
    # tifffile writes ASCII only
    name = str(other).encode("ascii", "xmlcharrefreplace").decode()
    uuid = f'<TiffData IFD="0" PlaneCount="4"><UUID FileName="{name}">urn:uuid:other</UUID></TiffData>'
    path = _described(tmp_path / "sent" / "frame.ome.tif", uuid)
    assert "its OME metadata spreads it over several files, expected all planes in one file" in message(path)


def test_metadata_that_names_a_fifo_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    uuid = '<TiffData IFD="0" PlaneCount="4"><UUID FileName="fifo">urn:uuid:other</UUID></TiffData>'
    assert "spreads it over several files" in message(_described(tmp_path / "frame.ome.tif", uuid))


def test_metadata_may_name_its_own_file(tmp_path: Path) -> None:
    uuid = '<TiffData IFD="0" PlaneCount="4"><UUID FileName="frame.ome.tif">urn:uuid:own</UUID></TiffData>'
    path = _described(tmp_path / "frame.ome.tif", uuid)
    assert read_stored(FrameSource("frame", (path,)), LAYOUT).shape == (2, 2, 5, 7)


def test_an_axis_with_endless_labels_takes_no_memory(tmp_path: Path) -> None:
    path = _described(tmp_path / "frame.ome.tif", "<TiffData/>")
    labels = (
        '<StructuredAnnotations><XMLAnnotation ID="A:0" Namespace="openmicroscopy.org/omero/dimension/modulo"><Value><Modulo>'
        '<ModuloAlongT Type="lifetime" Start="0" End="1e9" Step="1e-3"/></Modulo></Value></XMLAnnotation></StructuredAnnotations>'
    )
    with tifffile.TiffFile(path, mode="r+") as file:
        tag = file.pages.first.tags["ImageDescription"]
        tag.overwrite(tag.value.replace("</OME>", f"{labels}</OME>"))
    assert "its metadata promises 1,000,000,000,000 planes" in message(path)


def _micromanager_file(path: Path, planes: np.ndarray, *, first: int, frames: int) -> None:
    """Write planes, uint16 (n, Y, X), as the frames from `first` on of a Micro-Manager stack of several files."""
    summary = json.dumps({"MicroManagerVersion": "1.4", "Frames": frames, "Prefix": "x"}).encode()
    height, width = planes.shape[1:]
    size = planes[0].nbytes
    start = 40 + len(summary) + 8 + 20 * len(planes)
    # the pixels of a page begin 162 bytes after its directory
    places = [start + k * (162 + size) for k in range(len(planes))]
    head = struct.pack(
        "<2sHI8I", b"II", 42, start, 54773648, 40 + len(summary), 483765892, 0, 99384722, 0, 2355492, len(summary)
    )
    index = struct.pack("<2I", 3453623, len(planes))
    index += b"".join(struct.pack("<5I", 0, 0, first + k, 0, place) for k, place in enumerate(places))
    pages = b""
    for place, following, plane in zip(places, [*places[1:], 0], planes, strict=True):
        tags = {256: width, 257: height, 258: 16, 259: 1, 262: 1, 273: place + 162, 277: 1, 278: height, 279: size}
        entries = [struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items()]
        entries.append(struct.pack("<HHII", 51123, 2, len(summary), 40))
        pages += struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", following)
        pages = pages.ljust(place + 162 - start, b"\0") + plane.astype("<u2").tobytes()
    path.write_bytes(head + summary + index + pages)


def test_a_stack_of_micromanager_over_two_files_is_not_called_ome(tmp_path: Path) -> None:
    planes = known_frame("u2", shape=(5, 8)).reshape(4, 5, 8)
    for number in (0, 1):
        part = planes[2 * number : 2 * number + 2]
        _micromanager_file(tmp_path / f"x_MMStack_{number}.tif", part, first=2 * number, frames=4)
    told = message(tmp_path / "x_MMStack_0.tif")
    assert "its metadata spreads it over several files, expected all planes in one file" in told


def test_a_stack_of_micromanager_that_promises_endless_frames_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "x_MMStack_0.tif"
    _micromanager_file(path, np.zeros((2, 5, 7), np.uint16), first=0, frames=10**9)
    assert "its metadata promises 1,000,000,000 planes, found a file of " in message(path)


def test_a_fifo_with_the_name_of_a_stack_of_micromanager_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "x_MMStack_0.tif"
    _micromanager_file(path, np.zeros((2, 5, 7), np.uint16), first=0, frames=4)
    os.mkfifo(tmp_path / "x_MMStack_1.tif")
    assert message(path, kind=UnreadableError) == f"{path}: cannot be read: found a FIFO, expected a file"
