"""The registry of formats: files are known by their first bytes, and every format keeps what its entry promises."""

from pathlib import Path
from typing import Literal

import numpy as np
import OpenEXR
import pytest
import tifffile

from cadtof_cli.errors import OutputError
from cadtof_cli.files.formats import (
    FORMATS,
    FRAME_FORMATS,
    FRAME_SUFFIXES,
    MAP_FORMATS,
    MAP_SUFFIXES,
    Format,
    detect_format,
    frame_suffixes,
    map_format,
)
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.layers import read_layers, write_layers
from cadtof_cli.files.maps import DepthMaps
from tests.files.forms import known_frame
from tests.support.captures import write_maps
from tests.support.loaded import loaded_modules

LAYOUT = FrameLayout((1, 2))


@pytest.mark.parametrize(("byteorder", "bigtiff"), [("<", False), (">", False), ("<", True), (">", True)])
def test_every_kind_of_tiff_is_tiff_whatever_its_name(
    byteorder: Literal["<", ">"], bigtiff: bool, tmp_path: Path
) -> None:
    path = tmp_path / "frame.exr"
    with tifffile.TiffWriter(path, byteorder=byteorder, bigtiff=bigtiff) as writer:
        writer.write(np.zeros((4, 5), "u2"))
    assert detect_format(path).name == "tif"


def test_exr_is_exr_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / "frame.tif"
    OpenEXR.File({}, {"Y": np.zeros((4, 5), "f4")}).write(str(path))
    assert detect_format(path).name == "exr"


def test_the_readme_names_every_format() -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    table = readme.partition("| files | frames |")[2].partition("\n\n")[0]
    unnamed = [one.title for one in FORMATS if one.title not in table]
    assert not unnamed, f"README.md, The capture format, needs a row in its table of files for {', '.join(unnamed)}"
    option = f"`--format {'|'.join((*MAP_FORMATS, 'same'))}`"
    assert option in readme, f"README.md, What comes out, needs {option}"


def test_suffixes_and_formats_are_those_that_are_promised() -> None:
    assert MAP_SUFFIXES == (".exr", ".tif", ".tiff")
    assert (*MAP_SUFFIXES, ".npy") == FRAME_SUFFIXES
    assert frame_suffixes(planes=True, raw=False) == (*FRAME_SUFFIXES, ".png")
    assert frame_suffixes(planes=False, raw=True) == (*FRAME_SUFFIXES, ".raw", ".bin", ".dat")
    assert (FRAME_FORMATS, MAP_FORMATS) == (("tif", "exr"), ("exr", "tif"))


def test_no_two_formats_claim_the_same_file() -> None:
    for claims in ([one.name for one in FORMATS], FRAME_SUFFIXES, [magic for one in FORMATS for magic in one.magics]):
        assert len(set(claims)) == len(claims)


@pytest.mark.parametrize(
    ("frame", "name"),
    [("a.tif", "tif"), ("a.TIFF", "tif"), ("a.exr", "exr"), ("a.EXR", "exr"), ("a", "tif"), ("a.png", "tif")],
)
def test_maps_in_the_format_of_the_frame(frame: str, name: str) -> None:
    assert map_format("same", Path(frame)).name == name
    assert map_format("exr", Path(frame)).name == "exr"


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("kind", [one for one in FORMATS if one.recording], ids=lambda one: one.name)
def test_a_recorded_frame_is_read_back(kind: Format, compress: bool, tmp_path: Path) -> None:
    recorded = known_frame("u2" if kind.recording == "counts" else "f4")
    path = tmp_path / f"frame.{kind.name}"
    kind.frames().write_frame(path, recorded, layout=LAYOUT, compress=compress)
    assert detect_format(path) is kind
    with kind.frames().open_frames(path, LAYOUT) as frames:
        assert (frames.count, frames.shape, frames.dtype) == (1, recorded.shape, recorded.dtype)
        np.testing.assert_array_equal(frames.read(0), recorded)


@pytest.mark.parametrize("name", MAP_FORMATS)
def test_maps_keep_names_values_and_status(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    pages = rng.uniform(0, 6, (3, 5, 7)).astype(np.float32)
    pages[0, 1, 2] = np.nan
    maps = DepthMaps(("direct.depth", "confidence"), pages.copy(), rng.integers(0, 4096, (5, 7), np.uint32))
    path = tmp_path / f"maps.{name}"
    write_maps(path, maps)
    layers = read_layers(path)
    assert set(layers) == {"direct.depth", "confidence", "status"}
    np.testing.assert_array_equal(layers["direct.depth"], pages[0])
    np.testing.assert_array_equal(layers["confidence"], pages[1])
    np.testing.assert_array_equal(layers["status"], maps.status)


def test_layers_are_written_without_loss_unless_lossy_is_asked_for(tmp_path: Path) -> None:
    layer = np.random.default_rng(4).uniform(0.5, 6, (30, 40)).astype(np.float32)
    write_layers(
        tmp_path / "a.exr", {"a.b": layer, "status": np.arange(1200, dtype=np.uint32).reshape(30, 40)[:, ::-1]}
    )
    assert OpenEXR.File(str(tmp_path / "a.exr")).header()["compression"] == OpenEXR.ZIP_COMPRESSION
    written = read_layers(tmp_path / "a.exr")
    np.testing.assert_array_equal(written["a.b"], layer)
    np.testing.assert_array_equal(written["status"][0], np.arange(39, -1, -1))
    write_layers(tmp_path / "b.exr", {"a.b": layer.astype(np.float64)}, lossy=True)
    rounded = read_layers(tmp_path / "b.exr")["a.b"]
    assert rounded.dtype == np.float32
    assert 0 < np.max(np.abs(rounded / layer - 1)) <= 2.0**-16


def test_layers_for_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"gone/a\.exr: cannot be written: "):
        write_layers(tmp_path / "gone/a.exr", {"a": np.zeros((2, 3), np.float32)})


@pytest.mark.parametrize(
    ("format_name", "unwanted"), [("exr", {"tifffile", "xml.etree.ElementTree"}), ("tif", {"OpenEXR", "http", "ssl"})]
)
def test_a_format_loads_no_other_formats_library(format_name: str, unwanted: set[str]) -> None:
    script = (
        "import sys\nfrom cadtof_cli.files.formats import format_by_name\nassert 'numpy' not in sys.modules\n"
        f"kind = format_by_name('{format_name}')\nkind.frames()\nkind.layers()\n"
    )
    assert not loaded_modules(script) & unwanted


def test_frames_of_plain_tiff_load_no_xml() -> None:
    script = "from cadtof_cli.files.formats import format_by_name\nformat_by_name('tif').frames()"
    assert "xml.etree.ElementTree" not in loaded_modules(script)
