"""A plane of places in a table of colours as a PNG."""

import zlib

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.grey_png import png_bytes

_INDEXED, _NO_FILTER = 3, 0


def indexed_png(places: NDArray[np.uint8], colours: NDArray[np.uint8], /) -> bytes:
    """Return a plane (Y, X) of places in a table of colours (n, 3), 256 at most, as the bytes of a PNG."""
    height, width = places.shape
    rows = np.full((height, 1 + width), _NO_FILTER, np.uint8)
    rows[:, 1:] = places
    chunks = {b"PLTE": colours.tobytes(), b"IDAT": zlib.compress(rows.tobytes(), 9)}
    return png_bytes((width, height), depth=8, kind=_INDEXED, chunks=chunks.items())
