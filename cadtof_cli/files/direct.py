"""Bytes on their way to the disk, past what the system keeps of files."""

import errno
import math
import os
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float32
from cadtof_cli.files.system import moved

BLOCK_BYTES = 4096
"""Of a disk: what begins and ends with one, in a file and in memory, needs no copy on its way there."""

_WORTH_IT_BYTES = 2**18


def empty_blocks(shape: tuple[int, ...], /) -> Float32:
    """Return an array of any values whose memory begins with a block of a disk."""
    size = 4 * math.prod(shape)
    memory = np.empty(size + BLOCK_BYTES, np.uint8)
    begin = -_address(memory) % BLOCK_BYTES
    return memory[begin : begin + size].view(np.float32).reshape(shape)


def write_parts(descriptor: int, parts: Sequence[memoryview], /) -> None:
    """Write all parts to an empty file, one after the other, that will be synced.

    A part that lies on whole blocks, in the file and in memory, goes from there to the disk. Copying it for the system first,
    which would do the same later, takes half as long as computing it. Where the file system has no such way, it is copied.
    """
    place = 0
    for part in parts:
        direct = _written_directly(descriptor, part, place)
        moved([part[direct:]], lambda rest: os.write(descriptor, rest[0]))
        place += part.nbytes


def _written_directly(descriptor: int, part: memoryview, place: int) -> int:
    """Write the whole blocks of a part past the system's memory, where there are many and it can be; return how many bytes."""
    whole = part.nbytes - part.nbytes % BLOCK_BYTES
    if whole < _WORTH_IT_BYTES or place % BLOCK_BYTES or not hasattr(os, "O_DIRECT"):
        return 0
    if _address(np.frombuffer(part, np.uint8)) % BLOCK_BYTES:
        return 0
    fcntl = import_module("fcntl")
    written, flags = 0, fcntl.fcntl(descriptor, fcntl.F_GETFL)
    try:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_DIRECT)
        while written < whole:
            written += os.write(descriptor, part[written:whole])
    except OSError as error:
        if error.errno not in {errno.EINVAL, errno.EOPNOTSUPP}:
            raise
    finally:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags)
    return written


def _address(array: NDArray[Any]) -> int:
    """Return where an array begins in memory; numpy's own way to tell it loads `ctypes`."""
    place: int = array.__array_interface__["data"][0]
    return place
