"""Files that other software wrote on the spot are read to the same values: libtiff, ImageMagick, the OpenEXR tools."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import open_frames
from cadtof_cli.files.frames import FrameLayout
from tests.files.forms import HAS_CODECS, channels_of, known_frame, plane_files, planes_of, tiff

Tool = Callable[..., None]

LAYOUT = FrameLayout((1, 2))

needs_codecs = pytest.mark.skipif(not HAS_CODECS, reason="needs imagecodecs to read the file")


def _read(path: Path, layout: FrameLayout = LAYOUT) -> Stored:
    with open_frames(FrameSource(path.stem, (path,)), layout) as frames:
        return frames.read()


TIFFCP = [
    pytest.param(["-B"], id="big-endian"),
    pytest.param(["-8"], id="bigtiff"),
    pytest.param(["-8", "-B", "-s", "-r", "7"], id="bigtiff-big-endian-strips"),
    pytest.param(["-s", "-r", "5"], id="strips"),
    pytest.param(["-t", "-w", "16", "-l", "32"], id="tiles"),
    pytest.param(["-c", "zip"], id="deflate"),
    pytest.param(["-c", "zip", "-t", "-w", "32", "-l", "16", "-B"], id="deflate-tiles-big-endian"),
    pytest.param(["-c", "zip:2"], id="deflate-predictor", marks=needs_codecs),
    pytest.param(["-c", "lzw", "-s", "-r", "9"], id="lzw", marks=needs_codecs),
    pytest.param(["-c", "lzw:2"], id="lzw-predictor", marks=needs_codecs),
    pytest.param(["-c", "zstd"], id="zstd", marks=needs_codecs),
    pytest.param(["-c", "packbits"], id="packbits", marks=needs_codecs),
]


@pytest.mark.parametrize("options", TIFFCP)
@pytest.mark.parametrize("dtype", ["u2", "f4"])
def test_libtiff_copies(options: list[str], dtype: str, tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame(dtype)
    source = tiff(metadata=None, arrange=planes_of)(tmp_path / "plain", recorded)
    tool("tiffcp", *options, source.paths[0], tmp_path / "copy.tif")
    assert np.array_equal(_read(tmp_path / "copy.tif"), recorded)


def test_libtiff_joins_planes_and_frames(tmp_path: Path, tool: Tool) -> None:
    recorded = [known_frame("u2", seed=seed) for seed in range(3)]
    files = [plane_files(".tif")(tmp_path / f"frame_{i}", frame).paths for i, frame in enumerate(recorded)]
    tool("tiffcp", *files[0], tmp_path / "frame.tif")
    assert np.array_equal(_read(tmp_path / "frame.tif"), recorded[0])
    tool("tiffcp", *[file for group in files for file in group], tmp_path / "stack.tif")
    with open_frames(FrameSource("stack", (tmp_path / "stack.tif",)), FrameLayout((1, 2), 3)) as stack:
        assert stack.count == 3
        assert all(np.array_equal(stack.read(i), frame) for i, frame in enumerate(recorded))


@pytest.mark.parametrize(
    "options",
    [
        pytest.param([], id="plain"),
        pytest.param(["-endian", "MSB"], id="big-endian"),
        pytest.param(["-compress", "Zip"], id="deflate"),
        pytest.param(["-compress", "Zip", "-endian", "MSB", "-define", "tiff:rows-per-strip=4"], id="deflate-strips"),
        pytest.param(["-compress", "LZW"], id="lzw", marks=needs_codecs),
        pytest.param(["-define", "tiff:tile-geometry=32x16"], id="tiles"),
    ],
)
def test_imagemagick_joins_planes(options: list[str], tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame("u2")
    planes = plane_files(".tif")(tmp_path / "plane", recorded).paths
    tool("convert", *planes, "-compress", "None", *options, tmp_path / "frame.tif")
    assert np.array_equal(_read(tmp_path / "frame.tif"), recorded)


def _write_exr(path: Path, channels: dict[str, Stored]) -> Path:
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels, num_threads=0).write(str(path))
    return path


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(["-o", "-t", "16", "32"], id="tiles"),
        pytest.param(["-m"], id="mipmap"),
        pytest.param(["-r", "-z", "piz"], id="ripmap-piz"),
        pytest.param(["-o", "-z", "none"], id="tiles-none"),
    ],
)
@pytest.mark.parametrize("dtype", ["f2", "f4"])
def test_exrmaketiled(options: list[str], dtype: str, tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame(dtype, shape=(70, 90))
    plain = _write_exr(tmp_path / "plain.exr", channels_of(recorded))
    tool("exrmaketiled", *options, plain, tmp_path / "tiled.exr")
    assert np.array_equal(_read(tmp_path / "tiled.exr"), recorded)


@pytest.mark.parametrize("names", [("h1", "h2"), ("H1", "H2"), ("first", "second")])
def test_exrmultipart_combines_a_file_a_harmonic(names: tuple[str, str], tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame("f4")
    files = [
        _write_exr(tmp_path / f"{name}.exr", {"SC1": pair[0].copy(), "SC2": pair[1].copy()})
        for name, pair in zip(names, recorded, strict=True)
    ]
    tool("exrmultipart", "-combine", "-i", *files, "-o", tmp_path / "frame.exr", "-override", "1")
    assert np.array_equal(_read(tmp_path / "frame.exr"), recorded)


def test_imagemagick_planes_in_files_of_their_own(tmp_path: Path, tool: Tool) -> None:
    recorded = known_frame("u2")
    source = plane_files(".tif")(tmp_path / "plane", recorded)
    files = tuple(tmp_path / f"copy_{i}.tif" for i in range(4))
    for file, copy in zip(source.paths, files, strict=True):
        tool("convert", file, "-compress", "Zip", copy)
    with open_frames(FrameSource("frame", files), LAYOUT) as frames:
        assert np.array_equal(frames.read(), recorded)
