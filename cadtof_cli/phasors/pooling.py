"""Phasors with less noise: the mean over those neighbours that show the same light, as far as the known noise can tell.

Phasors are linear in the voltages, so a mean of phasors is what an exposure as many times as long would have recorded. Neighbours
count in pairs, one on either side of the pixel, where the mean of both differs from the pixel's phasors, in confidence and in
phase at every harmonic, by no more than noise does. On a surface that slants, both differ from the pixel, but not their mean.
Across an edge it differs by far more, so edges stay where they are.
"""

import math
import time

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.records import dataclass

LOST_NEIGHBOURS = 1e-3
"""Share of neighbours with the same light that noise alone keeps out."""

BENT = 0.1
"""By what share of its noise a pixel's phasors may come out too small. The mean of two phasors that a slope turns by δ to either
side has the right phase, but cos δ of the amplitude, less at higher harmonics: as light that comes by more than one way."""

BLOCK_PIXELS = 8192
"""Least number of pixels that are dealt with at a time: numpy's loops over a quarter of them take half as long again per pixel,
and many more do not stay in the processor's cache."""


@dataclass(frozen=True)
class PooledPhasors:
    """Pooled phasors, complex128 (H, Y, X), and over how many recorded pixels each is a mean, float64 (Y, X)."""

    phasors: Complex
    samples: Float


@dataclass(frozen=True)
class SharedNoise:
    """What pooling does to the noise of means over squares of pixels, whose windows overlap.

    Attributes:
        pixels: how many pixels share their noise: the variance of the mean, over what it is if each has noise of its own.
        neighbours: correlation of the noise of two squares side by side.
    """

    pixels: float
    neighbours: float


