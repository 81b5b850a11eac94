"""Walls: planes on which many patches lie. They are found from patches and their neighbours."""

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.resolver.diffuse.grid import PatchGrid

MOST_WALLS = 8
"""Largest number of planes: walls, floor, ceiling, and planes of large furniture."""

LEAST_PATCHES = 8
"""Smallest number of patches that must see a wall."""

LEAST_NEIGHBOURS = 6
"""How many of a patch and its eight neighbours must be valid for a plane through them."""

ON_PLANE = 0.03
"""Largest relative difference of depth between a patch and a plane on which it lies."""

LARGEST_M = 20.0
"""Largest depth of a plane. It stands for directions in which the plane is farther, or is not met."""

RIDGE = 1e-9
"""Keeps planes through points on one line from dividing by zero."""


def walls_behind(range_m: Float, among: Bool, grid: PatchGrid, /) -> Float:
    """Return the ranges of the walls on which the patches `among` lie, in the direction of every patch, (n, rows, columns).

    `range_m`, (rows, columns), counts for the patches `among`. A wall that is not met has the depth `LARGEST_M`. The
    walls are in the order in which they were found: each time the one that most of the remaining patches see.
    """
    slopes = (grid.ray / grid.ray[2]).reshape(3, -1)
    inverse = 1.0 / np.where(among, range_m * grid.ray[2], np.inf).ravel()
    left = among.ravel()
    # sums of these products over patches give the least squares of 1/z = aX + bY + c
    moments = slopes[:, None] * np.concatenate([slopes, inverse[None]]) * left
    planes = _planes_of_neighbours(moments.reshape(3, 4, *among.shape), among)
    on_plane = _on_planes(planes, slopes, inverse)
    counted = on_plane.astype(np.float32)
    walls: list[Float] = []
    while len(planes) and len(walls) < MOST_WALLS:
        seen = counted @ left.astype(np.float32)
        best = int(seen.argmax())
        if seen[best] < LEAST_PATCHES:
            break
        members = on_plane[best] & left
        wall = _solved(moments @ members)
        left = left & ~(members | _on_planes(wall, slopes, inverse))
        walls.append(1.0 / np.maximum(wall @ slopes, 1.0 / LARGEST_M))
    found: Float = np.array(walls).reshape(-1, *among.shape) / grid.ray[2]
    return found


def _planes_of_neighbours(moments: Float, among: Bool) -> Float:
    """Return the planes 1/z = aX + bY + c through every second patch of every second row and its neighbours, (n, 3)."""
    count = over_neighbours(among.astype(np.float64))
    middle = np.zeros_like(among)
    middle[1::2, 1::2] = (among & (count >= LEAST_NEIGHBOURS))[1::2, 1::2]
    return _solved(np.moveaxis(over_neighbours(moments)[..., middle], -1, 0))


def over_neighbours(values: Float, /) -> Float:
    """Return sums over every patch and its eight neighbours, (…, rows, columns)."""
    across = values.copy()
    across[..., 1:] += values[..., :-1]
    across[..., :-1] += values[..., 1:]
    total = across.copy()
    total[..., 1:, :] += across[..., :-1, :]
    total[..., :-1, :] += across[..., 1:, :]
    return total


def _solved(moments: Float) -> Float:
    """Return the planes of least squares, (…, 3), from the sums of products of slopes with slopes and with 1/z, (…, 3, 4)."""
    square = moments[..., :3] + RIDGE * np.eye(3)
    return np.asarray(np.linalg.solve(square, moments[..., 3:])[..., 0], np.float64)


def _on_planes(planes: Float, slopes: Float, inverse: Float) -> Bool:
    """Return which patches lie on planes (…, 3), (…, patches)."""
    near: Bool = np.abs(planes @ slopes - inverse) < ON_PLANE * inverse
    return near
