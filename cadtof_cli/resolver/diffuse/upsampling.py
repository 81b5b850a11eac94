"""From patches to pixels: a joint bilateral filter of the four nearest patches, by distance in the image and in depth."""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32, Index, sealed
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.planes import SAME_SURFACE

EVEN_WEIGHT = 1e-3
"""Least weight of each of the four patches, before depth counts: a pixel may agree with the farthest patch alone."""

NOWHERE_M = 1e3
"""Range of patches without a surface: no pixel agrees with it."""


@dataclass(frozen=True)
class Band:
    """A rectangle of pixels between two rows of patches: rows `top` … `bottom`, columns `left` … `right` (both exclusive).

    `pixels` are their positions among the pixels that were cut. `patch_row` is the upper row of patches, as a row of
    `Upsampler.planes`.
    """

    top: int
    bottom: int
    left: int
    right: int
    pixels: slice
    patch_row: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        return self.bottom - self.top, self.right - self.left


@dataclass(frozen=True, eq=False)
class Upsampler:
    """Planes over the patches and their ranges, repeated for every column of pixels, float32.

    The patch to the left of pixel x stands at `first` + x. The patch to its right stands a patch's side further on.

    Attributes:
        grid: the patches of the frame.
        planes: (plane, rows + 2, columns). Every patch stands as often as it has columns of pixels. The first and last
            row and column of patches stand once more beyond the edge.
        range_m: ranges of the patches in the same way, (rows + 2, columns).
        down: how far rows of pixels lie on the way from one row of patches to the next, 0 to 1, (Y,).
        right: the same for columns, (X,).
    """

    grid: PatchGrid
    planes: Float32
    range_m: Float32
    down: Float32
    right: Float32

    @property
    def first(self) -> int:
        """Where the patch to the left of the pixels of column 0 stands."""
        return (self.grid.side + 1) // 2

    def linear(self, plane: int, pixels: slice, /) -> Float32:
        """Return a plane at consecutive pixels, flat indices row by row, by distance in the image alone, (n,)."""
        found = np.empty(pixels.stop - pixels.start, np.float32)
        for band in bands_of(self.grid, pixels.start, pixels.stop):
            down, right = self._shares(band)
            upper_left, upper_right, lower_left, lower_right = self._corners(self.planes[plane], band)
            upper = upper_left + right * (upper_right - upper_left)
            between = upper + down * (lower_left + right * (lower_right - lower_left) - upper)
            found[band.pixels] = between.ravel()
        return found

    def joint(self, pixels: slice, range_m: Float32, /) -> Float32:
        """Return all planes at consecutive pixels, (plane, n), by distance and by agreement of the patches with their
        ranges, (n,).
        """
        found = np.empty((len(self.planes), range_m.size), np.float32)
        for band in bands_of(self.grid, pixels.start, pixels.stop):
            weights = self._weights(band, range_m[band.pixels].reshape(band.shape))
            *others, last = self._corners(self.planes, band)
            # the last patch's planes plus weighted differences from them: fewer passes over many planes than four products
            total = np.multiply(others[0] - last, weights[0], out=found[:, band.pixels].reshape(-1, *band.shape))
            term = np.empty_like(total)
            for weight, values in zip(weights[1:], others[1:], strict=True):
                total += np.multiply(values - last, weight, out=term)
            total += last
        return found

    def _weights(self, band: Band, range_m: Float32) -> Float32:
        """Return the weights of the upper left, upper right and lower left patch, (3, rows, columns); they and the last
        sum to 1.
        """
        down, right = self._shares(band)
        near = np.array([1.0 - down, down])[:, None] * np.array([1.0 - right, right])[:, None]
        near += np.float32(EVEN_WEIGHT)
        weights: Float32 = near.reshape(4, *band.shape)
        apart = np.array(self._corners(self.range_m, band)) - range_m
        apart *= 1.0 / (np.float32(SAME_SURFACE) * range_m)
        apart *= apart
        apart += 1.0
        apart *= apart
        weights /= apart
        weights[:3] *= 1.0 / (weights[0] + weights[1] + weights[2] + weights[3])
        return weights[:3]

    def _shares(self, band: Band) -> tuple[Float32, Float32]:
        """Return how far the pixels lie on the way from the upper to the lower patch, (rows, 1), and to the right one."""
        return self.down[band.top : band.bottom, None], self.right[band.left : band.right]

    def _corners(self, planes: Float32, band: Band) -> list[Float32]:
        """Return the planes of the four patches around every pixel, (…, 1, columns) each."""
        starts = (self.first + band.left, self.first + band.left + self.grid.side)
        count = band.right - band.left
        return [planes[..., band.patch_row + i, None, start : start + count] for i in (0, 1) for start in starts]


@lru_cache(maxsize=64)
def bands_of(grid: PatchGrid, start: int, stop: int, /) -> tuple[Band, ...]:
    """Cut consecutive pixels, with flat indices from `start` to `stop` − 1 row by row, into bands, in order."""
    first, width, bands = start, grid.width, []
    while start < stop:
        top, left = divmod(start, width)
        if left or stop - start < width:
            bottom, right = top + 1, min(width, left + stop - start)
        else:
            bottom, right = min(stop // width, _band_end(top, grid.side)), width
        end = (bottom - 1) * width + right
        bands.append(Band(top, bottom, left, right, slice(start - first, end - first), int(row_above(top, grid.side))))
        start = end
    return tuple(bands)


def row_above(row: int | Index, side: int, /) -> int | Index:
    """Return which row of `Upsampler.planes` lies above (or at) the middle of a row of pixels."""
    return (2 * row + 1 + side) // (2 * side)


def _band_end(row: int, side: int) -> int:
    """Return the first row of pixels below this one that lies between two other rows of patches."""
    return -(-((2 * int(row_above(row, side)) + 1) * side - 1) // 2)


def upsampler(planes: Float32, range_m: Float, valid: Bool, grid: PatchGrid, /) -> Upsampler:
    """Make planes (plane, rows, columns) ready for pixels; ranges, (rows, columns), count if they are valid."""
    there = np.where(valid, range_m, NOWHERE_M).astype(np.float32)
    rows, columns, down, right = _stretches(grid)
    stretched, ranges = (
        np.repeat(held[..., rows, :].take(columns, axis=-1), grid.side, axis=-1) for held in (planes, there)
    )
    return Upsampler(grid, stretched, ranges, down, right)


@lru_cache(maxsize=4)
def _stretches(grid: PatchGrid) -> tuple[Index, Index, Float32, Float32]:
    """Return the rows and columns of patches with which an `Upsampler` begins, and how far pixels lie between them."""
    rows, columns = (np.r_[0, 0:count, count - 1] for count in (grid.rows, grid.columns))
    down, right = (_shares(extent, grid.side) for extent in (grid.height, grid.width))
    return sealed((rows, columns, down, right))


def _shares(extent: int, side: int) -> Float32:
    """Return how far so many rows or columns of pixels lie on the way from one patch to the next."""
    place = (np.arange(extent) + 0.5) / side - 0.5
    return np.asarray(place - np.floor(place), np.float32)
