"""OME-XML: names that other software wrote are found, our own XML is that of version 0.1.0, and nothing takes long."""

import time
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import MapHeader
from cadtof_cli.files.tiff.layers import ome_xml
from cadtof_cli.files.tiff.names import channel_names
from cadtof_cli.version import __version__
from tests.files.refusals import message

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


def test_a_long_description_takes_no_longer_than_a_short_one(tmp_path: Path) -> None:
    # a regular expression took a minute to search 130 kB of channel tags that are never closed
    path = tmp_path / "frame.tif"
    description = '<?xml version="1.0"?><OME>' + '<Channel ID="Channel:0:0" ' * 5000 + "</OME>"
    tifffile.imwrite(path, np.zeros((4, 5, 7), "u2"), photometric="minisblack", description=description, metadata=None)
    began = time.monotonic()
    assert message(path).startswith(f"{path}: damaged TIFF: ")
    assert time.monotonic() - began < 5
