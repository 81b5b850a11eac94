"""The surface of every patch: a plane through its points.

1/z of a plane is linear in the slopes X and Y of the rays.
"""

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.grid import PatchGrid

SAME_SURFACE = 0.1
"""Largest relative difference of depth between points, or between a pixel and a patch, of one surface."""

LEAST_COSINE = 0.08
"""Smallest cosine of incidence that is used: at a grazing angle, areas and albedos would grow without limit."""

LEAST_SHARE = 0.3
"""Share of a patch's sampled pixels of which more must lie on its plane."""

STEP_SIGMAS = 4.0
"""A patch has a step if the slope of its plane differs by more than this many standard deviations from the median slope
between neighbouring samples. A flat patch has one in 16,000."""

LEAST_PAIRS = 12
"""Smallest number of pairs of neighbouring samples, across and down, that tell a step."""

SIGMA_OF_MEDIAN = 1.2533 / 1.349
"""Standard deviation of the median of n normal values, times √n, over the distance between their quartiles."""

TINY = 1e-12
"""Keeps patches without points, or with all points on one line, from dividing by zero."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Flat pieces of surface, (…) each.

    Attributes:
        range_m: range of the middle.
        normal: unit normal, (3, …).
        ray: unit vector from the camera, (3, …).
        cosine: cosine of incidence.
        area_m2: area.
    """

    range_m: Float
    normal: Float
    ray: Float
    cosine: Float
    area_m2: Float

    def __getitem__(self, chosen: Bool, /) -> "Surfaces":
        """Return the pieces that are chosen, (n,)."""
        places = np.flatnonzero(chosen)
        normal, ray = (part.reshape(3, -1).take(places, axis=1) for part in (self.normal, self.ray))
        range_m, cosine, area_m2 = (part.ravel().take(places) for part in (self.range_m, self.cosine, self.area_m2))
        return Surfaces(range_m, normal, ray, cosine, area_m2)


@dataclass(frozen=True, eq=False)
class PatchPlanes:
    """The surfaces of the patches, (rows, columns).

    `found` says which patches have a surface, (rows, columns), and `on_plane` which sampled pixels lie on it, (n, rows,
    columns).
    """

    surfaces: Surfaces
    found: Bool
    on_plane: Bool


def patch_planes(range_m: Float | Float32, seen: Bool, grid: PatchGrid, /, *, over_steps: bool = False) -> PatchPlanes:
    """Fit a plane to the sampled ranges of every patch, (n, rows, columns); pixels that are not `seen` are left out.

    A step from one surface to another behind it tilts the plane of a patch. With `over_steps`, such a patch gets the
    normal that most of its neighbouring samples have.
    """
    inverse = np.where(seen, 1.0 / (range_m * grid.cosine), np.float32(np.inf))
    middle = _median(inverse, seen)
    off = inverse / middle - 1.0
    on_plane: Bool = np.abs(off) < SAME_SURFACE
    counted = on_plane.astype(np.float64)
    normal = _normals(np.where(on_plane, off, 0.0).astype(np.float64), counted, grid, over_steps=over_steps)
    distance = 1.0 / (middle * grid.ray[2])
    cosine = np.minimum(np.maximum(-(normal * grid.ray).sum(0), LEAST_COSINE), 1.0)
    solid_angle = (grid.side / grid.view.focal_length_px) ** 2 * grid.ray[2] ** 3
    surfaces = Surfaces(distance, normal, grid.ray, cosine, solid_angle * distance**2 / cosine)
    return PatchPlanes(surfaces, counted.sum(0) > LEAST_SHARE * len(seen), on_plane)


def _median(inverse: Float32, seen: Bool) -> Float32:
    """Return the (upper) median over the seen pixels of every patch; 1 if a patch has none."""
    place = seen.sum(0) // 2
    ordered = np.sort(np.ascontiguousarray(inverse.reshape(len(inverse), -1).T))
    median = ordered[np.arange(place.size), place.ravel()].reshape(place.shape)
    found: Float32 = np.where(np.isfinite(median), median, np.float32(1.0))
    return found


def _normals(off: Float, counted: Float, grid: PatchGrid, *, over_steps: bool) -> Float:
    """Return unit normals towards the camera, (3, rows, columns), by least squares, from 1/z = (1 + off)/z_middle.

    `counted` and `off` are (n, rows, columns); `off` is 0 if a pixel is not `counted`. A sample has the same position
    in all patches. So the sums over all patches are products with a few common vectors.
    """
    powers, shape = grid.powers, (-1, *counted.shape[1:])
    count, x, y, xx, yy, xy = (powers @ counted.reshape(len(counted), -1)).reshape(shape)
    share = 1.0 / np.maximum(count, 1.0)
    z, xz, yz = (powers[:3] @ off.reshape(len(off), -1)).reshape(shape) * share
    x, y = x * share, y * share
    xx, yy, xy = xx * share - x * x + TINY, yy * share - y * y + TINY, xy * share - x * y
    xz, yz = xz - x * z, yz - y * z
    determinant = xx * yy - xy * xy + TINY**2
    a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
    if over_steps:
        a, b = _slopes_over_steps(off, counted, (a, b), per_side=grid.side // grid.stride)
    level = 1.0 + z - a * x - b * y
    per_slope = grid.view.focal_length_px / grid.stride
    a, b = a * per_slope, b * per_slope
    normal = -np.stack([a, b, level - a * grid.slope[0] - b * grid.slope[1]])
    unit: Float = normal / np.sqrt((normal * normal).sum(0))
    return unit


def _slopes_over_steps(
    off: Float, counted: Float, slopes: tuple[Float, Float], *, per_side: int
) -> tuple[Float, Float]:
    """Return slopes per sample to the right and down, (rows, columns): in patches with a step the medians over all pairs
    of neighbouring samples, in others those given.
    """
    values = np.where(counted > 0.0, off, np.nan).reshape(per_side, per_side, *counted.shape[1:])
    medians, stepped, told = [], np.zeros(counted.shape[1:], np.bool_), np.ones(counted.shape[1:], np.bool_)
    for slope, axis in zip(slopes, (1, 0), strict=True):
        ordered = np.sort(np.diff(values, axis=axis).reshape(-1, *slope.shape), axis=0)
        pairs = np.isfinite(ordered).sum(0)
        low, middle, high = (np.take_along_axis(ordered, (quarter * pairs // 4)[None], 0)[0] for quarter in (1, 2, 3))
        error = SIGMA_OF_MEDIAN * (high - low) / np.sqrt(np.maximum(pairs, 1))
        stepped |= np.abs(slope - middle) > STEP_SIGMAS * error
        told &= pairs >= LEAST_PAIRS
        medians.append(middle)
    a, b = (np.where(stepped & told, median, slope) for median, slope in zip(medians, slopes, strict=True))
    return a, b
