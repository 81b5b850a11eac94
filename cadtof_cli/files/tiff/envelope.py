"""What stands around the pixels of a TIFF file. Frames of a recording, and maps of a run, differ in their pixels alone.

So tifffile and our checks are needed for the first of them only: a file with the same bytes around as many pixels is read and
written as that one was.
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
"""Most bytes around the pixels kept in memory; where there are more, reading the pages costs little beside the pixels."""


@dataclass(frozen=True)
class Envelope:
    """The bytes of a file before and after one run of `pixels` bytes of pixels."""

    head: bytes
    pixels: int
    tail: bytes

    @classmethod
    def of(cls, file: FileHandle, first: int, pixels: int, /) -> "Envelope | None":
        """Return the bytes around the pixels, which begin at byte `first` of an open file; None where they are too many."""
        # what was written since it was opened counts
        if not 0 <= file.seek(0, os.SEEK_END) - pixels <= LARGEST_BYTES:
            return None
        file.seek(0)
        head = file.read(first)
        file.seek(first + pixels)
        return cls(head, pixels, file.read())

    def read(self, path: Path, /, *, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any] | None:
        """Return the pixels of a file that has the same bytes around as many of them; None of any other.

        Raises:
            OSError: it cannot be read.
        """
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
            # it may have grown meanwhile
            same = whole and head == self.head and tail == self.tail and not os.read(descriptor, 1)
            return out if same else None
        finally:
            os.close(descriptor)

    def around(
        self, pixels: NDArray[Any], image: memoryview | None, /, *, old: bytes, new: bytes
    ) -> Sequence[memoryview]:
        """Return the parts of a file with these bytes around other pixels, `old` ones among them replaced by as many `new` ones.

        It is a single part where the pixels lie in an `image` that has a block before them and room for the rest behind.
        """
        head, tail = self.head.replace(old, new), self.tail.replace(old, new)
        behind = BLOCK_BYTES + self.pixels
        if image is None or len(head) != BLOCK_BYTES or behind + len(tail) > len(image):
            return memoryview(head), pixels.data.cast("B"), memoryview(tail)
        end = behind + len(tail)
        image[:BLOCK_BYTES], image[behind:end] = head, tail
        return (image[:end],)
