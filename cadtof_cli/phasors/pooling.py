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
    given = np.where(usable, phasors, 0.0)
    weight = np.where(usable, samples, 0.0)
    mean, pooled = given, weight
    for _ in range(2):
        mean, pooled = _means(given, weight, mean, pooled, noise, window // 2)
    return PooledPhasors(np.where(usable, mean, phasors), np.where(usable, pooled, samples))


def pooling_seconds(size: tuple[int, int], noise: NoiseModel, /, *, window: int) -> float:
    """Return about how long the pooling of a frame of (Y, X) pixels takes, by timing a few of its steps."""
    if window == 1 or 0 in size:
        return 0.0
    pixel, weight = np.ones((len(noise.each), *size), np.complex128), np.ones(size)
    began = time.perf_counter()
    _means(pixel, weight, pixel, weight, noise, 1)
    of_one = (time.perf_counter() - began) / 8
    offsets = sum(1 for _ in _neighbours(size, window // 2))
    # of an offset that reaches far, few pixels are left; twice over
    kept = np.mean([max(extent - window / 4, 0.0) / extent for extent in size])
    return float(2 * offsets * of_one * kept)


def _means(
    given: Complex, weight: Float, reference: Complex, reference_weight: Float, noise: NoiseModel, reach: int
) -> tuple[Complex, Float]:
    """Return the weighted means of neighbours that agree with the reference of a pixel, and the sums of their weights."""
    limit = chi_squared_threshold(LOST_NEIGHBOURS, pairs=len(given))
    scales = [1.0 / harmonic.dark_variance for harmonic in noise.each]
    total, weights = given * weight, weight.copy()
    with np.errstate(divide="ignore"):
        spread, reference_spread = 1.0 / weight, 1.0 / reference_weight
    for here, there in _neighbours(weight.shape, reach):
        misfit = np.zeros(weight[here].shape)
        for scale, pixel, neighbour in zip(scales, reference, given, strict=True):
            difference = pixel[here] - neighbour[there]
            misfit += scale * (difference.real * difference.real + difference.imag * difference.imag)
        alike = (misfit <= limit * (reference_spread[here] + spread[there])) & (weight[here] > 0.0)
        counted = alike * weight[there]
        total[:, *here] += counted * given[:, *there]
        weights[here] += counted
    with np.errstate(invalid="ignore"):
        return total / weights, weights


def _neighbours(shape: tuple[int, ...], reach: int) -> Iterator[tuple[Offset, Offset]]:
    """Yield, for every offset but none, the pixels that have such a neighbour, and those neighbours."""
    height, width = shape
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if (dy or dx) and abs(dy) < height and abs(dx) < width:
                yield (
                    (slice(max(0, -dy), height - max(0, dy)), slice(max(0, -dx), width - max(0, dx))),
                    (slice(max(0, dy), height + min(0, dy)), slice(max(0, dx), width + min(0, dx))),
                )