def pooled_phasors(
    phasors: Complex, /, *, usable: Bool, samples: Float, noise: NoiseModel, window: int
) -> PooledPhasors:
    """Return the means of every pixel and its pairs of neighbours with the same light; inputs are not changed.

    Pairs are compared twice: with the pixel, and then with the mean that came of it, whose noise is small. So a pixel that noise
    has thrown far from the others still finds them. Where one of a pair is not usable, or beyond the frame, the other gives
    nothing; where they stand for different numbers of recorded pixels, both count as the one that stands for fewer.

    Args:
        phasors: (H, Y, X), each the mean of `samples` recorded pixels.
        usable: (Y, X); pixels that are not keep their phasors, and give nothing to their neighbours.
        samples: (Y, X), at least 1.
        noise: noise of a recorded pixel.
        window: side of the square of neighbours, an odd number of pixels.
    """
    scales = np.array([1.0 / np.sqrt(harmonic.dark_variance) for harmonic in noise.each])[:, np.newaxis, np.newaxis]
    height, width = usable.shape
    margins = _Margins(height, width, window // 2)
    given, weight = margins.around(2 * len(phasors)), margins.around(1)
    for plane, part in zip(margins.inside(given), (*phasors.real, *phasors.imag), strict=True):
        np.copyto(plane, part, where=usable)
    inside = margins.inside(given).reshape(2, *phasors.shape)
    inside *= scales
    np.copyto(margins.inside(weight)[0], samples, where=usable)
    limit = chi_squared_threshold(LOST_NEIGHBOURS, pairs=len(phasors))
    with np.errstate(all="ignore"):
        # what is not usable agrees with nothing
        light = _Light(given, weight[0], np.where(weight[0] > 0.0, limit / weight[0], np.nan))
        first = _sums_of_alike(light, given, light.most, margins)
        sums = _sums_of_alike(light, first[:-1] / first[-1], limit / first[-1], margins, bent=BENT)
        mean = margins.inside(sums[:-1] / sums[-1]).reshape(2, *phasors.shape) / scales
    pooled = np.empty_like(phasors)
    pooled.real, pooled.imag = mean
    np.copyto(pooled, phasors, where=~usable)
    return PooledPhasors(pooled, np.where(usable, margins.inside(sums)[-1], samples))


def shared_noise(window: int, /, *, samples: float, stride: int, count: int) -> SharedNoise:
    """Return what noise the means over squares of count × count pooled pixels share, `stride` apart, and those squares.

    Along a row, the windows of two pixels that are k steps apart have `window` − k·stride recorded pixels in common.

    Args:
        window: side of the square of neighbours that pixels are pooled over.
        samples: over how many recorded pixels a pooled one is a mean: no more of them can share their noise.
        stride: step from pixel to pixel of those looked at.
        count: how many are looked at along each side of a square.
    """
    apart = np.arange(1, 2 * count)
    common = np.maximum(window - stride * apart, 0)
    along = count * window + 2 * int(np.maximum(count - apart, 0) @ common)
    pixels = (along / (count * window)) ** 2
    return SharedNoise(min(pixels, samples), int(np.minimum(apart, 2 * count - apart) @ common) / along)


def pooling_seconds(size: tuple[int, int], noise: NoiseModel, /, *, window: int) -> float:
    """Return about how long the pooling of a frame of (Y, X) pixels takes, by timing a few of its steps."""
    if window == 1 or 0 in size:
        return 0.0
    phasors, samples = np.ones((len(noise.each), *size), np.complex128), np.ones(size)
    began = time.perf_counter()
    pooled_phasors(phasors, usable=np.ones(size, np.bool_), samples=samples, noise=noise, window=3)
    of_one = (time.perf_counter() - began) / 8
    # of an offset that reaches far, few pixels are left
    kept = np.mean([max(extent - window / 4, 0.0) / extent for extent in size])
    return float((window**2 - 1) * of_one * kept)


@dataclass(frozen=True)
class _Margins:
    """Frames of (height, width) pixels with margins of 0, as wide as neighbours reach, laid out flat.

    A neighbour is then as many places away for every pixel, and a block of rows with its neighbours is a slice: all of it one
    stretch of memory. The margin right of a row is also that left of the next.
    """

    height: int
    width: int
    reach: int

    @property
    def row(self) -> int:
        """Places from a pixel to the one below."""
        return self.width + self.reach

    @property
    def first(self) -> int:
        """Place of the first pixel."""
        return self.reach * self.row + self.reach

    def around(self, planes: int) -> Float32:
        """Return planes of 0, (planes, places)."""
        return np.zeros((planes, self.height * self.row + 2 * self.first), np.float32)

    def inside(self, flat: Float32) -> Float32:
        """Return the frames, (planes, Y, X), that flat planes hold, as a view."""
        frames = flat[:, self.first : self.first + self.height * self.row]
        return frames.reshape(len(flat), self.height, self.row)[:, :, : self.width]

    def blocks(self) -> list[slice]:
        """Return the places of some rows at a time, with the margins right of them."""
        rows = -(-BLOCK_PIXELS // self.row)
        begins = range(0, self.height, rows)
        return [
            slice(self.first + begin * self.row, self.first + min(begin + rows, self.height) * self.row)
            for begin in begins
        ]

    def offsets(self) -> list[int]:
        """Return how many places after the pixel the later of each pair of neighbours is."""
        reach = range(-self.reach, self.reach + 1)
        away = [dy * self.row + dx for dy in reach for dx in reach]
        return [places for places in away if places > 0]


@dataclass(frozen=True)
class _Light:
    """What neighbours give, flat: planes whose noise is 1 for a pixel of weight 1, (2·H, places), and the `weight`, (places,).

    `most` is the misfit that each pixel's noise explains. All are float32, which rounds phasors by 6e-8 of their length, far less
    than noise, and takes half the time of float64.
    """

    given: Float32
    weight: Float32
    most: Float32


def _sums_of_alike(
    light: _Light, reference: Float32, reference_most: Float32, margins: _Margins, *, bent: float = math.inf
) -> Float32:
    """Return the sums of what is given times its weight, and of the weights, of a pixel and of all pairs that agree with it.

    They agree where the mean of both differs from the pixel's reference by no more than noise explains, and each of them from the
    other by no more than that or what makes their mean smaller by the share `bent` of a pixel's noise. A few rows are dealt with
    at a time, for all offsets, as they stay in the processor's cache then.
    """
    sums = np.concatenate((light.given * light.weight, light.weight[np.newaxis]))
    half = 0.5 * light.given
    for here in margins.blocks():
        total, of_reference = sums[:, here], reference[:, here]
        mean, squares = np.empty((2, *of_reference.shape), np.float32)
        # half of what two differ by is a·δ, and δ²/2 of the amplitude a is missing
        turned = 2.0 * bent * np.sqrt((of_reference * of_reference).sum(axis=0) / (len(of_reference) // 2))
        for offset in margins.offsets():
            after, before = (slice(here.start + to, here.stop + to) for to in (offset, -offset))
            most = 0.25 * (light.most[after] + light.most[before])
            np.add(half[:, after], half[:, before], out=mean)
            np.subtract(mean, of_reference, out=squares)
            np.multiply(squares, squares, out=squares)
            alike = squares.sum(axis=0) <= reference_most[here] + most
            if bent < math.inf:
                np.subtract(half[:, after], half[:, before], out=squares)
                np.multiply(squares, squares, out=squares)
                alike &= squares.sum(axis=0) <= most + turned
            weight = 2.0 * np.minimum(light.weight[after], light.weight[before]) * alike
            # added to in place: an index on the left of += would be written back once more
            values, weights = total[:-1], total[-1]
            values += np.multiply(mean, weight, out=mean)
            weights += weight
    return sums
