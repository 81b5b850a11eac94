"""OME-XML: names that other software wrote are found, our own XML is that of version 0.1.0, and nothing takes long."""

import time
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import MapHeader
from cadtof_cli.files.tiff.ome import channel_names, ome_xml
from cadtof_cli.version import __version__
from tests.files.forms import known_frame
from tests.files.refusals import LAYOUT, message

HEADER = MapHeader()

WRITTEN_BY_0_1_0 = (
    '<?xml version="1.0" encoding="UTF-8"?>'
    '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"'
    ' xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xsi:schemaLocation="http://www.openmicroscopy.org/Schemas/OME/2016-06'
    ' http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd" Creator="cadtof 0.1.0">'
    '<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="float" BigEndian="false"'
    ' SizeX="320" SizeY="240" SizeC="2" SizeZ="1" SizeT="1">'
    '<Channel ID="Channel:0:0" Name="direct.depth" SamplesPerPixel="1"/>'
    '<Channel ID="Channel:0:1" Name="status" SamplesPerPixel="1"/>'
    "<TiffData/></Pixels></Image></OME>"
)


def test_the_description_of_maps_is_that_of_earlier_versions() -> None:
    expected = WRITTEN_BY_0_1_0.replace("cadtof 0.1.0", f"cadtof {__version__}")
    assert ome_xml(("direct.depth", "status"), size=(240, 320), header=HEADER) == expected


def test_names_that_need_escaping_come_back() -> None:
    names = ("a < b & c", "with \"quotes\" and 'more'", "slash /> inside", "µV")
    assert channel_names(ome_xml(names, size=(2, 3), header=HEADER)) == names


@pytest.mark.parametrize("prefix", ["", "ome:"])
def test_names_with_and_without_a_namespace_prefix(prefix: str) -> None:
    space = f'xmlns{":ome" if prefix else ""}="http://www.openmicroscopy.org/Schemas/OME/2016-06"'
    xml = (
        f"<{prefix}OME {space}><{prefix}Image><{prefix}Pixels><{prefix}Channel Name='H2.SC1'/><{prefix}Channel/>"
        f"<!-- <Channel Name='not this one'/> --></{prefix}Pixels></{prefix}Image></{prefix}OME>"
    )
    assert channel_names(xml) == ("H2.SC1", "")


def test_names_that_tifffile_wrote(tmp_path: Path) -> None:
    planes = np.random.default_rng(0).uniform(size=(2, 5, 7)).astype("f4")
    tifffile.imwrite(
        tmp_path / "truth.tif", planes, ome=True, photometric="minisblack",
        metadata={"axes": "CYX", "Channel": {"Name": ["direct.depth", "a & b"]}},
    )  # fmt: skip
    layers = read_layers(tmp_path / "truth.tif")
    assert list(layers) == ["direct.depth", "a & b"]
    np.testing.assert_array_equal(layers["a & b"], planes[1])


NAMES_OF_IMAGES = {
    "a plane an image": (["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"], None),
    "a plane an image, in words": (["sc1 25 MHz", "sc2 25 MHz", "sc1 50 MHz", "sc2 50 MHz"], ["DAPI"] * 4),
    "images are harmonics": (["H1", "H1", "H2", "H2"], ["SC1", "SC2"] * 2),
    "images are periods": (["40 ns", "40 ns", "20 ns", "20 ns"], ["I", "Q"] * 2),
    "names of channels win": (["H2", "H2", "H1", "test 40 ns"], ["H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2"]),
}
"""Names of four images in the order H1.SC1, H1.SC2, H2.SC1, H2.SC2, and the names of their channels."""


@pytest.mark.parametrize("names", NAMES_OF_IMAGES.values(), ids=NAMES_OF_IMAGES)
def test_names_of_images_say_which_plane_they_hold(names: tuple[list[str], list[str] | None], tmp_path: Path) -> None:
    images, channels = names
    frame, path = known_frame("u2"), tmp_path / "frame.tif"
    with tifffile.TiffWriter(path, ome=True) as writer:
        for place in (3, 1, 0, 2):
            channel = {"Channel": {"Name": channels[place]}} if channels else {}
            writer.write(
                frame.reshape(4, *frame.shape[2:])[place], photometric="minisblack",
                metadata={"axes": "YX", "Name": images[place], **channel},
            )  # fmt: skip
    np.testing.assert_array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), frame)


def test_an_image_for_each_harmonic(tmp_path: Path) -> None:
    frame, path = known_frame("u2"), tmp_path / "frame.tif"
    with tifffile.TiffWriter(path, ome=True) as writer:
        for harmonic in (2, 1):
            metadata = {"axes": "CYX", "Name": f"H{harmonic}", "Channel": {"Name": ["SC1", "SC2"]}}
            writer.write(frame[harmonic - 1], photometric="minisblack", metadata=metadata)
    np.testing.assert_array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), frame)


def test_the_name_of_a_lone_image_is_no_name_of_planes(tmp_path: Path) -> None:
    frame, path = known_frame("u2"), tmp_path / "frame.tif"
    metadata = {"axes": "ZCYX", "Name": "H2 test, 40 ns", "Channel": {"Name": ["SC1", "SC2"]}}
    tifffile.imwrite(path, frame, ome=True, photometric="minisblack", metadata=metadata)
    np.testing.assert_array_equal(read_stored(FrameSource("frame", (path,)), LAYOUT), frame)


def test_a_long_description_takes_no_longer_than_a_short_one(tmp_path: Path) -> None:
    # a regular expression took a minute to search 130 kB of channel tags that are never closed
    path = tmp_path / "frame.tif"
    description = '<?xml version="1.0"?><OME>' + '<Channel ID="Channel:0:0" ' * 5000 + "</OME>"
    tifffile.imwrite(path, np.zeros((4, 5, 7), "u2"), photometric="minisblack", description=description, metadata=None)
    began = time.process_time()
    assert message(path).startswith(f"{path}: damaged TIFF: ")
    assert time.process_time() - began < 5
