"""Names for the array types that pass between the stages, and for the planes of a frame; values spread evenly over an array,
medians and quantiles."""

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
Int64 = NDArray[np.int64]
Status = NDArray[np.uint32]

SomePixels = slice | Index
"""A choice of some of n pixels: consecutive ones, or any by their indices."""

T = TypeVar("T")

Values = TypeVar("Values", Float, Float32)
"""Numbers of either precision, such as float64 for patches and float32 for pixels; results have the precision of the
input."""


def plane_name(harmonic: int, channel: int, /) -> str:
    """Return the name of a plane in EXR files and in messages, such as H1.SC2."""
    return f"H{harmonic}.SC{channel}"


def plane_names(harmonics: tuple[int, ...], /) -> tuple[str, ...]:
    """Return the names of a frame's planes in the order in which files hold them: H1.SC1, H1.SC2, H2.SC1, …"""
    return tuple(plane_name(harmonic, channel) for harmonic in harmonics for channel in (1, 2))


def even_step(size: int, width: int, /, *, count: int) -> int:
    """Return the step by which at least `count` of `size` values, row by row, are evenly spread over rows and columns.

    It has no divisor in common with the width, unless there is one row: else the values would come from a few columns.
    All values are taken if there are no more than `count`; else there are fewer than three times as many.
    """
    steps = range(max(1, size // count), 0, -1)
    return next(step for step in steps if size == width or math.gcd(step, width) == 1)


def spread_values(plane: NDArray[Any], count: int, /) -> NDArray[Any]:
    """Return at least `count` values of a plane (Y, X), or all there are, evenly spread over rows and columns, (n,)."""
    return plane.reshape(-1)[:: even_step(plane.size, plane.shape[1], count=count)]


def quantiles(values: Float, shares: tuple[float, ...], /) -> Float:
    """Return the quantiles of rows, (n,) or (rows, n), as (shares,) or (shares, rows), in less than numpy's time."""
    ordered, place = np.sort(values), np.array(shares) * (values.shape[-1] - 1)
    before = place.astype(np.intp)
    after = np.minimum(before + 1, values.shape[-1] - 1)
    found: Float = ordered[..., before] + (place - before) * (ordered[..., after] - ordered[..., before])
    return found.T


_MANY = 1000
"""Number of values from which on finding the two in the middle takes less time than sorting all."""


def median(values: Float, /) -> Float:
    """Return the medians of rows, (…, n) → (…); NaN counts as the largest number. `np.median` would load `numpy.ma`."""
    count = values.shape[-1]
    middle = (count - 1) // 2, count // 2
    ordered = np.sort(values) if count < _MANY else np.partition(values, middle)
    return np.asarray(0.5 * (ordered[..., middle[0]] + ordered[..., middle[1]]))


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
