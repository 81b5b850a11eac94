"""Rays of pixels, and the patches that a frame is cut into."""

import math
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32, Index, sealed
from cadtof_cli.records import dataclass

PATCHES = 300
"""Number of patches per frame; in QVGA, a patch has 16 × 16 pixels. Radiosity costs the square of this number. More
patches changed no error by a tenth."""

LEAST_PATCH = 4
"""Smallest side of a patch in pixels: the fit of a plane needs points."""

SAMPLES = 8
"""Number of pixels that are sampled along each side of a patch. Their mean has little noise, and a large frame costs no
more than a small one."""

SHIFTS = ((0, 0), (1, 1), (1, 0))
"""By how many rows and columns the sampled pixels are moved, one after the other, until some have light. Pixels without light
may lie in a pattern: every second row, every second column, or a chequerboard."""

UNKNOWN_WIDTH_RAD = math.radians(60.0)
"""Horizontal field of view that is assumed if the optics are unknown. Common time-of-flight modules have 55° to 70°."""


@dataclass(frozen=True)
class View:
    """The pinhole camera of a frame, in pixels; `known` is false if it had to be assumed."""

    focal_length_px: float
    principal_point_px: tuple[float, float]
    known: bool = True


def assumed_view(height: int, width: int, /) -> View:
    """Return the view that is assumed if the optics are unknown: `UNKNOWN_WIDTH_RAD` across, centred."""
    focal = 0.5 * width / math.tan(0.5 * UNKNOWN_WIDTH_RAD)
    return View(focal, (0.5 * (width - 1), 0.5 * (height - 1)), known=False)


@dataclass(frozen=True, eq=False)
class PatchGrid:
    """A frame of `height` × `width` pixels, cut into `rows` × `columns` square patches of `side` pixels.

    The last row and the last column of patches may extend beyond the frame. Of every patch, n pixels are sampled,
    `stride` apart. `shift` says how many rows and columns they lie before those that are usually sampled. X = (x − cx)/f
    and Y = (y − cy)/f are the slopes of a pixel's ray.

    Attributes:
        cosine: 1/√(1 + X² + Y²) of the sampled pixels, float32 (n, rows, columns).
        slope: X and Y of the middle of each patch, (2, rows, columns).
        place: positions of the samples about the middle of their patch, x right and y down, in strides, (2, n).
        ray: unit vector through the middle of each patch, (3, rows, columns).
    """

    view: View
    height: int
    width: int
    side: int
    stride: int
    shift: tuple[int, int]
    rows: int
    columns: int
    cosine: Float32
    slope: Float
    place: Float
    ray: Float

    @cached_property
    def even(self) -> Float:
        """The functions that count as even over the view: 1, X, Y and 1/cos of the patches' middles, (rows, columns, 4)."""
        one = np.ones_like(self.slope[0])
        return sealed(np.stack([one, *self.slope, 1.0 / self.ray[2]], axis=-1))

    @cached_property
    def powers(self) -> Float:
        """1, x, y, x², y² and xy of the positions of the samples about the middle of their patch, (6, n)."""
        x, y = self.place
        return sealed(np.stack([np.ones_like(x), x, y, x * x, y * y, x * y]))

    def patch_of(self, pixels: Index, /) -> tuple[Index, Index]:
        """Return the row and the column of the patch of each pixel; pixels are flat indices."""
        row, column = np.divmod(pixels, self.width)
        return row // self.side, column // self.side

    def samples(self, image: NDArray[Any], /) -> NDArray[Any]:
        """Return the sampled pixels of images (…, Y, X) by patch, (…, n, rows, columns); 0 or False outside the frame."""
        rows, columns = sampled_pixels(self.height, self.width, self.shift)
        return self.by_patch(image[..., rows, columns])

    def by_patch(self, sampled: NDArray[Any], /) -> NDArray[Any]:
        """Return images of the sampled pixels alone, (…, rows, columns), sorted by patch, (…, n, rows, columns)."""
        per_side = self.side // self.stride
        height, width = sampled.shape[-2:]
        shape = (*sampled.shape[:-2], self.rows * per_side, self.columns * per_side)
        padded = sampled
        if sampled.shape != shape:
            padded = np.zeros(shape, sampled.dtype)
            padded[..., :height, :width] = sampled
        cut = padded.reshape(*shape[:-2], self.rows, per_side, self.columns, per_side)
        return np.moveaxis(cut, (-3, -1), (-4, -3)).reshape(*shape[:-2], per_side**2, self.rows, self.columns)


@lru_cache(maxsize=4)
def patch_grid(height: int, width: int, view: View, shift: tuple[int, int] = (0, 0), /) -> PatchGrid:
    """Cut a frame into about `PATCHES` patches."""
    side, stride = _side_and_stride(height, width)
    rows, columns = -(-height // side), -(-width // side)
    none = np.empty(0)
    bare = PatchGrid(view, height, width, side, stride, shift, rows, columns, none.astype(np.float32), none, none, none)
    cx, cy = view.principal_point_px
    across = (np.arange(columns * side, dtype=np.float64) - cx) / view.focal_length_px
    down = (np.arange(rows * side, dtype=np.float64) - cy) / view.focal_length_px
    # broadcast views: full images of slopes would take more memory than a large frame itself
    slope_x, slope_y = (
        bare.samples(np.broadcast_to(slope, (len(down), len(across)))) for slope in (across, down[:, np.newaxis])
    )
    cosine = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    ray = np.stack([(slope_x * cosine).mean(0), (slope_y * cosine).mean(0), cosine.mean(0)])
    ray /= np.linalg.norm(ray, axis=0)
    slope = np.stack([slope_x.mean(0), slope_y.mean(0)])
    steps = np.arange(side // stride) - 0.5 * (side // stride - 1)
    place = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)
    return sealed(replace(bare, cosine=cosine.astype(np.float32), slope=slope, place=place, ray=ray))


def sampled_pixels(height: int, width: int, shift: tuple[int, int] = (0, 0), /) -> tuple[slice, slice]:
    """Return which rows and columns of a frame are sampled, so many rows and columns (`shift`) before the usual ones."""
    _, stride = _side_and_stride(height, width)
    up, left = shift
    return slice(stride // 2 - up, None, stride), slice(stride // 2 - left, None, stride)


def _side_and_stride(height: int, width: int) -> tuple[int, int]:
    side = math.sqrt(height * width / PATCHES)
    if side < 1.5 * SAMPLES:
        return max(LEAST_PATCH, round(side)), 1
    stride = round(side / SAMPLES)
    return SAMPLES * stride, stride
