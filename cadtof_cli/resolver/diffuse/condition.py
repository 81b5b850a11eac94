"""Gaussian conditioning, one datum after the other: the same few operations for every pixel, whatever stands beside it."""

from collections.abc import Mapping, Sequence
from typing import Any

from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.noise import Entry

Array = Any
"""float64 (n,) of patches or float32 (rows, columns) of pixels."""


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What the data say of the targets.

    `shifts` are the changes of the targets' means, `covariance` is what is left of their covariance, and `chi_squared`
    is χ² of the data.
    """

    shifts: tuple[Array, ...]
    covariance: Mapping[Entry, Array]
    chi_squared: Array


def conditioned(residuals: Sequence[Array], covariance: Mapping[Entry, Array], /) -> Conditioned:
    """Condition the last two variables, the targets, on all others, by elimination in the order of the data.

    Args:
        residuals: data minus their means, in order.
        covariance: lower triangle of the covariance of data and targets. Entries between targets may be left out; they
            are not computed then.
    """
    count = len(residuals)
    left = dict(covariance)
    moved: list[Array] = [*residuals, 0.0, 0.0]
    chi_squared = 0.0
    for i in range(count):
        for j in range(i + 1, count + 2):
            share = left[j, i] / left[i, i]
            moved[j] = moved[j] - share * moved[i]
            for k in range(i + 1, j + 1):
                if (j, k) in left:
                    left[j, k] = left[j, k] - share * left[k, i]
        chi_squared = chi_squared + moved[i] ** 2 / left[i, i]
    remaining = {(j - count, k - count): value for (j, k), value in left.items() if k >= count}
    return Conditioned(tuple(-shift for shift in moved[count:]), remaining, chi_squared)
