"""Small captures for tests of the command line: frames of the independent forward model, as files."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

from tests.support.forward import step_frame

ROOT = Path(__file__).parents[2]
ZERO = 8192.0
VOLTS_PER_COUNT = 6.0e-5
PLANES = ("H1.SC1", "H1.SC2", "H2.SC1", "H2.SC2")

CAPTURE_TOML = """\
[modulation]
periods_ns = [40.0, 20.0]
waveform = "sine"
amplitude_v = 0.2746
[pixel]
integration_length = 100000
[pulse]
fwhm_ns = 1.7
[voltage]
zero_counts = 8192.0
volts_per_count = 6.0e-5
saturated_counts = [0, 16383]
"""

VOLTS_TOML = CAPTURE_TOML.partition("[voltage]")[0]


def counts(volts: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return volts as a 14-bit camera stores them."""
    return np.asarray(np.clip(np.rint(volts / VOLTS_PER_COUNT + ZERO), 0, 16383)).astype(np.uint16)


def write_tiff(path: Path, planes: NDArray[Any]) -> None:
    """Write planes as pages; axes before Y X are flattened."""
    tifffile.imwrite(path, planes.reshape(-1, *planes.shape[-2:]), photometric="minisblack", metadata=None)


def write_exr(path: Path, frame: NDArray[Any]) -> None:
    """Write a frame, (2, 2, Y, X), as float channels."""
    planes = frame.reshape(4, *frame.shape[-2:]).astype(np.float32)
    OpenEXR.File({}, dict(zip(PLANES, planes, strict=True)), num_threads=0).write(str(path))


def tiff_capture(folder: Path, *, frames: int = 1, toml: str = CAPTURE_TOML, size: tuple[int, int] = (24, 32)) -> Path:
    """Write a capture of TIFF frames of counts; seeded by the frame's place."""
    folder.mkdir(parents=True)
    for index in range(frames):
        rng = np.random.default_rng(index)
        write_tiff(folder / f"f_{index}.tif", counts(step_frame(rng, height=size[0], width=size[1])))
    (folder / "capture.toml").write_text(toml)
    return folder


def exr_capture(folder: Path, *, frames: int = 1, toml: str = VOLTS_TOML) -> Path:
    """Write a capture of EXR frames of volts; seeded by the frame's place."""
    folder.mkdir(parents=True)
    for index in range(frames):
        write_exr(folder / f"f_{index}.exr", step_frame(np.random.default_rng(index)))
    (folder / "capture.toml").write_text(toml)
    return folder


def exr_layers(path: Path) -> dict[str, NDArray[Any]]:
    """Return the channels of an EXR file."""
    with OpenEXR.File(str(path), separate_channels=True, num_threads=0) as file:
        return {name: channel.pixels.copy() for name, channel in file.channels().items()}


def tiff_layers(path: Path) -> dict[str, NDArray[Any]]:
    """Return the pages of an OME-TIFF by the names in its XML."""
    with tifffile.TiffFile(path) as file:
        xml = tifffile.xml2dict(file.ome_metadata or "")
        channels = xml["OME"]["Image"]["Pixels"]["Channel"]
        return {item["Name"]: page.asarray() for item, page in zip(channels, file.pages, strict=True)}


def json_lines(text: str) -> list[dict[str, Any]]:
    """Return the objects of JSON lines."""
    return [json.loads(line) for line in text.splitlines()]


def command(*arguments: object) -> list[str]:
    """Return the command line that runs `cadtof` in a process of its own."""
    return [sys.executable, "-m", "cadtof_cli", *map(str, arguments)]


def environment() -> dict[str, str]:
    """Return this process's environment, with the package on the path."""
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def run(arguments: Sequence[object], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run `cadtof` in a process of its own."""
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, check=False, timeout=60, env=environment(), **options
    )
