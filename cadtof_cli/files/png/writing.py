"""PNG files that we write: grey ones of 16 bits, and pictures of a few colours."""

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.atomic import atomic_write

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _INDEXED = 0, 3


def write_grey_png(path: Path, plane: NDArray[np.uint16], /, *, texts: dict[str, str]) -> None:
    """Write a plane (Y, X) as a 16-bit greyscale PNG with texts by keyword, which appears whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    height, width = plane.shape
    rows = np.zeros((height, 1 + 2 * width), np.uint8)  # each row begins with its filter: none
    rows[:, 1:] = plane.astype(">u2").view(np.uint8)
    chunks = [
        *((b"tEXt", f"{key}\0{text}".encode("latin-1", "replace")) for key, text in texts.items()),
        (b"IDAT", zlib.compress(rows.tobytes(), 6)),
    ]
    with atomic_write(path) as temporary:
        temporary.write_bytes(_png_bytes((width, height), depth=16, kind=_GREY, chunks=chunks))


def indexed_png(places: NDArray[np.uint8], colours: NDArray[np.uint8], /) -> bytes:
    """Return a plane (Y, X) of places in a table of colours (n, 3), 256 at most, as the bytes of a PNG."""
    height, width = places.shape
    rows = np.zeros((height, 1 + width), np.uint8)
    rows[:, 1:] = places
    chunks = {b"PLTE": colours.tobytes(), b"IDAT": zlib.compress(rows.tobytes(), 9)}
    return _png_bytes((width, height), depth=8, kind=_INDEXED, chunks=chunks.items())


def _png_bytes(pixels: tuple[int, int], /, *, depth: int, kind: int, chunks: Iterable[tuple[bytes, bytes]]) -> bytes:
    """Return the bytes of a PNG of columns × rows pixels: its header, chunks by their kinds, and its end.

    Args:
        pixels: columns and rows.
        depth: bits of a sample.
        kind: of colours, by PNG's number.
        chunks: what stands between header and end.
    """
    header = struct.pack(">IIBBBBB", *pixels, depth, kind, 0, 0, 0)
    return _SIGNATURE + b"".join(_chunk(*one) for one in ((b"IHDR", header), *chunks, (b"IEND", b"")))


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
