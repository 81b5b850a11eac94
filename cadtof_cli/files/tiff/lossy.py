"""Finds out whether a TIFF's compression changes values.

The code of a compression stands for lossless and lossy data alike, so the compressed bytes are examined.
"""

import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from cadtof_cli.files.tiff import jpeg_xr
from cadtof_cli.files.tiff.remarks import reading_tiff

_LERC_PARAMETERS = 50674

_DEFLATE, _ZSTANDARD = 1, 2
"""Codes of the compressions that may be applied to LERC data."""

_MOST_HEADER_BYTES = 64
"""Number of bytes in which the header of a JPEG XR fits, unless the image has hundreds of tiles."""

_ROUNDING = 0.5
"""The largest error that LERC declares for whole numbers that it keeps exactly."""


def lossy_compression(path: Path, _dtype: np.dtype[Any], /) -> str | None:
    """Return the name of the compression of the file's first page if it changes values.

    None: it does not change values, or the compressed data has a header that we do not understand.
    """
    with reading_tiff(path), tifffile.TiffFile(path) as tiff:
        page = tiff.pages.first
        examine = _EXAMINE.get(int(page.compression))
        if examine is None or not page.databytecounts:
            return None
        tiff.filehandle.seek(page.dataoffsets[0])
        data = tiff.filehandle.read(page.databytecounts[0])
        with suppress(struct.error, IndexError, ValueError):
            return examine(data, page)
    return None


def _jpeg(data: bytes, _page: tifffile.TiffPage) -> str | None:
    """Examine JPEG: the kind of its frame tells whether it is lossless (SOF3) or lossy (other kinds)."""
    place = 2
    while data[place] == 0xFF and data[place + 1] not in _FRAME_KINDS:
        (length,) = struct.unpack_from(">H", data, place + 2)
        place += 2 + length
    return None if data[place + 1] in _LOSSLESS_KINDS else "JPEG"


_FRAME_KINDS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_LOSSLESS_KINDS = frozenset({0xC3, 0xC7, 0xCB, 0xCF})


def _jpeg_2000(data: bytes, _page: tifffile.TiffPage) -> str | None:
    """Examine JPEG 2000: the wavelet 9/7 cannot be reversed, 5/3 can; the marker COD says which of them is used."""
    place = data.find(b"\xff\x52")
    return "JPEG 2000" if place >= 0 and data[place + 13] == 0 else None


def _webp(data: bytes, _page: tifffile.TiffPage) -> str | None:
    return None if b"VP8L" in data[12:64] else "WebP"


def _lerc(data: bytes, page: tifffile.TiffPage) -> str | None:
    """Examine LERC: the header of LERC2 holds the largest error that was allowed."""
    import imagecodecs

    _, packed = page.tags.valueof(_LERC_PARAMETERS, default=(0, 0))
    if packed == _DEFLATE:
        data = bytes(imagecodecs.zlib_decode(data))
    elif packed == _ZSTANDARD:
        data = bytes(imagecodecs.zstd_decode(data))
    if not data.startswith(b"Lerc2 "):
        return None
    (version,) = struct.unpack_from("<i", data, 6)
    # checksum, rows, columns, values per pixel, valid pixels, block, bytes, type; more of them in later versions
    numbers = 6 + (version >= 3) + (version >= 4) + 2 * (version >= 6)
    (error,) = struct.unpack_from("<d", data, 10 + 4 * numbers)
    kept = _ROUNDING if page.dtype is not None and page.dtype.kind in "iu" else 0.0
    return f"LERC with errors up to {error:g}" if error > kept else None


def _jpeg_xl(data: bytes, _page: tifffile.TiffPage) -> str | None:
    """Examine JPEG XL: lossy data holds the pixels in its own colour space, XYB."""
    start = data.find(b"\xff\x0a", data.find(b"jxlc") if data.startswith(b"\0\0\0\x0cJXL ") else 0)
    bits = int.from_bytes(data[start + 2 : start + 34], "little")

    def take(count: int) -> int:
        nonlocal bits
        taken, bits = bits & ((1 << count) - 1), bits >> count
        return taken

    def take_size(in_blocks: int) -> None:
        take(5 if in_blocks else (9, 13, 18, 30)[take(2)])

    in_blocks = take(1)
    take_size(in_blocks)
    if not take(3):
        take_size(in_blocks)
    if take(1):
        return "JPEG XL"
    if take(1) and take(6) >> 3:
        # the fields after this one have no fixed place
        return None
    is_float = take(1)
    if take(2) == 3:
        take(6)
    take(4 * is_float + 1)
    return "JPEG XL" if not take(2) and take(1) else None


_GREY = 0
_SHIFTED = frozenset({2, 3, 6})
"""Types of samples, whole numbers of 16 and 32 bits, whose low bits may be left out."""
_FLOAT32 = 7
_MANTISSA_BITS = 23


def _jpeg_xr(data: bytes, _page: tifffile.TiffPage) -> str | None:
    """Examine JPEG XR: lossless data keeps all bits and all bands, with divisors of 1 (ITU-T T.832, 8.3 and 8.4)."""
    start = data.index(jpeg_xr.BEGIN) + len(jpeg_xr.BEGIN)
    header = data[start : start + _MOST_HEADER_BYTES].ljust(_MOST_HEADER_BYTES, b"\0")
    bits, place = int.from_bytes(header, "big"), 8 * _MOST_HEADER_BYTES

    def take(count: int) -> int:
        nonlocal place
        place -= count
        return bits >> place & ((1 << count) - 1)

    take(8)
    tiled = take(1)
    take(7)
    short, _, windowed, trimmed, _ = (take(count) for count in (1, 1, 1, 1, 8))
    kind = take(4)
    take(32 if short else 64)
    if tiled:
        columns, rows = take(12), take(12)
        take((columns + rows) * (8 if short else 16))
    take(24 * windowed)
    colours, scaled, bands_left_out = take(3), take(1), take(4)
    if trimmed or scaled or bands_left_out:
        return "JPEG XR"
    if colours != _GREY:
        # the fields after this one depend on the colours
        return None
    if (kind in _SHIFTED and take(8)) or (kind == _FLOAT32 and take(16) >> 8 < _MANTISSA_BITS):
        return "JPEG XR"
    # for each band: is there one divisor for the whole image, and which? Or is it the divisor of the band before?
    coarse = not take(1) or take(8) > 1
    for _ in range(2):
        coarse = coarse or (not take(1) and (not take(1) or take(8) > 1))
    return "JPEG XR" if coarse else None


_EXAMINE: dict[int, Callable[[bytes, tifffile.TiffPage], str | None]] = {
    **dict.fromkeys((6, 7, 99, 33007, 34892), _jpeg),
    **dict.fromkeys((33003, 33004, 33005, 34712), _jpeg_2000),
    **dict.fromkeys((34927, 50001), _webp),
    **dict.fromkeys((50002, 52546), _jpeg_xl),
    **dict.fromkeys(jpeg_xr.COMPRESSIONS, _jpeg_xr),
    34887: _lerc,
}
"""Functions that examine compressed data, by the code of the compression; see `lossy_compression`."""
