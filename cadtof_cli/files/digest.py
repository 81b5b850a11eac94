"""Digests of what files hold, cheap enough to be made of every frame and of its maps."""

from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    # hashlib's own, without the library that it loads for other digests
    from _blake2 import blake2b
except ImportError:
    from hashlib import blake2b

compiled: ModuleType | None = None
"""The twin of `numpy_sums`; None where cadtof was installed without a C compiler."""

with suppress(ImportError):
    compiled = import_module("cadtof_cli.files._digest")

_WORDS = 512
"""Words of a row: 4 kB, as memory and disks have them."""

_ROW = 8 * _WORDS

_PIECE_BYTES = 1024 * _ROW


class Digest:
    """A digest of bytes that come piece by piece.

    It finds accidents, not forgeries: the words of 8 bytes are laid out in rows of 512 and added up along rows and along
    columns, modulo 2**64, and BLAKE2b goes over the sums. A change of any one word changes two of them for certain. BLAKE2b over
    everything would cost each frame more.
    """

    def __init__(self) -> None:
        self._columns, self._rows = np.zeros(_WORDS, np.uint64), list[bytes]()
        self._rest, self._size = b"", 0

    def update(self, data: bytes | memoryview, /) -> None:
        """Go on with some more bytes."""
        piece = memoryview(data).cast("B")
        self._size += len(piece)
        if self._rest:
            missing = _ROW - len(self._rest)
            self._rest += piece[:missing]
            piece = piece[missing:]
            if len(self._rest) < _ROW:
                return
            self._add(memoryview(self._rest))
        whole = len(piece) - len(piece) % _ROW
        self._add(piece[:whole])
        self._rest = bytes(piece[whole:])

    def _add(self, rows: memoryview) -> None:
        sums = np.empty(len(rows) // _ROW, np.uint64)
        _sums(rows, self._columns, sums)
        self._rows.append(sums.tobytes())

    def hexdigest(self, about: str = "", /) -> str:
        """Return 32 hexadecimal digits, of the bytes and of what is said `about` them."""
        digest = blake2b(f"{self._size}{about}".encode(), digest_size=16)
        for part in (self._columns.tobytes(), *self._rows, self._rest):
            digest.update(part)
        return digest.hexdigest()


def numpy_sums(data: memoryview, columns: NDArray[np.uint64], rows: NDArray[np.uint64], /) -> None:
    """Add whole rows of words to `columns`, (512,), and write the sum of each into `rows`, (n,), modulo 2**64."""
    words = np.frombuffer(data, np.uint64).reshape(-1, _WORDS)
    columns += np.add.reduce(words, axis=0)
    np.add.reduce(words, axis=1, out=rows)


_sums: Callable[[memoryview, NDArray[np.uint64], NDArray[np.uint64]], None] = compiled.sums if compiled else numpy_sums


def bytes_digest(data: bytes, /) -> str:
    """Return the digest of some bytes, that of a file which holds them."""
    digest = Digest()
    digest.update(data)
    return digest.hexdigest()


def content_digest(values: NDArray[Any], /) -> str:
    """Return a digest of an array's type, shape and values, 32 hexadecimal digits."""
    digest = Digest()
    digest.update(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return digest.hexdigest(f"{values.dtype.str}{values.shape}")


def file_digest(path: Path, /) -> str:
    """Return the digest of a file's bytes, a few megabytes at a time.

    Raises:
        OSError: it cannot be read.
    """
    digest = Digest()
    with path.open("rb", buffering=0) as file:
        # a map may be as large as all the rest that is in memory
        while piece := file.read(_PIECE_BYTES):
            digest.update(piece)
    return digest.hexdigest()
