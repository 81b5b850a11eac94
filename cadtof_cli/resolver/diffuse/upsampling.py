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
    """Planes over the patches, float32 (plane, rows + 2, columns + 2): repeated once beyond every edge, as `range_m` is."""

    grid: PatchGrid
    planes: Float32
    range_m: Float32

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
        weights, corners = self._weights(band), self._corners(self.planes[plane : plane + 1], band)
        total: Float32 = sum((w * corner[0] for w, corner in zip(weights, corners, strict=True)), np.float32(0.0))
        return total / sum(weights)

    def joint(self, band: Band, range_m: Float32, /) -> Float32:
        """Return all planes at the pixels of a band, (plane, rows, columns), by distance and by agreement with their ranges."""
        scale = 1.0 / (np.float32(SAME_SURFACE) * range_m)
        total = np.zeros((len(self.planes), *band.shape), np.float32)
        weight = np.zeros(band.shape, np.float32)
        term = np.empty_like(total)
        for near, planes, there in zip(
            self._weights(band), self._corners(self.planes, band), self._corners(self.range_m, band), strict=True
        ):
            apart = (there - range_m) * scale
            share = 1.0 + apart * apart
            share = near / (share * share)
            np.multiply(planes, share, out=term)
            total += term
            weight += share
        total /= weight
        return total

    def _patch_row(self, row: int) -> int:
        """Return which patch's middle lies above (or at) the middle of a row of pixels, −1 for none."""
        return (2 * row + 1 - self.grid.side) // (2 * self.grid.side)

    def _band_end(self, row: int) -> int:
        """Return the first row of pixels below this one that lies between two other rows of patches."""
        side = self.grid.side
        return -(-((2 * self._patch_row(row) + 3) * side - 1) // 2)

    def _weights(self, band: Band) -> list[Float32]:
        """Return the bilinear weights of the upper left, upper right, lower left and lower right patch, (rows, columns)."""
        down = self._share(np.arange(band.top, band.bottom))[:, None]
        right = self._share(np.arange(band.left, band.right))
        even = np.float32(EVEN_WEIGHT)
        return [v * u + even for v in (1.0 - down, down) for u in (1.0 - right, right)]

    def _share(self, pixel: Float) -> Float32:
        place = (pixel + 0.5) / self.grid.side - 0.5
        return np.asarray(place - np.floor(place), np.float32)

    def _corners(self, planes: Float32, band: Band) -> list[Float32]:
        """Return the planes of the four patches around every pixel, (…, 1, columns) each."""
        side = self.grid.side
        column = (2 * np.arange(band.left, band.right) + 1 - side) // (2 * side) + 1
        upper = band.patch_row + 1
        return [planes[..., upper + i, :].take(column + j, axis=-1)[..., None, :] for i in (0, 1) for j in (0, 1)]


def upsampler(planes: Float32, range_m: Float, valid: Bool, grid: PatchGrid, /) -> Upsampler:
    """Make planes (plane, rows, columns) ready for pixels; ranges, (rows, columns), count where valid."""
    edge = ((1, 1), (1, 1))
    there = np.where(valid, range_m, NOWHERE_M).astype(np.float32)
    return Upsampler(grid, np.pad(planes, ((0, 0), *edge), mode="edge"), np.pad(there, edge, mode="edge"))
