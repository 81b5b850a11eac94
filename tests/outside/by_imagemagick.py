"""Cases that ImageMagick writes."""

from pathlib import Path

import tifffile

from cadtof_cli.arrays import Stored
from tests.outside.cases import SHUFFLED, Case, Writer, planes_of, run, shuffled_planes


def _sources(folder: Path, planes: list[Stored]) -> list[Path]:
    files = [folder / f"plane_{index}.tif" for index in range(len(planes))]
    for file, plane in zip(files, planes, strict=True):
        tifffile.imwrite(file, plane, photometric="minisblack", metadata=None)
    return files


def _joined(*options: str) -> Writer:
    def write(folder: Path, frame: Stored) -> Path:
        run("convert", *_sources(folder, planes_of(frame)), *options, folder / "frame.tif")
        return folder / "frame.tif"

    return write


def _labelled(folder: Path, frame: Stored) -> Path:
    words: list[str | Path] = []
    for name, file in zip(SHUFFLED, _sources(folder, shuffled_planes(frame)), strict=True):
        words += ["(", file, "-set", "label", name, ")"]
    run("convert", *words, folder / "frame.tif")
    return folder / "frame.tif"


def _copies(suffix: str, *options: str) -> Writer:
    def write(folder: Path, frame: Stored) -> tuple[Path, ...]:
        files = []
        for source in _sources(folder, planes_of(frame)):
            files.append(folder / f"copy_{source.stem}{suffix}")
            run("convert", source, *options, files[-1])
        return tuple(files)

    return write


CASES = [
    Case("ImageMagick", "four pages", _joined()),
    Case("ImageMagick", "-endian MSB -compress Zip", _joined("-endian", "MSB", "-compress", "Zip")),
    Case("ImageMagick", "-compress LZW", _joined("-compress", "LZW")),
    Case("ImageMagick", "-compress ZSTD", _joined("-compress", "ZSTD")),
    Case("ImageMagick", "-compress LZMA", _joined("-compress", "LZMA")),
    Case("ImageMagick", "-compress RLE, 8 bits", _joined("-compress", "RLE"), "u1"),
    Case("ImageMagick", "tiles", _joined("-define", "tiff:tile-geometry=32x16")),
    Case("ImageMagick", "labels in another order", _labelled),
    Case("ImageMagick", "four samples by -combine", _joined("-combine"), refused="colour picture"),
    Case("ImageMagick", "TrueColor pages", _joined("-type", "TrueColor"), refused="colour picture"),
    Case(
        "ImageMagick", "min-is-white", _joined("-define", "quantum:polarity=min-is-white"), refused="min-is-white"
    ),
    Case("ImageMagick", "a file a plane, deflate", _copies(".tif", "-compress", "Zip")),
]  # fmt: skip
