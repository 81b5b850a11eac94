"""Digests of what files hold, cheap enough to be made of every frame and of its maps."""

from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WORDS = 512
"""Words of a row: 4 kB, as memory and disks have them."""

_PIECE_ROWS = 1024


def content_digest(values: NDArray[Any], /) -> str:
    """Return a digest of an array's type, shape and values, 32 hexadecimal digits.

    It finds accidents, not forgeries: the words of 8 bytes are laid out in rows of 512 and added up along rows and along
    columns, modulo 2**64, and BLAKE2b goes over the sums. A change of any one word changes two of them for certain. BLAKE2b over
    everything would cost each frame more.
    """
    digest = blake2b(f"{values.dtype.str}{values.shape}".encode(), digest_size=16)
    data = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
    whole = data.size - data.size % (8 * _WORDS)
    rows = data[:whole].view(np.uint64).reshape(-1, _WORDS)
    for axis in (0, 1):
        digest.update(np.add.reduce(rows, axis=axis).tobytes())
    digest.update(data[whole:].tobytes())
    return digest.hexdigest()


def file_digest(path: Path, /) -> str:
    """Return the digest of a file's bytes, that of an array of them, a few megabytes at a time.

    Raises:
        OSError: it cannot be read.
    """
    row, columns, along_rows, tail, size = 8 * _WORDS, np.zeros(_WORDS, np.uint64), list[bytes](), b"", 0
    with path.open("rb") as file:
        # a map may be as large as all the rest that is in memory
        while piece := file.read(_PIECE_ROWS * row):
            size += len(piece)
            whole = len(piece) - len(piece) % row
            rows = np.frombuffer(piece, np.uint64, whole // 8).reshape(-1, _WORDS)
            columns += np.add.reduce(rows, axis=0)
            along_rows.append(np.add.reduce(rows, axis=1).tobytes())
            tail = piece[whole:]
    digest = blake2b(f"{np.dtype(np.uint8).str}{(size,)}".encode(), digest_size=16)
    for part in (columns.tobytes(), *along_rows, tail):
        digest.update(part)
    return digest.hexdigest()
