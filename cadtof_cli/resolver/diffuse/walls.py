"""Walls: planes that many patches lie on, found from patches and their neighbours, and how far they are in every direction."""

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.resolver.diffuse.grid import PatchGrid

MOST_WALLS = 8
"""Planes looked for: walls, floor, ceiling, and what large furniture shows."""

LEAST_PATCHES = 8
"""Patches that a wall is seen by."""

LEAST_NEIGHBOURS = 6
"""Of a patch and its eight neighbours, those that must be there for a plane through them."""

ON_PLANE = 0.03
"""Relative difference of depth within which a patch lies on a plane."""

LARGEST_M = 20.0
"""Largest depth at which a plane counts: where it turns away it is infinitely far."""

RIDGE = 1e-9
"""Keeps planes through points in one line from dividing by zero."""


def walls_behind(range_m: Float, among: Bool, grid: PatchGrid, /) -> Float:
    """Return how far in the direction of every patch the walls are on which the patches `among` lie, (n, rows, columns).

    `range_m`, (rows, columns), counts where `among` is set. The walls are in the order of how many patches see them; inf stands
    where one is not met.
    """
    slopes = np.stack([grid.ray[0] / grid.ray[2], grid.ray[1] / grid.ray[2], np.ones(among.shape)])
    inverse = 1.0 / np.where(among, range_m * grid.ray[2], np.inf)
    planes = _planes_of_neighbours(slopes, inverse, among)
    on_plane = _on_planes(planes, slopes, inverse)
    left = among.copy()
    walls: list[Float] = []
    while len(planes) and len(walls) < MOST_WALLS:
        seen = (on_plane & left).sum(axis=(1, 2))
        best = int(seen.argmax())
        if seen[best] < LEAST_PATCHES:
            break
        members = on_plane[best] & left
        wall = _solved(*(part.sum(axis=(-2, -1)) for part in _moments(slopes, inverse, members)))
        left &= ~(members | _on_planes(wall[None], slopes, inverse)[0])
        walls.append(1.0 / np.maximum(_inverse_depths(wall[None], slopes)[0], 1.0 / LARGEST_M) / grid.ray[2])
    return np.stack(walls) if walls else np.empty((0, *among.shape))


def _planes_of_neighbours(slopes: Float, inverse: Float, among: Bool) -> Float:
    """Return the planes 1/z = aX + bY + c through every second patch of every second row and its neighbours, (n, 3)."""
    count = over_neighbours(among.astype(np.float64))
    middle = np.zeros_like(among)
    middle[1::2, 1::2] = (among & (count >= LEAST_NEIGHBOURS))[1::2, 1::2]
    square, product = (over_neighbours(part)[..., middle] for part in _moments(slopes, inverse, among))
    return _solved(np.moveaxis(square, -1, 0), np.moveaxis(product, -1, 0))


def _moments(slopes: Float, inverse: Float, among: Bool) -> tuple[Float, Float]:
    """Return the products of slopes, (3, 3, rows, columns), and of slopes with 1/z, (3, rows, columns), 0 elsewhere."""
    counted = slopes * among
    return counted[:, None] * slopes, counted * inverse


def over_neighbours(values: Float) -> Float:
    """Return sums over every patch and its eight neighbours, (…, rows, columns)."""
    rows, columns = values.shape[-2:]
    padded = np.zeros((*values.shape[:-2], rows + 2, columns + 2))
    padded[..., 1:-1, 1:-1] = values
    shifted = [padded[..., i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.asarray(sum(shifted))


def _solved(square: Float, product: Float) -> Float:
    """Return the planes of least squares, (…, 3)."""
    return np.asarray(np.linalg.solve(square + RIDGE * np.eye(3), product[..., None])[..., 0], np.float64)


def _on_planes(planes: Float, slopes: Float, inverse: Float) -> Bool:
    """Return which patches lie on each of the planes (n, 3), (n, rows, columns)."""
    near: Bool = np.abs(_inverse_depths(planes, slopes) - inverse) < ON_PLANE * inverse
    return near


def _inverse_depths(planes: Float, slopes: Float) -> Float:
    a, b, c = (part[:, None, None] for part in planes.T)
    depths: Float = a * slopes[0] + b * slopes[1] + c
    return depths
