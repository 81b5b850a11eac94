"""PNG files: planes of recorded frames, and pictures that we write.

A file holds one plane, in grey with 8 or 16 bits. So a frame is several files, which `[layout] pattern` describes.
"""

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.atomic import atomic_write
from cadtof_cli.files.formats import PNG
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.files.library_output import library_output
from cadtof_cli.files.reading import damage_as_frame_error, in_brief, read_bytes, require_plausible_size

_HEADER = struct.Struct(">8xI4sIIBB")
_GREY, _INDEXED = 0, 3
_EXIF, _TRANSPARENT, _LAST_CHUNK = b"eXIf", b"tRNS", b"IEND"
_ORIENTATION = 274
_TURNED = range(2, 9)
_HARMLESS = "Interlace handling"
"""Part of a warning that the library prints for every interlaced picture, which it decodes correctly."""

_COLOUR_TYPES = {2: "RGB", 3: "a palette", 4: "grey and opacity", 6: "RGBA"}


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the plane of a file, uint8 or uint16 (Y, X)."""
    import imagecodecs

    with damage_as_frame_error(path, "PNG"):
        content = read_bytes(path)
        height, width, bits = _size(path, content)
        require_plausible_size(path, height * width * 2, len(content))
        _require_sound_chunks(path, memoryview(content))
        with library_output() as printed:
            plane: Stored = imagecodecs.png_decode(content)
    remarks = [line for line in printed if _HARMLESS not in line]
    if remarks:
        raise FrameError(f"{path}: damaged PNG: {in_brief(remarks)}; expected a complete file, try copying it again")
    if plane.shape != (height, width) or plane.dtype != np.dtype(f"u{bits // 8}"):
        raise FrameError(
            f"{path}: damaged PNG: found {plane.shape} {plane.dtype}, its header promises {height}, {width}"
        )
    return plane


def _require_sound_chunks(path: Path, content: memoryview) -> None:
    """Make sure that all chunks are complete and have the right checksums, and that the picture is neither turned nor
    transparent.

    The library would find damaged chunks too. But it loses memory at each failure, and thousands of failures in one
    process abort the process.
    """
    place = len(PNG.magics[0])
    while content[place + 4 : place + 8] != _LAST_CHUNK:
        end = place + int.from_bytes(content[place : place + 4]) + 12
        if end > len(content):
            raise FrameError(f"{path}: truncated PNG: reaches to byte {end:,}, found a file of {len(content):,} bytes")
        if zlib.crc32(content[place + 4 : end - 4]) != int.from_bytes(content[end - 4 : end]):
            raise FrameError(f"{path}: damaged PNG: the checksum of bytes {place:,} to {end:,} is wrong")
        if content[place + 4 : place + 8] == _TRANSPARENT:
            raise NotAFrameError(
                f"{path}: holds a colour picture (one grey is transparent), expected one plane of voltages in grey"
            )
        if content[place + 4 : place + 8] == _EXIF:
            _require_first_row_on_top(path, bytes(content[place + 8 : end - 4]))
        place = end


def _require_first_row_on_top(path: Path, exif: bytes) -> None:
    """Refuse a plane if its Exif data (in the form of a TIFF's first page) says that viewers must turn the picture."""

    def number(place: int, size: int) -> int:
        return int.from_bytes(exif[place : place + size], "little" if exif[:2] == b"II" else "big")

    begin = number(4, 4)
    for tag in range(begin + 2, begin + 2 + 12 * number(begin, 2), 12):
        if number(tag, 2) == _ORIENTATION and number(tag + 8, 2) in _TURNED:
            raise FrameError(
                f"{path}: found orientation {number(tag + 8, 2)}, so rows or columns are turned; expected 1, the first row on top"
            )


def _size(path: Path, content: bytes) -> tuple[int, int, int]:
    """Return height, width and bits per pixel of a grey picture from its header; refuse pictures of any other kind."""
    if len(content) < _HEADER.size:
        raise FrameError(f"{path}: damaged PNG: found {len(content)} bytes, expected a header")
    _, _, width, height, bits, colour = _HEADER.unpack_from(content)
    if colour != _GREY:
        kind = _COLOUR_TYPES.get(colour, f"colour type {colour}")
        raise NotAFrameError(f"{path}: holds a colour picture ({kind}), expected one plane of voltages in grey")
    if bits not in (8, 16):
        raise FrameError(f"{path}: found {bits} bits per pixel, expected 16 (or 8)")
    return height, width, bits


def write_grey_png(path: Path, plane: NDArray[np.uint16], /, *, texts: dict[str, str]) -> None:
    """Write a plane (Y, X) as a 16-bit grey PNG with texts by keyword; the file appears whole or not at all."""
    chunks = [(b"tEXt", f"{key}\0{text}".encode("latin-1", "replace")) for key, text in texts.items()]
    with atomic_write(path) as temporary:
        temporary.write_bytes(_png_bytes(plane.astype(">u2"), kind=_GREY, before=chunks, level=6))


def indexed_png(places: NDArray[np.uint8], colours: NDArray[np.uint8], /) -> bytes:
    """Return the bytes of a PNG whose pixels (Y, X) are indices into a table of at most 256 colours, (n, 3)."""
    return _png_bytes(places, kind=_INDEXED, before=[(b"PLTE", colours.tobytes())], level=9)


def _png_bytes(
    plane: NDArray[np.unsignedinteger], /, *, kind: int, before: Sequence[tuple[bytes, bytes]], level: int
) -> bytes:
    """Return the bytes of a PNG of big-endian pixels (Y, X) and a colour type, with these chunks `before` the pixels.

    `level` is how hard pixels are compressed: 1 to 9.
    """
    height, width = plane.shape
    # each row begins with a filter type; 0 is no filter
    rows = np.pad(plane.view(np.uint8), ((0, 0), (1, 0)))
    header = struct.pack(">IIBBBBB", width, height, 8 * plane.itemsize, kind, 0, 0, 0)
    chunks = ((b"IHDR", header), *before, (b"IDAT", zlib.compress(rows.tobytes(), level)), (b"IEND", b""))
    return PNG.magics[0] + b"".join(_chunk(*one) for one in chunks)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
