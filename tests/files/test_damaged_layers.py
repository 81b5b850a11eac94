"""Layers are read back by the names that they were written with; a damaged file gives no layers."""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile

from cadtof_cli.errors import FrameError
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.resolver.status import StatusBit
from tests.support.captures import write_maps

SHAPE = (20, 30)


def written(path: Path) -> Path:
    pages = np.random.default_rng(1).normal(size=(8, *SHAPE)).astype(np.float32)
    write_maps(path, DepthMaps(tuple("abcdefg"), pages, np.full(SHAPE, 8, np.uint32)))
    return path


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
@pytest.mark.parametrize("kept", [0.02, 0.1, 0.5, 0.9, 0.99])
def test_a_file_that_ends_too_early_gives_no_layers(suffix: str, kept: float, tmp_path: Path) -> None:
    path = written(tmp_path / f"maps{suffix}")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(FrameError, match=path.name):
        read_layers(path)


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
def test_a_signalling_nan_is_read_as_a_quiet_one(suffix: str, tmp_path: Path) -> None:
    pages = np.full((2, *SHAPE), -0.0, np.float32)
    pages.view(np.uint32)[0, 0, 0] = 0x7F800001
    write_maps(tmp_path / f"maps{suffix}", DepthMaps(("direct.depth",), pages, np.full(SHAPE, 8, np.uint32)))
    # to convert a signalling NaN gives a warning, which is an error in tests
    depth = read_layers(tmp_path / f"maps{suffix}")["direct.depth"].astype(np.float64)
    assert np.flatnonzero(np.isnan(depth)).tolist() == [0]
    assert np.signbit(depth[0, 1:]).all()


def test_channels_named_as_colours_are_layers_like_others(tmp_path: Path) -> None:
    planes = {name: np.full(SHAPE, index, np.float32) for index, name in enumerate(("R", "G", "B", "depth"))}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, dict(planes)).write(str(tmp_path / "colours.exr"))
    layers = read_layers(tmp_path / "colours.exr")
    assert sorted(layers) == sorted(planes)
    for name, plane in planes.items():
        np.testing.assert_array_equal(layers[name], plane)


def _parts(path: Path, *names: str) -> Path:
    """Write an EXR file with a part for each name, whose only channel has this name."""
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage, "name": str(index)}, {name: np.full(SHAPE, index, np.float32)})
        for index, name in enumerate(names)
    ]
    OpenEXR.File(parts).write(str(path))
    return path


def test_layers_in_any_part_of_an_exr_file_are_read(tmp_path: Path) -> None:
    # exrmultipart -convert writes the layers direct, mpi and the rest as three parts
    layers = read_layers(_parts(tmp_path / "parts.exr", "confidence", "direct.depth", "mpi.depth"))
    assert {name: plane[0, 0] for name, plane in layers.items()} == {"confidence": 0, "direct.depth": 1, "mpi.depth": 2}


@pytest.mark.parametrize(
    ("corner", "told"),
    [((0, 0), r"direct\.sigma of part 'sigma' is 5 × 3 pixels"), ((2, 1), r"direct\.sigma of part 'sigma' begins at")],
)
def test_layers_of_different_pixels_are_refused(corner: tuple[int, int], told: str, tmp_path: Path) -> None:
    """A compositor may cut each part of a picture to the pixels that hold something."""
    sizes = {"depth": ((0, 0), (6, 4)), "sigma": (corner, (5, 3) if corner == (0, 0) else (6, 4))}
    parts = []
    for name, ((left, top), (width, height)) in sizes.items():
        window = np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)
        whole = np.array([0, 0], np.int32), np.array([9, 9], np.int32)
        header = {"name": name, "type": OpenEXR.scanlineimage, "dataWindow": window, "displayWindow": whole}
        parts.append(OpenEXR.Part(header, {f"direct.{name}": np.ones((height, width), np.float32)}))
    OpenEXR.File(parts).write(str(tmp_path / "parts.exr"))
    with pytest.raises(FrameError, match=rf"parts\.exr: {told}"):
        read_layers(tmp_path / "parts.exr")


