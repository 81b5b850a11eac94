"""A frame is called lossy if and only if its compression has changed values; the run then says so."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.files.frame_files import lossy_compression
from cadtof_cli.files.frames import FrameLayout
from tests.support.captures import PLANE_NAMES, TOML, counts_of
from tests.support.forward import step_frame
from tests.support.run_cadtof import program

LAYOUT = FrameLayout((1, 2))

VOLTS = step_frame(np.random.default_rng(3)).reshape(4, 24, 32)

Values = NDArray[Any]


def _exr(compression: str, names: tuple[str, ...]) -> Callable[[Path, Values], Values]:
    def write_and_read(path: Path, stored: Values) -> Values:
        header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
        planes = {name: plane.copy() for name, plane in zip(names, stored, strict=False)}
        OpenEXR.File(header, planes).write(str(path))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return np.stack([file.channels()[name].pixels for name in names])

    return write_and_read


def _tiff(compression: str, /, **options: Any) -> Callable[[Path, Values], Values]:
    def write_and_read(path: Path, stored: Values) -> Values:
        tifffile.imwrite(path, stored, photometric="minisblack", compression=compression, compressionargs=options)
        return tifffile.imread(path)

    return write_and_read


COMPRESSIONS = {
    "B44": (np.float16, _exr("B44", PLANE_NAMES)),
    "B44 of floats": (np.float32, _exr("B44", PLANE_NAMES)),
    "B44A": (np.float16, _exr("B44A", PLANE_NAMES)),
    "PXR24": (np.float32, _exr("PXR24", PLANE_NAMES)),
    "PXR24 of halves": (np.float16, _exr("PXR24", PLANE_NAMES)),
    "DWAA": (np.float32, _exr("DWAA", PLANE_NAMES)),
    "DWAA of luminance": (np.float32, _exr("DWAA", ("Y",))),
    "DWAB of luminance, halves": (np.float16, _exr("DWAB", ("Y",))),
    "ZIP": (np.float32, _exr("ZIP", PLANE_NAMES)),
    "HTJ2K": (np.float32, _exr("HTJ2K256", PLANE_NAMES)),
    "JPEG": (np.uint8, _tiff("jpeg", level=90)),
    "JPEG, lossless": (np.uint16, _tiff("jpeg", lossless=True)),
    "JPEG 2000": (np.uint16, _tiff("jpeg2000", level=50, reversible=False)),
    "JPEG 2000, lossless": (np.uint16, _tiff("jpeg2000", reversible=True)),
    "JPEG XL": (np.uint16, _tiff("jpegxl", distance=1, lossless=False)),
    "JPEG XL, floats": (np.float32, _tiff("jpegxl", distance=1, lossless=False)),
    "JPEG XL, lossless": (np.uint16, _tiff("jpegxl", lossless=True)),
    "JPEG XL, lossless floats": (np.float32, _tiff("jpegxl", lossless=True)),
    "LERC": (np.uint16, _tiff("lerc", level=3)),
    "LERC, floats": (np.float32, _tiff("lerc", level=1e-3)),
    "LERC in deflate": (np.float32, _tiff("lerc", level=1e-3, compression="deflate")),
    "LERC in Zstandard": (np.float32, _tiff("lerc", level=1e-3, compression="zstd")),
    "LERC, lossless": (np.uint16, _tiff("lerc")),
    "LERC, lossless floats": (np.float32, _tiff("lerc")),
    "JPEG XR": (np.uint16, _tiff("jpegxr", level=99)),
    "JPEG XR of bytes": (np.uint8, _tiff("jpegxr", level=90)),
    "JPEG XR of halves": (np.float16, _tiff("jpegxr", level=99)),
    "JPEG XR of floats, all of whose bits it cannot keep": (np.float32, _tiff("jpegxr")),
    "JPEG XR, lossless": (np.uint16, _tiff("jpegxr")),
    "JPEG XR, lossless bytes": (np.uint8, _tiff("jpegxr", level=100)),
    "JPEG XR, lossless halves": (np.float16, _tiff("jpegxr")),
    "deflate": (np.uint16, _tiff("deflate")),
}


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_a_compression_is_called_lossy_if_and_only_if_it_changed_values(name: str, tmp_path: Path) -> None:
    dtype, write_and_read = COMPRESSIONS[name]
    counts = counts_of(VOLTS.reshape(2, 2, 24, 32))
    stored = (
        VOLTS.astype(dtype)
        if np.dtype(dtype).kind == "f"
        else (counts // 64 if dtype is np.uint8 else counts).astype(dtype)
    )
    path = tmp_path / "frame"
    changed = not np.array_equal(write_and_read(path, stored.copy()), stored[:1] if "luminance" in name else stored)
    found = lossy_compression(path, LAYOUT, np.dtype(dtype))
    assert (found is not None) == changed
    assert found is None or found.split(" with ")[0] == name.partition(" of")[0].partition(",")[0].partition(" in ")[0]


@pytest.mark.parametrize("size", [(16, 16), (40, 24), (13, 17), (30, 40), (301, 33), (270, 480)])
@pytest.mark.parametrize("lossless", [False, True])
def test_lossy_jpeg_xl_is_found_at_any_size(size: tuple[int, int], lossless: bool, tmp_path: Path) -> None:
    """The header writes sizes in blocks of eight pixels or in pixels, and widths also as a ratio."""
    stored = np.random.default_rng(0).normal(8192.0, 500.0, (4, *size)).astype(np.uint16)
    _tiff("jpegxl", **({"lossless": True} if lossless else {"distance": 1, "lossless": False}))(tmp_path / "f", stored)
    assert lossy_compression(tmp_path / "f", LAYOUT, np.dtype(np.uint16)) == (None if lossless else "JPEG XL")


def test_the_error_that_lerc_allows_is_named(tmp_path: Path) -> None:
    path = tmp_path / "frame.tif"
    _tiff("lerc", level=0.001)(path, VOLTS.astype(np.float32))
    found = lossy_compression(path, LAYOUT, np.dtype(np.float32))
    assert found == "LERC with errors up to 0.001"


def test_a_run_warns_once_of_lossy_compression(tmp_path: Path) -> None:
    capture = tmp_path / "capture"
    capture.mkdir()
    (capture / "capture.toml").write_text(TOML["exr"])
    for index in range(3):
        _exr("B44", PLANE_NAMES)(capture / f"frame_{index}.exr", VOLTS.astype(np.float16))
    done = program("resolve", capture, "-o", tmp_path / "out")
    assert done.status == 0
    lossy_lines = [line for line in done.err.splitlines() if "lossy compression" in line]
    assert lossy_lines == [
        f"warning: {capture}: recorded with lossy compression (B44), which changes voltages and so depths; record without"
        " compression, or with a lossless one: deflate, LZW, Zstandard; in EXR ZIP or PIZ"
    ]
    (recorded,) = json.loads((tmp_path / "out" / "run.json").read_text())["captures"]
    assert recorded["lossy_compression"] == "B44"
    assert "lossy compression           B44" in program("info", capture).out
    assert program("report", tmp_path / "out", "-o", tmp_path / "page.html").status == 0
    assert "was recorded with lossy compression (B44)" in (tmp_path / "page.html").read_text()
