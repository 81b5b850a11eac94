"""Phasors with less noise: the mean over the neighbours that show the same light, as far as the known noise can tell.

Phasors are linear in the voltages, so a mean of n phasors is what an exposure n times as long would have recorded.
Neighbours count in pairs, one on either side of the pixel. A pair counts if its mean differs from the pixel's phasors,
in confidence and in phase at every harmonic, by no more than noise explains. On a slanted surface both neighbours
differ from the pixel, but their mean does not. Across an edge the mean differs by far more, so edges stay where they
are.
"""

import math
import time

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.records import dataclass

LOST_NEIGHBOURS = 1e-3
"""Share of the pairs with the same light that noise alone keeps out."""

BENT = 0.1
"""By how much pooling may shorten a pixel's phasors, as a share of its noise. On a slope, the phasors of a pair are
turned by +δ and −δ. Their mean has the right phase, but only cos δ of the amplitude, and less at higher harmonics: it
looks like light of more than one path."""

LARGEST = 1e18
"""Longest phasor that is pooled, in units of its noise. No light is that strong, and float32 cannot hold its square."""

BLOCK_PIXELS = 8192
"""Least number of pixels in a block. With a quarter of them, numpy's loops take half as long again per pixel; many more
do not stay in the processor's cache."""


@dataclass(frozen=True)
class PooledPhasors:
    """Pooled phasors, complex128 (H, Y, X), and the number of recorded pixels that each is a mean of, float64 (Y, X)."""

    phasors: Complex
    samples: Float


@dataclass(frozen=True)
class SharedNoise:
    """Noise that pooled pixels share because their windows overlap, for means over squares of such pixels.

    Attributes:
        pixels: the variance of the mean, divided by what it would be if each pixel had noise of its own.
        neighbours: correlation of the noise of two squares side by side.
    """

    pixels: float
    neighbours: float


