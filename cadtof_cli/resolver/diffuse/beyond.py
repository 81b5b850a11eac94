"""Surfaces outside the view: continued planes of the patches at its border, and walls that none of them continues."""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, sealed
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.box import unseen_walls
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.planes import LEAST_COSINE, LEAST_SHARE, Surfaces

RINGS = 2
"""Rings of pieces around the view. A surface farther out is far away, or ends at the next wall."""

PIECE_PATCHES = 3
"""Side of a piece in patches."""

NEAREST_M = 0.25
"""Smallest range of a piece: at a smaller one, a continued plane would run into the camera."""


def surfaces_beyond(surfaces: Surfaces, valid: Bool, grid: PatchGrid, /) -> Surfaces:
    """Return pieces of surface around the view, (n,), from the surfaces of the patches, (rows, columns).

    Each piece lies where its ray meets the plane of the nearest patch at the border. A piece is left out if that patch
    is not valid, or if its ray does not meet the plane.
    """
    pieces = _pieces(grid)
    distance, normal = _continued(pieces, surfaces, valid)
    return pieces.surfaces(distance, normal)[np.isfinite(distance)]


def surfaces_guessed(surfaces: Surfaces, valid: Bool, grid: PatchGrid, /, *, seen: Surfaces) -> Surfaces:
    """Return pieces of walls around the view that it does not show, (n,), where they stand before the continued planes.

    `seen`, (n,), are the surfaces of valid patches.
    """
    pieces = _pieces(grid)
    distance, normal = unseen_walls(seen).meet(pieces.ray)
    first = (distance < _continued(pieces, surfaces, valid)[0]) & (-(normal * pieces.ray).sum(0) > LEAST_COSINE)
    return pieces.surfaces(distance, normal)[first]


def _continued(pieces: "_Pieces", surfaces: Surfaces, valid: Bool) -> tuple[Float, Float]:
    """Return the distance at which each piece lies on the plane of the nearest patch, and its normal.

    The distance is infinite if the piece lies nowhere on it.
    """
    column, row = pieces.patch
    normal = surfaces.normal[:, row, column]
    cosine = -(normal * pieces.ray).sum(0)
    faces = cosine > LEAST_COSINE
    offset = -(normal * surfaces.ray[:, row, column]).sum(0) * surfaces.range_m[row, column]
    distance = np.where(faces, offset / np.where(faces, cosine, 1.0), 0.0)
    return np.where(valid[row, column] & (distance > NEAREST_M), distance, np.inf), normal


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Squares around the view, (n,): unit rays (3, n) through them, solid angles, and (column, row) of the nearest patches."""

    ray: Float
    solid_angle: Float
    patch: tuple[Index, Index]

    def surfaces(self, distance: Float, normal: Float) -> Surfaces:
        """Return the surfaces with these distances and normals that the squares show."""
        cosine = -(normal * self.ray).sum(0)
        area = self.solid_angle * distance**2 / np.maximum(cosine, LEAST_COSINE)
        return Surfaces(distance, normal, self.ray, cosine, area)


@lru_cache(maxsize=4)
def _pieces(grid: PatchGrid) -> _Pieces:
    side = PIECE_PATCHES * grid.side
    x, y = _middles(grid, side)
    cx, cy = grid.view.principal_point_px
    ray = np.stack([(x - 0.5 - cx), (y - 0.5 - cy), np.full(x.shape, grid.view.focal_length_px)])
    length = np.linalg.norm(ray, axis=0) / grid.view.focal_length_px
    ray /= length * grid.view.focal_length_px
    return sealed(_Pieces(ray, (side / grid.view.focal_length_px) ** 2 / length**3, _nearest_patches(x, y, grid)))


def _nearest_patches(x: Float, y: Float, grid: PatchGrid) -> tuple[Index, Index]:
    """Return the column and the row of the patch that is nearest to each piece, (n,) each.

    The frame may hold so little of the patches in its last row or column that no surface is ever found there. Then the
    nearest whole patch is taken.
    """
    column = np.clip((x / grid.side).astype(np.intp), 0, grid.columns - 1)
    row = np.clip((y / grid.side).astype(np.intp), 0, grid.rows - 1)
    held = grid.samples(np.broadcast_to(True, (grid.height, grid.width))).mean(0)
    sliver = held[row, column] <= LEAST_SHARE
    column[sliver] = np.minimum(column[sliver], max(grid.columns - 2, 0))
    row[sliver] = np.minimum(row[sliver], max(grid.rows - 2, 0))
    return column, row


def _middles(grid: PatchGrid, side: int) -> tuple[Float, Float]:
    """Return the middles (x, y) of the pieces, in pixels from the frame's corner, (n,) each."""
    x, y = (np.arange(-RINGS * side + 0.5 * side, extent + RINGS * side, side) for extent in (grid.width, grid.height))
    x, y = (values.ravel() for values in np.meshgrid(x, y))
    outside = (x < 0) | (x > grid.width) | (y < 0) | (y > grid.height)
    return x[outside], y[outside]
