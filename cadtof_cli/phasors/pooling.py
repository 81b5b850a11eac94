"""Phasors with less noise: the mean over those neighbours that show the same light, as far as the known noise can tell.

Phasors are linear in the voltages, so a mean of phasors is what an exposure as many times as long would have recorded. A
neighbour counts where its phasors, in confidence and in phase at every harmonic, differ from the pixel's by no more than noise
does; across an edge they differ by far more, so edges stay where they are.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel

LOST_NEIGHBOURS = 1e-3
"""Share of neighbours with the same light that noise alone keeps out."""

ROWS = 8
"""Rows of a frame that are dealt with at a time."""

Offset = tuple[slice, slice]


@dataclass(frozen=True)
class PooledPhasors:
    """Pooled phasors, complex128 (H, Y, X), and over how many recorded pixels each is a mean, float64 (Y, X)."""

    phasors: Complex
    samples: Float


def pooled_phasors(
    phasors: Complex, /, *, usable: Bool, samples: Float, noise: NoiseModel, window: int
) -> PooledPhasors:
    """Return the means of every pixel and its neighbours with the same light; inputs are not changed.

    Neighbours are compared twice: with the pixel, and then with the mean that came of it, whose noise is small. So a pixel
    that noise has thrown far from the others still finds them.

    Args:
        phasors: (H, Y, X), each the mean of `samples` recorded pixels.
        usable: (Y, X); pixels that are not keep their phasors, and give nothing to their neighbours.
        samples: (Y, X), at least 1.
        noise: noise of a recorded pixel.
        window: side of the square of neighbours, an odd number of pixels.
    """
    scales = np.array([1.0 / np.sqrt(harmonic.dark_variance) for harmonic in noise.each])[:, np.newaxis, np.newaxis]
    scaled = np.where(usable, phasors, 0.0) * scales
    given, weight = np.stack([scaled.real, scaled.imag]).reshape(-1, *usable.shape), np.where(usable, samples, 0.0)
    limit = chi_squared_threshold(LOST_NEIGHBOURS, pairs=len(phasors))
    mean, pooled = given, weight
    for _ in range(2):
        mean, pooled = _means(given, weight, mean, pooled, limit, window // 2)
    real, imag = mean.reshape(2, *phasors.shape) / scales
    return PooledPhasors(np.where(usable, real + 1j * imag, phasors), np.where(usable, pooled, samples))


def pooling_seconds(size: tuple[int, int], noise: NoiseModel, /, *, window: int) -> float:
    """Return about how long the pooling of a frame of (Y, X) pixels takes, by timing a few of its steps."""
    if window == 1 or 0 in size:
        return 0.0
    phasors, samples = np.ones((len(noise.each), *size), np.complex128), np.ones(size)
    began = time.perf_counter()
    pooled_phasors(phasors, usable=samples > 0.0, samples=samples, noise=noise, window=3)
    of_one = (time.perf_counter() - began) / 8
    # of an offset that reaches far, few pixels are left
    kept = np.mean([max(extent - window / 4, 0.0) / extent for extent in size])
    return float((window**2 - 1) * of_one * kept)


def _means(
    given: Float, weight: Float, reference: Float, reference_weight: Float, limit: float, reach: int
) -> tuple[Float, Float]:
    """Return the weighted means of neighbours that agree with the reference of a pixel, and the sums of their weights.

    `given` and `reference` are planes of numbers, (n, Y, X), whose noise is 1 for a pixel of weight 1. Where both are the same,
    neighbours agree with each other or do not: each pair is looked at once. A few rows are dealt with at a time, for all
    offsets, as they stay in the processor's cache then.
    """
    both = reference is given
    total, weights = given * weight, weight.copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        most, reference_most = limit / weight, limit / reference_weight
        for first in range(0, weight.shape[0], ROWS):
            for here, there in _neighbours(weight.shape, reach, range(first, first + ROWS), half=both):
                misfit = reference[:, *here] - given[:, *there]
                misfit *= misfit
                # what is not usable has no limit, and no weight; nobody looks at its own mean
                alike = np.add.reduce(misfit, axis=0) <= reference_most[here] + most[there]
                for to, other in ((here, there), (there, here))[: 1 + both]:
                    counted = alike * weight[other]
                    total[:, *to] += np.multiply(given[:, *other], counted, out=misfit)
                    weights[to] += counted
        return total / weights, weights


def _neighbours(shape: tuple[int, ...], reach: int, rows: range, *, half: bool) -> Iterator[tuple[Offset, Offset]]:
    """Yield, for every offset but none, the pixels of some rows that have such a neighbour, and those neighbours.

    `half`: leave out the offsets that are the opposite of another.
    """
    height, width = shape
    for dy in range(0 if half else -reach, reach + 1):
        begin, end = max(rows.start, -dy), min(rows.stop, height, height - dy)
        for dx in range(-reach, reach + 1):
            wanted = dy > 0 or dx > 0 if half else dy != 0 or dx != 0
            if wanted and begin < end and abs(dx) < width:
                left, right = max(0, -dx), width - max(0, dx)
                yield (
                    (slice(begin, end), slice(left, right)),
                    (slice(begin + dy, end + dy), slice(left + dx, right + dx)),
                )
