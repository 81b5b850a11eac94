"""The envelope of a TIFF file: all bytes before and after its pixels.

The frames of a recording differ only in their pixels, and so do the maps of a run. So only the first file is read with
tifffile and our checks, or written by tifffile. If another file has the same envelope around the same number of pixels,
its pixels are at the same place, and no check can give another result.
"""

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tifffile import FileHandle

from cadtof_cli.files.system import BLOCK_BYTES, READ_FLAGS, read_parts
from cadtof_cli.records import dataclass

LARGEST_BYTES = 2**20
"""Largest envelope, in bytes, that is kept. With a larger one, reading the pages costs little beside the pixels."""


@dataclass(frozen=True)
class Envelope:
    """The bytes of a file before (`head`) and after (`tail`) a single run of pixels, which takes `pixels` bytes."""

    head: bytes
    pixels: int
    tail: bytes

    @classmethod
    def of(cls, file: FileHandle, first: int, pixels: int, /) -> "Envelope | None":
        """Return the envelope of an open file whose `pixels` bytes of pixels begin at byte `first`.

        None: it is larger than `LARGEST_BYTES`, or the pixels do not fit into the file.
        """
        # not `file.size`, which does not count what was written since the file was opened
        if not 0 <= file.seek(0, os.SEEK_END) - pixels <= LARGEST_BYTES:
            return None
        file.seek(0)
        head = file.read(first)
        file.seek(first + pixels)
        return cls(head, pixels, file.read())

    def replaced(self, old: bytes, new: bytes, /) -> "Envelope":
        """Return the envelope with `new` in place of its bytes `old`."""
        return Envelope(self.head.replace(old, new), self.pixels, self.tail.replace(old, new))

    def read(self, path: Path, /, *, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any] | None:
        """Return the pixels of a file that has this envelope; None: the file has another, or `shape` does not fit."""
        out = np.empty(shape, dtype)
        if out.nbytes != self.pixels:
            return None
        head, tail = bytearray(len(self.head)), bytearray(len(self.tail))
        descriptor = os.open(path, READ_FLAGS)
        try:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode) or found.st_size != len(head) + self.pixels + len(tail):
                return None
            whole = read_parts(descriptor, (memoryview(head), out.data.cast("B"), memoryview(tail)))
            # the last read: the file may have grown in the meantime
            same = whole and head == self.head and tail == self.tail and not os.read(descriptor, 1)
            return out if same else None
        finally:
            os.close(descriptor)

    def around(
        self, pixels: NDArray[Any], image: memoryview | None, /, *, old: bytes, new: bytes
    ) -> Sequence[memoryview]:
        """Return the parts of a file with this envelope, with `new` in place of its bytes `old`, around other pixels.

        `image` is memory with one disk block, then the pixels, then free space; see `DepthMaps`. If the head takes
        exactly one block and the tail fits behind the pixels, there is one part, a piece of `image`. Otherwise there
        are three parts: head, pixels, tail.
        """
        other = self.replaced(old, new)
        head, tail = other.head, other.tail
        behind = BLOCK_BYTES + self.pixels
        if image is None or len(head) != BLOCK_BYTES or behind + len(tail) > len(image):
            return memoryview(head), pixels.data.cast("B"), memoryview(tail)
        end = behind + len(tail)
        image[:BLOCK_BYTES], image[behind:end] = head, tail
        return (image[:end],)
