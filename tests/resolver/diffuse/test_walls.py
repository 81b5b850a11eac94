"""Walls are found from the patches that see them, and continued behind those that do not."""

import numpy as np

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, patch_grid
from cadtof_cli.resolver.diffuse.walls import LARGEST_M, walls_behind
from tests.support.diffuse_frames import F

HEIGHT, WIDTH, FOCAL = 96, 128, 120.0


def grid() -> PatchGrid:
    return patch_grid(HEIGHT, WIDTH, View(FOCAL, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)))


def plane_range(distance_m: float, tilt: float) -> F:
    """Range of z + tilt·x = distance in the direction of every patch."""
    x, _, z = grid().ray
    return np.asarray(distance_m / (z + tilt * x))


def hole() -> Bool:
    rows, columns = np.indices(grid().ray[0].shape)
    return np.asarray((rows > 5) & (rows < 11) & (columns > 6) & (columns < 14))


def test_a_wall_goes_on_behind_what_hides_it() -> None:
    there = plane_range(3.0, 0.3)
    (wall,) = walls_behind(np.where(hole(), 1.0, there), ~hole(), grid())
    np.testing.assert_allclose(wall, there, rtol=1e-6)


def test_two_walls_of_a_corner_are_told_apart() -> None:
    left, right = plane_range(3.0, -1.0), plane_range(3.0, 1.0)
    nearer = np.minimum(left, right)
    found = walls_behind(np.where(hole(), 1.0, nearer), ~hole(), grid())
    assert len(found) == 2
    for wall in (left, right):
        seen = nearer == wall
        assert min(float(np.abs(one - wall)[seen].max()) for one in found) < 0.02


def test_a_wall_that_turns_away_is_far_off() -> None:
    """z = 2 + 2·x is not met by rays to the right of x = z/2."""
    x, _, z = grid().ray
    seen = x / z < 0.3
    (wall,) = walls_behind(np.where(seen, plane_range(2.0, -2.0), 1.0), np.asarray(seen), grid())
    assert (wall[x / z > 0.5] >= LARGEST_M).all()


def test_without_patches_there_is_no_wall() -> None:
    assert walls_behind(np.ones(hole().shape), np.zeros(hole().shape, np.bool_), grid()).shape == (0, *hole().shape)
