"""A plane of 16-bit values as a PNG."""

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.atomic import whole_file

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def write_grey_png(path: Path, plane: NDArray[np.uint16], /, *, texts: dict[str, str]) -> None:
    """Write a plane (Y, X) as a 16-bit greyscale PNG with texts by keyword, which appears whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    height, width = plane.shape
    rows = np.zeros((height, 1 + 2 * width), np.uint8)  # each row begins with its filter: none
    rows[:, 1:] = plane.astype(">u2").view(np.uint8)
    chunks = [
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)),
        *(_chunk(b"tEXt", f"{key}\0{text}".encode("latin-1", "replace")) for key, text in texts.items()),
        _chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)),
        _chunk(b"IEND", b""),
    ]
    with whole_file(path) as temporary:
        temporary.write_bytes(_SIGNATURE + b"".join(chunks))


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