def test_two_layers_of_one_name_are_refused(tmp_path: Path) -> None:
    path = _parts(tmp_path / "parts.exr", "direct.depth", "mpi.depth", "direct.depth")
    with pytest.raises(FrameError, match=r"parts\.exr: found direct\.depth twice, expected it once"):
        read_layers(path)
    # the maps of two frames, joined by another program
    names = {"Channel": {"Name": ["direct.depth", "mpi.depth"]}}
    joined = np.random.default_rng(2).normal(size=(2, 2, *SHAPE)).astype(np.float32)
    tifffile.imwrite(
        tmp_path / "stack.tif", joined, ome=True, photometric="minisblack", metadata={"axes": "TCYX", **names}
    )
    with pytest.raises(FrameError, match=r"stack\.tif: found direct\.depth twice, expected it once"):
        read_layers(tmp_path / "stack.tif")


def with_status(path: Path, number: float, dtype: str) -> Path:
    """Write an EXR file whose status holds one number in all pixels, as another program may have written it."""
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"status": np.full(SHAPE, number, dtype)}).write(str(path))
    return path


@pytest.mark.parametrize(
    ("number", "dtype"),
    [
        # oiiotool reads whole numbers of 32 bits as 0 … 1; as half floats, 8 is then less than the smallest of them
        (4096 / (2**32 - 1), "f2"),
        (4096 / (2**32 - 1), "f4"),
        (8 / (2**32 - 1), "f2"),
        # ImageMagick clamps floats to 0 … 1, writes them as whole numbers up to the largest, and keeps the names of the layers
        (2**16 - 1, "u4"),
        (2**32 - 1, "u4"),
    ],
)
def test_status_bits_that_a_program_has_scaled_or_clamped_are_refused(
    number: float, dtype: str, tmp_path: Path
) -> None:
    with pytest.raises(FrameError, match=r"maps\.exr: damaged maps: their status holds numbers that are no bits; "):
        read_layers(with_status(tmp_path / "maps.exr", number, dtype))


@pytest.mark.parametrize(("bits", "dtype"), [(sum(StatusBit), "u4"), (2112, "f2")])
def test_all_status_bits_together_and_bits_as_half_floats_are_read(bits: int, dtype: str, tmp_path: Path) -> None:
    assert (read_layers(with_status(tmp_path / "maps.exr", bits, dtype))["status"] == bits).all()


@pytest.mark.parametrize(
    ("changed", "told"),
    [({"photometric": "miniswhite"}, "min-is-white"), ({"extratags": [(274, 3, 1, 4, True)]}, "found orientation 4")],
)
def test_maps_that_are_inverted_or_turned_are_refused(changed: dict[str, Any], told: str, tmp_path: Path) -> None:
    metadata = {"axes": "CYX", "Channel": {"Name": ["direct.depth", "mpi.depth"]}}
    planes = np.random.default_rng(3).uniform(size=(2, *SHAPE)).astype(np.float32)
    options: dict[str, Any] = {"photometric": "minisblack", "ome": True, "metadata": metadata, **changed}
    tifffile.imwrite(tmp_path / "truth.tif", planes, **options)
    with pytest.raises(FrameError, match=told):
        read_layers(tmp_path / "truth.tif")


def test_a_tiff_without_names_for_all_its_pages_holds_no_maps(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "plain.tif", np.zeros((3, *SHAPE), np.float32), photometric="minisblack", metadata=None)
    with pytest.raises(FrameError, match=r"found 3 pages without the names of maps, expected an OME-TIFF"):
        read_layers(tmp_path / "plain.tif")
    xml = '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Channel Name="one"/><Channel Name="two"/></OME>'
    tifffile.imwrite(
        tmp_path / "few.tif",
        np.zeros((3, *SHAPE), np.float32),
        photometric="minisblack",
        metadata=None,
        description=xml,
    )
    with pytest.raises(FrameError, match=r"found 3 pages without the names of maps"):
        read_layers(tmp_path / "few.tif")


def test_a_header_that_promises_more_than_its_file_holds(tmp_path: Path) -> None:
    path = written(tmp_path / "maps.tif")
    with tifffile.TiffFile(path, mode="r+") as file:
        for page in file.pages:
            assert isinstance(page, tifffile.TiffPage)
            page.tags["ImageWidth"].overwrite(60_000)
            page.tags["ImageLength"].overwrite(60_000)
    with pytest.raises(FrameError, match=path.name):
        read_layers(path)
