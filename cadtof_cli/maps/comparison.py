"""The differences between two maps of the same pixels, gathered over any number of frames in bounded memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32, Status
from cadtof_cli.resolver.status import StatusBit

EXACT_VALUES = 1 << 22
"""Largest number of values with exact quantiles. Of more values, quantiles are those of bins as wide as 1/4096 of the
value."""

_SHIFT = 11
"""Number of lowest bits of a float32 that are dropped to get the bin of a value."""


@dataclass(frozen=True)
class LayerDifference:
    """How much a layer differs in the pixels that have a value in both maps: median, 90 % quantile and largest of |A −
    B|; None if there are no such pixels."""

    median_abs: float | None
    p90_abs: float | None
    max_abs: float | None


@dataclass
class BitChange:
    """How many pixels have a status bit in B but not in A, and the other way round."""

    gained: int
    lost: int


class MagnitudeTally:
    """Quantiles of magnitudes: of the values themselves while they are few, later of counts in bins."""

    def __init__(self, *, exact: int = EXACT_VALUES) -> None:
        self._exact, self._values, self._size, self._largest = exact, list[Float32](), 0, -np.inf
        self._counts: NDArray[np.int64] | None = None

    def add(self, values: NDArray[np.floating], /) -> None:
        """Add values of any sign; values that are not finite, or too large for a float32, do not count."""
        with np.errstate(over="ignore"):
            found = np.abs(values).astype(np.float32)
        found = found[np.isfinite(found)]
        if not found.size:
            return
        self._size += found.size
        self._largest = max(self._largest, float(found.max()))
        self._values.append(found)
        if self._counts is not None or self._size > self._exact:
            self._count()

    def _count(self) -> None:
        if self._counts is None:
            self._counts = np.zeros(1 << (31 - _SHIFT), np.int64)
        for values in self._values:
            np.add.at(self._counts, values.view(np.uint32) >> _SHIFT, 1)
        self._values.clear()

    def summary(self) -> LayerDifference:
        """Return quantiles and the largest of the values so far."""
        if not self._size:
            return LayerDifference(None, None, None)
        return LayerDifference(self._quantile(0.5), self._quantile(0.9), self._largest)

    def _quantile(self, share: float) -> float:
        if self._counts is None:
            return float(np.quantile(np.concatenate(self._values).astype(np.float64), share))
        place = np.searchsorted(np.cumsum(self._counts), share * self._size)
        edges = (np.array([place, place + 1], np.uint32) << np.uint32(_SHIFT)).view(np.float32)
        return 0.0 if place == 0 else min(float(edges.mean()), self._largest)


def changed_bits(before: Status, after: Status, /) -> dict[StatusBit, BitChange]:
    """Return, for every status bit, how many pixels gained and lost it between two maps of the same shape."""
    gained, lost = after & ~before, before & ~after
    return {
        bit: BitChange(*(int(np.count_nonzero(bits & np.uint32(bit))) for bits in (gained, lost))) for bit in StatusBit
    }


def difference(first: NDArray[np.generic], second: NDArray[np.generic], /) -> Float:
    """Return A − B of a layer, float64; NaN if A or B has no value."""
    with np.errstate(invalid="ignore"):
        return np.asarray(first.astype(np.float64) - second.astype(np.float64))
