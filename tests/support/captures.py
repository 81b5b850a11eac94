"""Small captures for tests, recorded by the forward model: TIFF counts or EXR volts."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

from cadtof_cli.files.layers import stage_maps
from cadtof_cli.files.maps import DepthMaps, MapHeader
from tests.support.forward import step_frame

Form = Literal["tif", "exr"]

ZERO_COUNTS = 8192
VOLTS_PER_COUNT = 6.0e-5
PLANE_NAMES = ("H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2")

MAP_LAYERS = (
    *("direct.depth", "mpi.depth", "direct.amplitude", "mpi.amplitude", "direct.sigma", "mpi.sigma"),
    *("confidence", "status"),
)
"""The layers of the maps of two periods, in their order, as the README says; all tests take them from here."""

_OF_VOLTS = """\
[modulation]
periods_ns = [40.0, 20.0]
waveform = "sine"
amplitude_v = 0.2746
[pixel]
integration_length = 100000
[pulse]
fwhm_ns = 1.7
"""

_OF_COUNTS = """\
[voltage]
zero_counts = 8192.0
volts_per_count = 6.0e-5
saturated_counts = [0, 16383]
[optics]
focal_length_px = 28.0
principal_point_px = [15.0, 10.0]
"""

TOML: dict[Form, str] = {"tif": _OF_VOLTS + _OF_COUNTS, "exr": _OF_VOLTS}

KNOWN_FORMATS, FRAME_SUFFIXES = "EXR, TIFF, NPY, PNG", ".exr, .tif, .tiff, .npy"
"""What messages list: the formats that are known by their first bytes, and the suffixes of files that are frames."""


@dataclass(frozen=True)
class Recorded:
    """A capture folder and its frames' files in order."""

    folder: Path
    files: tuple[Path, ...]


def record(folder: Path, *, frames: int = 1, form: Form = "tif", seed: int = 0, toml: str | None = None) -> Recorded:
    """Record frames of `step_frame`, 24 × 32 pixels, and a `capture.toml`.

    `toml` is its text; None: the text for the form; "": no `capture.toml`.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    files = tuple(folder / f"frame_{index}.{form}" for index in range(frames))
    for file in files:
        write_frame(file, step_frame(rng))
    text = TOML[form] if toml is None else toml
    if text:
        (folder / "capture.toml").write_text(text)
    return Recorded(folder, files)


def write_frame(file: Path, volts: NDArray[np.float64]) -> None:
    """Write voltages (2, 2, Y, X) as EXR volts or TIFF counts, by the suffix of the file."""
    if file.suffix == ".exr":
        write_exr(file, dict(zip(PLANE_NAMES, volts.reshape(4, *volts.shape[2:]).astype(np.float32), strict=True)))
    else:
        write_pages(file, counts_of(volts))


def counts_of(volts: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Counts of voltages, (2, 2, Y, X) → (4, Y, X)."""
    counts = np.rint(volts / VOLTS_PER_COUNT + ZERO_COUNTS).astype(np.uint16)
    return counts.reshape(-1, *volts.shape[2:])


def write_pages(file: Path, pages: NDArray[Any], **options: Any) -> Path:
    """Write a TIFF with one page per plane, by tifffile with these options; return the file."""
    tifffile.imwrite(file, pages, **{"photometric": "minisblack", "metadata": None, **options})
    return file


def write_exr(file: Path, channels: Mapping[str, NDArray[Any]], **header: Any) -> Path:
    """Write an EXR file with the channels and these attributes; return the file."""
    attributes = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **header}
    OpenEXR.File(attributes, {name: plane.copy() for name, plane in channels.items()}, num_threads=0).write(str(file))
    return file


def layers_of(file: Path) -> dict[str, NDArray[Any]]:
    """Return the channels of a map file, EXR or OME-TIFF, read by the libraries without the package."""
    if file.suffix == ".exr":
        with OpenEXR.File(str(file), separate_channels=True) as opened:
            return {name: channel.pixels.copy() for name, channel in opened.channels().items()}
    with tifffile.TiffFile(file) as tiff:
        assert tiff.ome_metadata is not None
        document = tifffile.xml2dict(tiff.ome_metadata)
        channels = document["OME"]["Image"]["Pixels"]["Channel"]
        return {channel["Name"]: page.asarray() for channel, page in zip(channels, tiff.pages, strict=True)}


def write_maps(path: Path, maps: DepthMaps) -> None:
    """Write maps with an empty header, in the format that the file's suffix asks for."""
    stage_maps(path, maps, header=MapHeader(), token="")[0].commit()
