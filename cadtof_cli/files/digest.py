"""Digests of files and arrays, fast enough for every frame and its maps.

They are XXH3's, of 128 bits: they find accidents, not forgeries.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from xxhash import xxh3_128

_CHUNK_BYTES = 2**22

Digest = xxh3_128
"""A digest that bytes are added to piece by piece."""


def content_digest(values: NDArray[Any], /) -> str:
    """Return a digest of an array's type, shape and values, 32 hexadecimal digits."""
    digest = Digest(np.ascontiguousarray(values).data)
    digest.update(f"{values.dtype.str}{values.shape}".encode())
    return digest.hexdigest()


def file_digest(path: Path, /) -> str:
    """Return the digest of a file's bytes, a few megabytes at a time.

    Raises:
        OSError: it cannot be read.
    """
    digest = Digest()
    with path.open("rb", buffering=0) as file:
        # a map may be large: never all of it in memory
        while piece := file.read(_CHUNK_BYTES):
            digest.update(piece)
    return digest.hexdigest()
