"""A file of maps describes its content, for tifffile, OpenEXR, GDAL (rasterio, and so QGIS) and OpenCV."""

import re
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile

from cadtof_cli.files.layers import read_layers
from cadtof_cli.version import __version__
from tests.conftest import Tool
from tests.support.captures import layers_of, record
from tests.support.run_cadtof import cadtof

UNITS = {
    **{
        f"{path}.{name}": unit
        for path in ("direct", "mpi")
        for name, unit in (("depth", "m"), ("amplitude", "V"), ("sigma", "m"))
    },
    "confidence": "V",
}


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the maps of one frame in both formats: ranges in TIFF, planar depth in EXR."""
    folder = tmp_path_factory.mktemp("maps")
    capture = record(folder / "capture")
    for form, extra in (("tif", ()), ("exr", ("--depth", "z"))):
        done = cadtof("resolve", capture.folder, "-o", folder / form, "--jobs", "1", "--format", form, *extra)
        assert done.status == 0, done.err
    return {form: folder / form / f"frame_0.{form}" for form in ("tif", "exr")}


def test_tiff_maps_say_what_they_are_in_ome_annotations(maps: dict[str, Path]) -> None:
    with tifffile.TiffFile(maps["tif"]) as file:
        assert file.ome_metadata is not None
        document = tifffile.xml2dict(file.ome_metadata)["OME"]
        assert len(file.series) == 1
    pairs = {pair["K"]: pair["value"] for pair in document["StructuredAnnotations"]["MapAnnotation"]["Value"]["M"]}
    assert document["Creator"] == f"cadtof {__version__}"
    assert {name.removeprefix("unit of "): unit for name, unit in pairs.items() if name.startswith("unit of ")} == UNITS
    assert (pairs["depth"], pairs["source"]) == ("radial range", "frame_0.tif")
    assert str(pairs["periods_ns"]).replace(" ", "").strip("()[]") in ("40,20", "40.0,20.0")


def test_exr_maps_say_what_they_are_in_attributes(maps: dict[str, Path], tool: Tool) -> None:
    header = OpenEXR.File(str(maps["exr"]), header_only=True).header()
    assert (header["cadtof.depth"], header["cadtof.source"]) == ("planar depth z", "frame_0.tif")
    assert (header["cadtof.periods_ns"], header["software"]) == ("40, 20", f"cadtof {__version__}")
    assert {name: header[f"cadtof.unit.{name}"] for name in UNITS} == UNITS
    assert 'cadtof.unit.direct.depth (type string): "m"' in tool("exrheader", maps["exr"])


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_gdal_reads_names_units_and_facts(maps: dict[str, Path]) -> None:
    rasterio = pytest.importorskip("rasterio")
    layers = layers_of(maps["tif"])
    for page, (name, values) in enumerate(layers.items(), start=1):
        with rasterio.open(f"GTIFF_DIR:{page}:{maps['tif']}") as band:
            assert band.descriptions == (name,)
            assert (band.units[0] or "") == UNITS.get(name, "")
            np.testing.assert_array_equal(band.read(1), values)
    with rasterio.open(maps["tif"]) as file:
        assert file.descriptions == ("direct.depth",)
        assert file.tags()["depth"] == "radial range"
        assert len(file.subdatasets) == len(layers)


@pytest.mark.parametrize(
    ("told", "filled"),
    [
        ("-9999", -9999.0),
        ("0", 0.0),
        ("1e+20", 1e20),
        ("-3.40282346638529e+38", -3.4028234663852886e38),
        ("nan", np.nan),
    ],
)
def test_the_value_of_gdal_for_no_data_is_no_answer(
    told: str, filled: float, maps: dict[str, Path], tmp_path: Path
) -> None:
    """GDAL writes this value into tag 42113 of each page, and fills pixels without a value with it."""
    layers = layers_of(maps["tif"])
    names, planes = [*layers], np.stack([layer.astype(np.float32) for layer in layers.values()])
    assert np.isnan(layers["mpi.depth"]).any()
    tifffile.imwrite(
        tmp_path / "filled.tif",
        np.nan_to_num(planes, nan=filled).astype(np.float32),
        photometric="minisblack",
        ome=True,
        metadata={"axes": "CYX", "Channel": {"Name": names}},
        extratags=[(42113, "s", 0, told, True)],
    )
    for name, found in read_layers(tmp_path / "filled.tif").items():
        np.testing.assert_array_equal(found, layers[name])


@pytest.mark.parametrize("told", ["", "none", "1e300", "-1e300", "inf"])
def test_a_value_for_no_data_that_no_pixel_has_changes_nothing(
    told: str, maps: dict[str, Path], tmp_path: Path
) -> None:
    layer = layers_of(maps["tif"])["direct.depth"]
    metadata = {"axes": "CYX", "Channel": {"Name": ["direct.depth"]}}
    tags = [(42113, "s", 0, told, True)]
    tifffile.imwrite(tmp_path / "a.tif", layer[None], ome=True, metadata=metadata, extratags=tags)
    np.testing.assert_array_equal(read_layers(tmp_path / "a.tif")["direct.depth"], layer)


def test_opencv_reads_every_page(maps: dict[str, Path]) -> None:
    cv2 = pytest.importorskip("cv2")
    found, pages = cv2.imreadmulti(str(maps["tif"]), flags=cv2.IMREAD_UNCHANGED)
    assert found
    for page, values in zip(pages, layers_of(maps["tif"]).values(), strict=True):
        np.testing.assert_array_equal(page, values)


def test_libtiff_sees_the_names(maps: dict[str, Path], tool: Tool) -> None:
    assert re.findall(r"PageName: (.*)", tool("tiffinfo", maps["tif"])) == list(layers_of(maps["tif"]))


def test_info_shows_facts_as_plain_text(maps: dict[str, Path]) -> None:
    for form, depth in (("tif", "radial range"), ("exr", "planar depth z")):
        alone = cadtof("info", maps[form])
        assert re.search(rf"^  depth +{depth}$", alone.out, re.MULTILINE)
        assert re.search(r"^  source +frame_0\.tif$", alone.out, re.MULTILINE)
        whole = cadtof("info", maps[form].parent)
        assert re.search(rf"^  run +cadtof {__version__}, .*: 1 of 1 frames", whole.out, re.MULTILINE)
        assert "{" not in whole.out + alone.out
