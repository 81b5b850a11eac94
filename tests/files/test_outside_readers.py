"""Other people's software finds in our maps the names and values that were written."""

import re
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import wanted_layers
from tests.conftest import Tool
from tests.support.captures import MAP_LAYERS, write_maps

HEIGHT, WIDTH = 6, 10


@pytest.fixture
def maps() -> DepthMaps:
    """Return maps in which every value differs, with a pixel of NaN and 60 combinations of status bits."""
    made = DepthMaps.empty(tuple(layer.name for layer in wanted_layers()), (HEIGHT, WIDTH))
    made.values[:] = np.random.default_rng(0).uniform(0, 6, made.values.shape)
    made.values[[2, 3, 6]] /= 6
    made.values[:, 2, 3] = np.nan
    made.status[:] = np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) * 4 % 256
    return made


def _expected(maps: DepthMaps) -> dict[str, NDArray[np.float32]]:
    return {name: maps.layer(name) for name in maps.names} | {"status": maps.status.astype(np.float32)}


@pytest.fixture(params=[".exr", ".tif"])
def written(request: pytest.FixtureRequest, maps: DepthMaps, tmp_path: Path) -> Path:
    path = tmp_path / f"maps{request.param}"
    write_maps(path, maps)
    return path


@pytest.fixture
def tif(maps: DepthMaps, tmp_path: Path) -> Path:
    write_maps(tmp_path / "maps.tif", maps)
    return tmp_path / "maps.tif"


@pytest.fixture
def exr(maps: DepthMaps, tmp_path: Path) -> Path:
    write_maps(tmp_path / "maps.exr", maps)
    return tmp_path / "maps.exr"


def test_our_own_reader_returns_the_maps_that_were_written(written: Path, maps: DepthMaps) -> None:
    layers = read_layers(written)
    assert sorted(layers) == sorted(MAP_LAYERS)
    for name, values in _expected(maps).items():
        np.testing.assert_array_equal(layers[name], values)


def test_the_same_maps_give_the_same_bytes(written: Path, maps: DepthMaps, tmp_path: Path) -> None:
    again = tmp_path / f"again{written.suffix}"
    write_maps(again, maps)
    assert again.read_bytes() == written.read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {written.name, again.name}


def test_tifffile_finds_the_names_and_one_series(tif: Path, maps: DepthMaps) -> None:
    with tifffile.TiffFile(tif) as file:
        assert file.is_ome
        (series,) = file.series
        assert series.axes == "CYX"
        assert series.dtype == np.float32
        assert file.ome_metadata is not None
        pixels = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]["Pixels"]
        assert tuple(channel["Name"] for channel in pixels["Channel"]) == MAP_LAYERS
        np.testing.assert_array_equal(series.asarray(), np.stack([_expected(maps)[name] for name in MAP_LAYERS]))


def test_libtiff_reads_every_page(tif: Path, tool: Tool) -> None:
    text = tool("tiffinfo", tif)
    assert text.count("TIFF Directory at offset") == len(MAP_LAYERS)
    assert text.count(f"Image Width: {WIDTH} Image Length: {HEIGHT}") == len(MAP_LAYERS)
    assert text.count("Sample Format: IEEE floating point") == len(MAP_LAYERS)


def test_libtiff_copies_the_values(tif: Path, maps: DepthMaps, tool: Tool, tmp_path: Path) -> None:
    tool("tiffcp", tif, tmp_path / "copy.tif")
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "copy.tif"), np.stack([_expected(maps)[name] for name in MAP_LAYERS])
    )


def test_imagemagick_extracts_a_value(tif: Path, maps: DepthMaps, tool: Tool) -> None:
    assert tool("identify", "-format", "%w %h\n", tif).split() == [str(WIDTH), str(HEIGHT)] * len(MAP_LAYERS)
    # builds with 16 bits per value keep values between 0 and 1 only, and the voltages of these layers are
    for page, name in ((2, "direct.amplitude"), (6, "confidence")):
        value = float(tool("identify", "-precision", "9", "-format", "%[fx:p{7,4}]", Path(f"{tif}[{page}]")))
        assert value == pytest.approx(float(maps.layer(name)[4, 7]), abs=1 / 65535)


def test_exr_tools_list_the_channels(exr: Path, tool: Tool) -> None:
    text = tool("exrheader", exr)
    kinds = dict(re.findall(r"^    ([\w.]+), (32-bit [\w -]+), sampling 1 1$", text, re.MULTILINE))
    assert kinds.pop("status") == "32-bit unsigned integer"
    assert kinds == dict.fromkeys(MAP_LAYERS[:-1], "32-bit floating-point")
    assert f"(0 0) - ({WIDTH - 1} {HEIGHT - 1})" in text
    assert 'software (type string): "cadtof ' in text


def test_exr_tools_rewrite_the_values(exr: Path, maps: DepthMaps, tool: Tool, tmp_path: Path) -> None:
    copy = tmp_path / "tiled.exr"
    tool("exrmaketiled", "-z", "zip", "-t", "4", "4", exr, copy)
    with OpenEXR.File(str(copy), separate_channels=True) as file:
        assert file.header()["type"] == OpenEXR.tiledimage
        channels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
    assert channels["status"].dtype == np.uint32
    for name, values in _expected(maps).items():
        np.testing.assert_array_equal(channels[name], values)
