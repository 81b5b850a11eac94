"""Digests of files and arrays, by which accidental changes and copies are noticed. They give no protection against forgery."""

from pathlib import Path

import numpy as np
from xxhash import xxh3_128

from cadtof_cli.arrays import Stored

Digest = xxh3_128
"""The hash function, fast enough for every frame and its maps."""

_CHUNK_BYTES = 2**22


def file_digest(path: Path, /) -> str:
    """Return the digest of a file's bytes; raise OSError if it cannot be read."""
    digest = Digest()
    with path.open("rb", buffering=0) as file:
        # a map may be large, so it is read in pieces
        while piece := file.read(_CHUNK_BYTES):
            digest.update(piece)
    return digest.hexdigest()


def content_digest(values: Stored, /) -> str:
    """Return a digest of an array's type, shape and values, 32 hexadecimal digits."""
    digest = Digest(np.ascontiguousarray(values).data)
    digest.update(f"{values.dtype.str}{values.shape}".encode())
    return digest.hexdigest()
