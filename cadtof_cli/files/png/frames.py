"""Planes in PNG files, 8 or 16 bits of grey; a file holds one plane, so frames come by `[layout] pattern`."""

import struct
from contextlib import AbstractContextManager
from pathlib import Path

import imagecodecs
import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import FrameLayout, Frames, NotAFrameError
from cadtof_cli.files.library_output import library_output
from cadtof_cli.files.reading import damage_as_frame_error, require_plausible_size

_HEADER = struct.Struct(">8xI4sIIBB")
_GREY = 0
_HARMLESS = "Interlace handling"
"""The library remarks on every interlaced picture, and decodes it."""

_COLOUR_TYPES = {2: "RGB", 3: "a palette", 4: "grey and opacity", 6: "RGBA"}


def open_frames(path: Path, layout: FrameLayout, /) -> AbstractContextManager[Frames]:
    """Refuse a file in place of a whole frame: it holds one plane.

    Raises:
        NotAFrameError: always; the message says how planes become frames.
    """
    height, width, bits = _size(path, path.read_bytes()[: _HEADER.size])
    raise NotAFrameError(
        f"{path}: holds one plane of {width} × {height}, {bits} bits; expected {layout.planes} planes per frame: one PNG each,"
        ' and their names in [layout] pattern, such as "{frame}_h{harmonic}_sc{channel}.png"'
    )


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the plane of a file, uint8 or uint16 (Y, X).

    Raises:
        NotAFrameError: it is a picture in colour.
        FrameError: the file cannot be read, is damaged, or has less than 8 bits.
    """
    with damage_as_frame_error(path, "PNG"):
        content = path.read_bytes()
        height, width, bits = _size(path, content)
        require_plausible_size(path, height * width * 2, len(content))
        with library_output() as printed:
            plane: Stored = imagecodecs.png_decode(content)
    said = [line for line in printed if _HARMLESS not in line]
    if said:
        raise FrameError(f"{path}: damaged PNG: {'; '.join(said)}; expected a complete file, try copying it again")
    if plane.shape != (height, width) or plane.dtype != np.dtype(f"u{bits // 8}"):
        raise FrameError(
            f"{path}: damaged PNG: found {plane.shape} {plane.dtype}, its header promises {height}, {width}"
        )
    return plane


def _size(path: Path, content: bytes) -> tuple[int, int, int]:
    """Return height, width and bits of a grey picture by its header."""
    if len(content) < _HEADER.size:
        raise FrameError(f"{path}: damaged PNG: found {len(content)} bytes, expected a header")
    _, _, width, height, bits, colour = _HEADER.unpack_from(content)
    if colour != _GREY:
        kind = _COLOUR_TYPES.get(colour, f"colour type {colour}")
        raise NotAFrameError(f"{path}: holds a colour picture ({kind}), expected one plane of voltages in grey")
    if bits not in (8, 16):
        raise FrameError(f"{path}: found {bits} bits per pixel, expected 16 (or 8)")
    return height, width, bits
