"""From patches to pixels: a joint bilateral filter of the four nearest patches, by distance in the image and in depth."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.planes import SAME_SURFACE

EVEN_WEIGHT = 1e-3
"""Weight that each of the four patches has at least, before depth counts: a pixel may agree with the farthest alone."""

NOWHERE_M = 1e3
"""Range given to patches without a surface: no pixel agrees with it."""


@dataclass(frozen=True)
class Band:
    """A rectangle of pixels, rows `top` … `bottom` and columns `left` … `right` (exclusive), between two rows of patches."""

    top: int
    bottom: int
    left: int
    right: int
    patch_row: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        return self.bottom - self.top, self.right - self.left


@dataclass(frozen=True, eq=False)
class Upsampler:
    """Planes over the patches and their ranges, brought to every column of pixels, float32.

    `planes` are those of the patches to the left and to the right of a column, (plane, rows + 2, width) each, and `range_m`,
    (rows + 2, width) each, the ranges; the first and last row and column of patches count once more beyond the edge.
    """

    grid: PatchGrid
    planes: tuple[Float32, Float32]
    range_m: tuple[Float32, Float32]

    def bands(self, pixels: slice, /) -> Iterator[Band]:
        """Cut a stretch of pixels, flat indices row by row, into bands, in order."""
        width, start, stop = self.grid.width, pixels.start, pixels.stop
        while start < stop:
            top, left = divmod(start, width)
            if left or stop - start < width:
                bottom, right = top + 1, min(width, left + stop - start)
            else:
                bottom, right = min(stop // width, self._band_end(top)), width
            yield Band(top, bottom, left, right, self._patch_row(top))
            start = (bottom - 1) * width + right

    def linear(self, plane: int, band: Band, /) -> Float32:
        """Return a plane at the pixels of a band, by distance in the image alone."""
        down, right = self._shares(band)
        upper_left, upper_right, lower_left, lower_right = (corner[plane] for corner in _corners(self.planes, band))
        upper = upper_left + right * (upper_right - upper_left)
        between: Float32 = upper + down * (lower_left + right * (lower_right - lower_left) - upper)
        return between

    def joint(self, band: Band, range_m: Float32, /) -> Float32:
        """Return all planes at the pixels of a band, (plane, rows, columns), by distance and by agreement with their ranges."""
        scale = 1.0 / (np.float32(SAME_SURFACE) * range_m)
        weights = self._weights(band)
        for weight, there in zip(weights, _corners(self.range_m, band), strict=True):
            apart = (there - range_m) * scale
            apart *= apart
            apart += 1.0
            apart *= apart
            weight /= apart
        share = 1.0 / (weights[0] + weights[1] + weights[2] + weights[3])
        *others, last = _corners(self.planes, band)
        # the last patch's planes and what the others differ by: fewer passes over many planes than four products and a quotient
        total: Float32 = np.repeat(last, band.shape[0], axis=1)
        term = np.empty_like(total)
        for weight, values in zip(weights, others, strict=False):
            weight *= share
            total += np.multiply(values - last, weight, out=term)
        return total

    def _patch_row(self, row: int) -> int:
        """Return which patch's middle lies above (or at) the middle of a row of pixels, −1 for none."""
        return _patch_before(row, self.grid.side)

    def _band_end(self, row: int) -> int:
        """Return the first row of pixels below this one that lies between two other rows of patches."""
        side = self.grid.side
        return -(-((2 * self._patch_row(row) + 3) * side - 1) // 2)

    def _weights(self, band: Band) -> list[Float32]:
        """Return the bilinear weights of the upper left, upper right, lower left and lower right patch, (rows, columns)."""
        down, right = self._shares(band)
        even = np.float32(EVEN_WEIGHT)
        return [v * u + even for v in (1.0 - down, down) for u in (1.0 - right, right)]

    def _shares(self, band: Band) -> tuple[Float32, Float32]:
        """Return how far the pixels lie on the way from the upper to the lower patch, (rows, 1), and to the right one."""
        down, right = (self._share(*edges) for edges in ((band.top, band.bottom), (band.left, band.right)))
        return down[:, None], right

    def _share(self, first: int, last: int) -> Float32:
        place = (np.arange(first, last) + 0.5) / self.grid.side - 0.5
        return np.asarray(place - np.floor(place), np.float32)


def upsampler(planes: Float32, range_m: Float, valid: Bool, grid: PatchGrid, /) -> Upsampler:
    """Make planes (plane, rows, columns) ready for pixels; ranges, (rows, columns), count where valid."""
    there = np.where(valid, range_m, NOWHERE_M).astype(np.float32)
    return Upsampler(grid, _beside_columns(planes, grid), _beside_columns(there, grid))


def _beside_columns(planes: Float32, grid: PatchGrid) -> tuple[Float32, Float32]:
    """Return planes (…, rows, columns) of the patches left and right of every column of pixels, (…, rows + 2, width) each."""
    padded = np.pad(planes, ((0, 0),) * (planes.ndim - 2) + ((1, 1),) * 2, mode="edge")
    left = np.array([_patch_before(column, grid.side) for column in range(grid.width)]) + 1
    return padded[..., left], padded[..., left + 1]


def _patch_before(pixel: int, side: int) -> int:
    """Return which patch's middle lies before (or at) the middle of a pixel, −1 for none."""
    return (2 * pixel + 1 - side) // (2 * side)


def _corners(planes: tuple[Float32, Float32], band: Band) -> list[Float32]:
    """Return the planes of the four patches around every pixel, (…, 1, columns) each."""
    columns = slice(band.left, band.right)
    return [beside[..., band.patch_row + 1 + i, None, columns] for i in (0, 1) for beside in planes]
