"""Cases that libtiff's tools write."""

from pathlib import Path

import numpy as np
import tifffile

from cadtof_cli.arrays import Stored
from tests.outside.cases import SHUFFLED, Case, Writer, planes_of, run, shuffled_planes
from tests.support.captures import PLANE_NAMES


def _source(folder: Path, frame: Stored, *, shaped: bool = False) -> Path:
    path = folder / "plain.tif"
    metadata = {"axes": "HCYX"} if shaped else None
    pages = frame if shaped else np.stack(planes_of(frame))
    tifffile.imwrite(path, pages, photometric="minisblack", metadata=metadata)
    return path


def _tiffcp(*options: str) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        run("tiffcp", *options, _source(folder, frame), folder / "frame.tif")
        return folder / "frame.tif"

    return write


def _tiffset(page: int, tag: str, value: str, *, shaped: bool = False) -> Writer:
    """Return a writer that changes a tag of one page; libtiff then writes this page anew at the end of the file."""

    def write(folder: Path, frame: Stored) -> Path:
        path = _source(folder, frame, shaped=shaped)
        run("tiffset", "-d", str(page), "-s", tag, value, path)
        return path

    return write


def _named_by_tiffset(folder: Path, frame: Stored) -> Path:
    path = folder / "frame.tif"
    tifffile.imwrite(path, np.stack(shuffled_planes(frame)), photometric="minisblack", metadata=None)
    for page, name in enumerate(SHUFFLED):
        run("tiffset", "-d", str(page), "-s", "285", name, path)
    return path


def _tiffsplit(*, shaped: bool) -> Writer:
    def write(folder: Path, frame: Stored) -> tuple[Path, ...]:
        run("tiffsplit", _source(folder, frame, shaped=shaped), f"{folder}/plane_")
        return tuple(sorted(folder.glob("plane_*.tif")))

    return write


def _split_and_joined(folder: Path, frame: Stored) -> Path:
    run("tiffsplit", _source(folder, frame, shaped=True), f"{folder}/plane_")
    run("tiffcp", *sorted(folder.glob("plane_*.tif")), folder / "frame.tif")
    return folder / "frame.tif"


def _raw2tiff(folder: Path, frame: Stored) -> tuple[Path, ...]:
    files = tuple(folder / f"{name}.tif" for name in PLANE_NAMES)
    for file, plane in zip(files, planes_of(frame), strict=True):
        plane.tofile(folder / "plane.raw")
        run("raw2tiff", "-w", str(plane.shape[1]), "-l", str(plane.shape[0]), "-d", "short", folder / "plane.raw", file)
    return files


CASES = [
    Case("libtiff", "tiffcp, big-endian strips", _tiffcp("-B", "-s", "-r", "7")),
    Case("libtiff", "tiffcp -B -8, strips, float32", _tiffcp("-8", "-B", "-s", "-r", "7"), "f4"),
    Case("libtiff", "tiffcp -c zip, big-endian tiles", _tiffcp("-c", "zip", "-t", "-w", "32", "-l", "16", "-B")),
    Case("libtiff", "tiffcp -c lzw, strips", _tiffcp("-c", "lzw", "-s", "-r", "9")),
    Case("libtiff", "tiffcp -c zstd, float32", _tiffcp("-c", "zstd"), "f4"),
    Case("libtiff", "tiffcp -8, tiles", _tiffcp("-8", "-t", "-w", "16", "-l", "32")),
    Case("libtiff", "tiffcp -c lzw:2", _tiffcp("-c", "lzw:2")),
    Case("libtiff", "tiffcp -c zip:3, float32", _tiffcp("-c", "zip:3"), "f4"),
    Case("libtiff", "tiffcp -c zstd", _tiffcp("-c", "zstd")),
    Case("libtiff", "tiffcp -c lzma", _tiffcp("-c", "lzma")),
    Case("libtiff", "tiffcp -c packbits", _tiffcp("-c", "packbits")),
    Case("libtiff", "tiffcp -p separate, 8 bits", _tiffcp("-p", "separate"), "u1"),
    Case("libtiff", "tiffset on the first page", _tiffset(0, "305", "a program of ours")),
    Case("libtiff", "tiffset on the third page", _tiffset(2, "305", "a program of ours")),
    Case("libtiff", "tiffset -s 278 on the third page", _tiffset(2, "278", "1000")),
    Case("libtiff", "tiffset on a page of axes H C Y X", _tiffset(1, "315", "someone", shaped=True)),
    Case("libtiff", "tiffset -s 270 on the first page", _tiffset(0, "270", "a note", shaped=True)),
    Case("libtiff", "tiffset -s 285, a name for each page", _named_by_tiffset),
    Case("libtiff", "tiffset -s 274 3, rotated", _tiffset(0, "274", "3"), refused="orientation"),
    Case("libtiff", "tiffsplit, a file a plane", _tiffsplit(shaped=False)),
    Case("libtiff", "tiffsplit of axes H C Y X", _tiffsplit(shaped=True)),
    Case("libtiff", "tiffsplit, then tiffcp", _split_and_joined),
    Case("libtiff", "raw2tiff, a file a plane", _raw2tiff),
]
