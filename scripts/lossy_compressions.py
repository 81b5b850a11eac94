"""Measure how lossy compression of frames changes depths, and print the table of docs/formats.md.

A frame of sample_data is written without and with each compression, read, and resolved. Only the compression differs,
so it alone changes the depths.
"""

import argparse
import logging
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

from cadtof_cli import Frame, read_frames, resolve
from cadtof_cli.phasors.voltages import volts_from_stored

ROOT = Path(__file__).parents[1]

SCENES = ("card", "corner")
"""`card` has two separate paths, `corner` diffuse MPI."""

VOLTS_PER_COUNT, ZERO_COUNTS = 6e-5, 8192.0
"""Scale of counts with 14 bits."""

Stored = NDArray[Any]
Write = Callable[[Path, Stored], None]


@dataclass(frozen=True)
class Way:
    """A compression: its name, the dtype of the values, and the function that writes a file with it."""

    name: str
    dtype: str
    write: Write


def exr(compression: Any) -> Write:
    """Return a function that writes an EXR file with the channels H1.SC1, …"""

    def write(path: Path, stored: Stored) -> None:
        planes = stored.reshape(4, *stored.shape[2:])
        channels = {f"H{h}.SC{c}": planes[2 * h + c - 3].copy() for h in (1, 2) for c in (1, 2)}
        OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, channels).write(str(path))

    return write


def exr_planes(compression: Any) -> Write:
    """Return a function that writes an EXR file with the losses of a compression that needs luminance.

    It writes each plane as the luminance of a file with that compression, reads it back, and stores the planes that it
    has read without further loss.
    """

    def write(path: Path, stored: Stored) -> None:
        back = []
        for plane in stored.reshape(4, *stored.shape[2:]):
            header = {"compression": compression, "type": OpenEXR.scanlineimage}
            OpenEXR.File(header, {"Y": plane.copy()}).write(str(path))
            with OpenEXR.File(str(path), separate_channels=True) as file:
                back.append(file.channels()["Y"].pixels.copy())
        exr(OpenEXR.ZIP_COMPRESSION)(path, np.stack(back).reshape(stored.shape))

    return write


def tiff(compression: str | None, **options: Any) -> Write:
    """Return a function that writes a TIFF file."""

    def write(path: Path, stored: Stored) -> None:
        tifffile.imwrite(
            path,
            stored,
            photometric="minisblack",
            metadata={"axes": "HCYX"},
            compression=compression,
            compressionargs=options,
        )

    return write


WAYS = (
    Way("EXR PXR24", "float32", exr(OpenEXR.PXR24_COMPRESSION)),
    Way("EXR B44", "float16", exr(OpenEXR.B44_COMPRESSION)),
    Way("EXR DWAA, a plane a file as Y", "float32", exr_planes(OpenEXR.DWAA_COMPRESSION)),
    Way("TIFF LERC, errors up to 1", "uint16", tiff("lerc", level=1)),
    Way("TIFF LERC, errors up to 5", "uint16", tiff("lerc", level=5)),
    Way("TIFF JPEG 2000, 60 dB", "uint16", tiff("jpeg2000", level=60, reversible=False)),
    Way("TIFF JPEG 2000, 80 dB", "uint16", tiff("jpeg2000", level=80, reversible=False)),
    Way("TIFF JPEG XL, distance 1", "uint16", tiff("jpegxl", distance=1, lossless=False)),
    Way("TIFF JPEG, quality 95", "uint8", tiff("jpeg", level=95)),
)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    # the package warns of every lossy file; the table says so anyway
    logging.getLogger("cadtof_cli").setLevel(logging.ERROR)
    print(
        "| compression | of | voltages move by, mV RMS | "
        + " | ".join(f"`{one}`: depths move by, mm" for one in SCENES)
        + " |"
    )
    print("|---|---|---|" + "---|" * len(SCENES))
    frames = [next(read_frames(ROOT / "sample_data" / scene)) for scene in SCENES]
    for way in WAYS:
        moved = [moves(frame, way) for frame in frames]
        volts = max(one[0] for one in moved)
        depths = " | ".join(f"{_one_digit(median)}, {_one_digit(most)}" for _, median, most in moved)
        print(f"| {way.name} | {way.dtype} | {_one_digit(1000.0 * volts)} | {depths} |", flush=True)


def _one_digit(value: float) -> str:
    """Return a number to one digit: the second digit depends on the version of the codec."""
    return f"{float(f'{value:.1g}'):g}"


def moves(frame: Frame, way: Way) -> tuple[float, float, float]:
    """Return by how much a compression changes voltages (RMS in V), and depths (median and 90 % in mm)."""
    stored, scale = _stored(volts_from_stored(frame.stored, frame.metadata.voltage), way.dtype)
    exact, changed = (_read_back(frame, stored, scale, one) for one in (_lossless(way), way.write))
    per_count = scale.get("voltage.volts_per_count", 1.0)
    moved = per_count * (changed.stored.astype(np.float64) - exact.stored.astype(np.float64))
    depths = 1000.0 * np.abs(resolve(changed)["direct.depth"] - resolve(exact)["direct.depth"])
    median, most = np.nanpercentile(depths, (50, 90))
    return float(np.sqrt(np.mean(moved**2))), float(median), float(most)


def _stored(volts: Stored, dtype: str) -> tuple[Stored, dict[str, float]]:
    """Return voltages as a camera stores them with a dtype, and the settings that describe the scale."""
    if dtype.startswith("float"):
        return volts.astype(dtype), {}
    bits = 8 if dtype == "uint8" else 14
    per_count, zero = VOLTS_PER_COUNT * 2 ** (14 - bits), ZERO_COUNTS / 2 ** (14 - bits)
    counts = np.clip(np.rint(volts / per_count + zero), 0, 2**bits - 1).astype(dtype)
    return counts, {"voltage.volts_per_count": per_count, "voltage.zero_counts": zero}


def _lossless(way: Way) -> Write:
    return exr(OpenEXR.ZIP_COMPRESSION) if way.name.startswith("EXR") else tiff(None)


def _read_back(frame: Frame, stored: Stored, scale: dict[str, float], write: Write) -> Frame:
    """Write a frame, read it again, and return it."""
    known = frame.metadata
    settings = {
        "pixel.integration_length": known.pixel.integration_length,
        "optics.focal_length_px": known.optics.focal_length_px,
        "optics.principal_point_px": known.optics.principal_point_px,
        **scale,
    }
    suffix = "exr" if stored.dtype.kind == "f" else "tif"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"frame.{suffix}"
        write(path, stored)
        return next(read_frames(path, metadata={key: value for key, value in settings.items() if value is not None}))


if __name__ == "__main__":
    main()
