"""The surface of every patch: a plane through its points, since 1/z of a plane is linear in the slopes X and Y of the rays."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.resolver.diffuse.grid import PatchGrid

SAME_SURFACE = 0.1
"""Relative difference of depth within which points, or a pixel and a patch, belong to one surface."""

LEAST_COSINE = 0.08
"""Least cosine of incidence: grazing surfaces would have areas and albedos without bound."""

LEAST_SHARE = 0.3
"""Share of a patch's sampled pixels that must lie on its plane."""

TINY = 1e-12
"""Keeps patches without points, or with all in one line, from dividing by zero."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Flat pieces of surface: range m, unit normal and unit ray (3, …), cosine of incidence, area m²; (…) each."""

    range_m: Float
    normal: Float
    ray: Float
    cosine: Float
    area_m2: Float

    def __getitem__(self, chosen: Bool, /) -> "Surfaces":
        """Return some of the pieces, (n,)."""
        return Surfaces(
            self.range_m[chosen], self.normal[:, chosen], self.ray[:, chosen], self.cosine[chosen], self.area_m2[chosen]
        )


@dataclass(frozen=True, eq=False)
class PatchPlanes:
    """The surfaces of the patches, (rows, columns); which of them are `found`; and the sampled pixels `on_plane`, (…, n)."""

    surfaces: Surfaces
    found: Bool
    on_plane: Bool


def patch_planes(range_m: Float, seen: Bool, grid: PatchGrid, /) -> PatchPlanes:
    """Fit a plane to the sampled ranges of every patch, (rows, columns, n); pixels not `seen` are left out."""
    inverse = np.where(seen, 1.0 / (range_m * grid.cosine), np.inf)
    middle = _median(inverse, seen)
    on_plane: Bool = np.abs(np.where(seen, inverse, np.nan) - middle[..., None]) < SAME_SURFACE * middle[..., None]
    normal = _normals(np.where(on_plane, inverse, 0.0), on_plane, grid)
    distance = 1.0 / (middle * grid.ray[2])
    cosine = np.clip(-(normal * grid.ray).sum(0), LEAST_COSINE, 1.0)
    solid_angle = (grid.side / grid.view.focal_length_px) ** 2 * grid.ray[2] ** 3
    surfaces = Surfaces(distance, normal, grid.ray, cosine, solid_angle * distance**2 / cosine)
    return PatchPlanes(surfaces, on_plane.sum(-1) > LEAST_SHARE * seen.shape[-1], on_plane)


def _median(inverse: Float, seen: Bool) -> Float:
    """Return the (upper) median over the seen pixels of every patch; 1 where there are none."""
    place = np.minimum(seen.sum(-1) // 2, seen.shape[-1] - 1)
    median = np.take_along_axis(np.sort(inverse, axis=-1), place[..., None], axis=-1)[..., 0]
    found: Float = np.where(np.isfinite(median), median, 1.0)
    return found


def _normals(inverse: Float, on_plane: Bool, grid: PatchGrid) -> Float:
    """Return unit normals towards the camera, (3, rows, columns), of 1/z = a·X + b·Y + c by least squares."""
    count = np.maximum(on_plane.sum(-1), 1)

    def mean(values: Float) -> Float:
        average: Float = (on_plane * values).sum(-1) / count
        return average

    x, y, z = mean(grid.slope_x), mean(grid.slope_y), mean(inverse)
    dx, dy, dz = grid.slope_x - x[..., None], grid.slope_y - y[..., None], inverse - z[..., None]
    xx, yy, xy, xz, yz = mean(dx * dx) + TINY, mean(dy * dy) + TINY, mean(dx * dy), mean(dx * dz), mean(dy * dz)
    determinant = xx * yy - xy * xy + TINY**2
    a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
    normal = -np.stack([a, b, z - a * x - b * y])
    unit: Float = normal / (np.linalg.norm(normal, axis=0) + TINY)
    return unit
