"""Names for the array types that pass between the stages, and arrays that many share."""

from dataclasses import is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Stored = NDArray[Any]
"""Values as a file holds them: any integer or float type, axes H C Y X (or H C n for a block of pixels)."""

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex = NDArray[np.complex128]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]
Status = NDArray[np.uint32]

SomePixels = slice | Index
"""Which of n pixels: neighbours, or any."""

T = TypeVar("T")

Values = TypeVar("Values", Float, Float32)
"""Numbers of either precision, such as float64 for patches and float32 for pixels; what is made of them keeps it."""


def sealed(shared: T, /) -> T:
    """Return an array, or a record with all arrays in it, that refuses to be changed: what a cache hands to many."""
    if isinstance(shared, np.ndarray):
        shared.flags.writeable = False
    elif isinstance(shared, tuple):
        for one in shared:
            sealed(one)
    elif is_dataclass(shared):
        sealed(tuple(vars(shared).values()))
    return shared