def pooled_phasors(
    phasors: Complex, /, *, usable: Bool, samples: Float, noise: NoiseModel, window: int
) -> PooledPhasors:
    """Return, for every pixel, the mean of the pixel and its pairs of neighbours with the same light; inputs are not changed.

    Pairs are compared twice: first with the pixel, then with the mean of that first pass, which has little noise. So a
    pixel that noise has moved far away from its neighbours still finds them. If one of a pair is not usable, or outside
    the frame, the pair does not count. If the two are means of different numbers of recorded pixels, both count with
    the smaller number.

    Args:
        phasors: (H, Y, X), each the mean of `samples` recorded pixels.
        usable: (Y, X); unusable pixels keep their phasors, and add nothing to their neighbours. So do pixels beyond `LARGEST`.
        samples: (Y, X), at least 1.
        noise: noise of a recorded pixel.
        window: side of the square of neighbours, an odd number of pixels.
    """
    scales = np.array([1.0 / np.sqrt(harmonic.dark_variance) for harmonic in noise.each])[:, np.newaxis, np.newaxis]
    height, width = usable.shape
    margins = _Margins(height, width, window // 2)
    values, weight = margins.zeros(2 * len(phasors)), margins.zeros(1)
    with np.errstate(over="ignore"):
        for plane, scale in zip(phasors, scales, strict=True):
            usable = usable & (np.abs(plane) < LARGEST / scale)
    for plane, part in zip(margins.inside(values), (*phasors.real, *phasors.imag), strict=True):
        np.copyto(plane, part, where=usable)
    inside = margins.inside(values).reshape(2, *phasors.shape)
    inside *= scales
    np.copyto(margins.inside(weight)[0], samples, where=usable)
    limit = chi_squared_threshold(LOST_NEIGHBOURS, pairs=len(phasors))
    with np.errstate(all="ignore"):
        # comparisons with NaN are false, so unusable pixels agree with no pixel
        planes = _Planes(values, weight[0], np.where(weight[0] > 0.0, limit / weight[0], np.nan))
        first = _sums_of_alike(planes, values, planes.limit, margins)
        sums = _sums_of_alike(planes, first[:-1] / first[-1], limit / first[-1], margins, bent=BENT)
        mean = margins.inside(sums[:-1] / sums[-1]).reshape(2, *phasors.shape) / scales
    pooled = np.empty_like(phasors)
    pooled.real, pooled.imag = mean
    np.copyto(pooled, phasors, where=~usable)
    return PooledPhasors(pooled, np.where(usable, margins.inside(sums)[-1], samples))


def shared_noise(window: int, /, *, samples: float, stride: int, count: int) -> SharedNoise:
    """Return the noise that pooled pixels share in the mean over a square of count × count pixels, and between two such
    squares.

    Along a row, the windows of two pixels that are k steps apart have `window` − k·stride recorded pixels in common.

    Args:
        window: side of the square of neighbours that pixels are pooled over.
        samples: number of recorded pixels that a pooled pixel is a mean of; `pixels` of the answer is at most this.
        stride: step, in pixels of the frame, between the pixels that the square is a mean of.
        count: number of such pixels along each side of a square.
    """
    apart = np.arange(1, 2 * count)
    common = np.maximum(window - stride * apart, 0)
    along = count * window + 2 * int(np.maximum(count - apart, 0) @ common)
    pixels = (along / (count * window)) ** 2
    return SharedNoise(min(pixels, samples), int(np.minimum(apart, 2 * count - apart) @ common) / along)


def pooling_seconds(size: tuple[int, int], noise: NoiseModel, /, *, window: int) -> float:
    """Return about how many seconds the pooling of a frame of (Y, X) pixels takes, by timing a window of 3."""
    if window == 1 or 0 in size:
        return 0.0
    phasors, samples = np.ones((len(noise.each), *size), np.complex128), np.ones(size)
    began = time.perf_counter()
    pooled_phasors(phasors, usable=np.ones(size, np.bool_), samples=samples, noise=noise, window=3)
    of_one = (time.perf_counter() - began) / 8
    # a far offset leaves fewer pixels that have both neighbours
    kept = np.mean([max(extent - window / 4, 0.0) / extent for extent in size])
    return float((window**2 - 1) * of_one * kept)


@dataclass(frozen=True)
class _Margins:
    """Frames of (height, width) pixels with margins of 0, as wide as neighbours reach, laid out flat.

    A neighbour is then the same number of places away for every pixel, and a block of rows is a slice of contiguous
    memory, as are its neighbours. The margin on the right of a row is also the margin on the left of the next row.
    """

    height: int
    width: int
    reach: int

    @property
    def row(self) -> int:
        """Number of places from a pixel to the pixel below."""
        return self.width + self.reach

    @property
    def first(self) -> int:
        """Place of the first pixel."""
        return self.reach * self.row + self.reach

    def zeros(self, planes: int) -> Float32:
        """Return new planes of zeros with margins, (planes, places)."""
        return np.zeros((planes, self.height * self.row + 2 * self.first), np.float32)

    def inside(self, flat: Float32) -> Float32:
        """Return a view of the frames inside flat planes, (planes, Y, X)."""
        frames = flat[:, self.first : self.first + self.height * self.row]
        return frames.reshape(len(flat), self.height, self.row)[:, :, : self.width]

    def blocks(self) -> list[slice]:
        """Return the places of each block of rows, with the margins on their right."""
        rows = -(-BLOCK_PIXELS // self.row)
        begins = range(0, self.height, rows)
        return [
            slice(self.first + begin * self.row, self.first + min(begin + rows, self.height) * self.row)
            for begin in begins
        ]

    def offsets(self) -> list[int]:
        """Return, for every pair of neighbours, the number of places from the pixel to the later of the pair."""
        reach = range(-self.reach, self.reach + 1)
        away = [dy * self.row + dx for dy in reach for dx in reach]
        return [places for places in away if places > 0]


@dataclass(frozen=True)
class _Planes:
    """The pixels of a frame as flat planes with margins.

    `values`, (2·H, places), holds real and imaginary parts in units of the noise of one recorded pixel; `weight`,
    (places,), is the number of recorded pixels. `limit` is the largest χ² that each pixel's noise explains. All are
    float32, which rounds phasors by 6e-8 of their length, far less than noise, and takes half the time of float64.
    """

    values: Float32
    weight: Float32
    limit: Float32


def _sums_of_alike(
    planes: _Planes, reference: Float32, reference_limit: Float32, margins: _Margins, *, bent: float = math.inf
) -> Float32:
    """Return the weighted sums over each pixel and all pairs that agree with it, and the sums of the weights, (2·H + 1,
    places).

    A pair agrees if its mean differs from the pixel's `reference` by no more than noise explains, and if its two pixels
    differ from each other by no more than noise explains plus the difference that shortens their mean by the share
    `bent` of a pixel's noise. One block of rows is compared with all its neighbours before the next block, because it
    then stays in the processor's cache.
    """
    sums = np.concatenate((planes.values * planes.weight, planes.weight[np.newaxis]))
    half = 0.5 * planes.values
    for here in margins.blocks():
        # views, so that += changes `sums`
        values, weights, of_reference = sums[:-1, here], sums[-1, here], reference[:, here]
        mean, squares = np.empty((2, *of_reference.shape), np.float32)
        # phasors of amplitude a, turned by +δ and −δ: half their difference is a·δ, and their mean is shorter by a·δ²/2
        turned = 2.0 * bent * np.sqrt((of_reference * of_reference).sum(axis=0) / (len(of_reference) // 2))
        for offset in margins.offsets():
            after, before = (slice(here.start + to, here.stop + to) for to in (offset, -offset))
            limit = 0.25 * (planes.limit[after] + planes.limit[before])
            np.add(half[:, after], half[:, before], out=mean)
            np.subtract(mean, of_reference, out=squares)
            np.multiply(squares, squares, out=squares)
            alike = squares.sum(axis=0) <= reference_limit[here] + limit
            if bent < math.inf:
                np.subtract(half[:, after], half[:, before], out=squares)
                np.multiply(squares, squares, out=squares)
                alike &= squares.sum(axis=0) <= limit + turned
            weight = 2.0 * np.minimum(planes.weight[after], planes.weight[before]) * alike
            values += np.multiply(mean, weight, out=mean)
            weights += weight
    return sums
