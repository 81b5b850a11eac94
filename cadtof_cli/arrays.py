"""Names for the array types that pass between the stages, and arrays that several callers share."""

import itertools
import math
from dataclasses import is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Stored = NDArray[Any]
"""Values as a file holds them: any integer or float type, axes (H, C, Y, X), or (H, C, n) for a block of pixels."""

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Complex = NDArray[np.complex128]
Complex64 = NDArray[np.complex64]
Bool = NDArray[np.bool_]
Index = NDArray[np.intp]
Status = NDArray[np.uint32]

SomePixels = slice | Index
"""A choice of some of n pixels: consecutive ones, or any by their indices."""

T = TypeVar("T")

Values = TypeVar("Values", Float, Float32)
"""Numbers of either precision, such as float64 for patches and float32 for pixels; results have the precision of the
input."""


def spread_values(plane: NDArray[Any], most: int, /) -> NDArray[Any]:
    """Return about `most` values of a plane (Y, X), evenly spread over its rows and columns, (n,).

    The step from one value to the next has no divisor in common with the width: else they would come from a few columns.
    """
    steps = itertools.count(max(1, plane.size // most))
    return plane.reshape(-1)[:: next(step for step in steps if math.gcd(step, plane.shape[1]) == 1)]


def sealed(shared: T, /) -> T:
    """Make an array, or all arrays in a record, read-only, and return it: a cache hands it to several callers."""
    if isinstance(shared, np.ndarray):
        shared.flags.writeable = False
    elif isinstance(shared, tuple):
        for one in shared:
            sealed(one)
    elif is_dataclass(shared):
        sealed(tuple(vars(shared).values()))
    return shared
