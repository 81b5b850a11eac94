"""Walls are found from the patches that lie on them, and continued behind patches that hide them."""

import numpy as np
import pytest

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, patch_grid
from cadtof_cli.resolver.diffuse.walls import walls_behind
from tests.support.diffuse_frames import F

HEIGHT, WIDTH, FOCAL = 96, 128, 120.0


def grid() -> PatchGrid:
    return patch_grid(HEIGHT, WIDTH, View(FOCAL, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)))


def plane_range(distance_m: float, tilt: float) -> F:
    """Return the range of the plane z + tilt·x = distance in the direction of every patch."""
    x, _, z = grid().ray
    return np.asarray(distance_m / (z + tilt * x))


def hole() -> Bool:
    rows, columns = np.indices(grid().ray[0].shape)
    return np.asarray((rows > 5) & (rows < 11) & (columns > 6) & (columns < 14))


def test_a_wall_continues_behind_patches_that_hide_it() -> None:
    range_m = plane_range(3.0, 0.3)
    (wall,) = walls_behind(np.where(hole(), 1.0, range_m), ~hole(), grid())
    np.testing.assert_allclose(wall, range_m, rtol=1e-6)


def test_both_walls_of_a_corner_are_found() -> None:
    left, right = plane_range(3.0, -1.0), plane_range(3.0, 1.0)
    nearer = np.minimum(left, right)
    found = walls_behind(np.where(hole(), 1.0, nearer), ~hole(), grid())
    assert len(found) == 2
    for wall in (left, right):
        patches = nearer == wall
        assert min(float(np.abs(one - wall)[patches].max()) for one in found) < 0.02


def test_a_wall_that_rays_do_not_meet_counts_as_20_m_deep() -> None:
    """Rays to the right of x = z/2 do not meet the wall z = 2 + 2·x. Its depth counts as 20 m at most."""
    x, _, z = grid().ray
    patches = x / z < 0.3
    (wall,) = walls_behind(np.where(patches, plane_range(2.0, -2.0), 1.0), np.asarray(patches), grid())
    depth = np.where(x / z < 0.45, 2.0 / (1.0 - 2.0 * np.minimum(x / z, 0.45)), 20.0)
    np.testing.assert_allclose(wall * z, depth, rtol=1e-5)


def test_without_patches_there_is_no_wall() -> None:
    assert walls_behind(np.ones(hole().shape), np.zeros(hole().shape, np.bool_), grid()).shape == (0, *hole().shape)


def squares(*places: tuple[int, int], rows: int = 3, columns: int = 3) -> Bool:
    """Return rectangles of patches with their upper left corners at these places."""
    chosen = np.zeros(hole().shape, bool)
    for row, column in places:
        chosen[row : row + rows, column : column + columns] = True
    return chosen


def count_of_walls(range_m: F, among: Bool) -> int:
    return len(walls_behind(np.where(among, range_m, 1.0), among, grid()))


@pytest.mark.parametrize(("left_out", "walls"), [(0, 1), (1, 1), (2, 0)])
def test_a_wall_needs_eight_patches(left_out: int, walls: int) -> None:
    patches = squares((4, 6))
    patches[4, 6 : 6 + left_out] = False
    assert count_of_walls(plane_range(3.0, 0.1), patches) == walls


@pytest.mark.parametrize(("columns", "walls"), [(2, 1), (1, 0)])
def test_a_patch_with_five_neighbours_gives_a_plane(columns: int, walls: int) -> None:
    """Strips of patches, three high, have gaps between them. If they are two wide, a neighbourhood has six patches."""
    patches = squares((4, 7), (4, 11), (4, 15), rows=3, columns=columns)
    assert count_of_walls(plane_range(3.0, 0.1), patches) == walls


def test_patches_with_four_neighbours_give_no_plane() -> None:
    patches = squares((4, 7), (4, 11), (4, 15), rows=3, columns=2)
    patches[4, [8, 12, 16]] = False
    assert patches.sum() == 15
    assert count_of_walls(plane_range(3.0, 0.1), patches) == 0


@pytest.mark.parametrize(("count", "walls"), [(3, 3), (8, 8), (10, 8)])
def test_at_most_eight_walls_are_found(count: int, walls: int) -> None:
    """Each square of patches is farther than the one before by a tenth."""
    places = [(row, column) for row in (0, 4, 8) for column in (0, 4, 8, 12, 16)][:count]
    range_m, patches = np.ones(hole().shape), squares(*places)
    for number, place in enumerate(places):
        range_m[squares(place)] = plane_range(1.5 * 1.1**number, 0.0)[squares(place)]
    found = walls_behind(range_m, patches, grid())
    assert len(found) == walls
    depths = sorted(float(np.median(one * grid().ray[2])) for one in found)
    assert all(min(abs(depth / (1.5 * 1.1**number) - 1.0) for number in range(count)) < 1e-6 for depth in depths)


@pytest.mark.parametrize(("farther", "walls"), [(1.025, 1), (1.045, 2)])
def test_patches_within_three_hundredths_of_its_depth_lie_on_a_wall(farther: float, walls: int) -> None:
    behind = squares((3, 13), rows=6, columns=5)
    range_m = plane_range(3.0, 0.0) * np.where(behind, farther, 1.0)
    assert count_of_walls(range_m, behind | squares((3, 3), rows=6, columns=7)) == walls


def test_the_wall_that_most_patches_see_comes_first() -> None:
    small, large = squares((1, 1), rows=4, columns=4), squares((6, 8), rows=6, columns=8)
    near, far = plane_range(2.0, 0.2), plane_range(4.0, -0.2)
    first, second = walls_behind(np.where(small, near, far), small | large, grid())
    np.testing.assert_allclose(first, far, rtol=1e-5)
    np.testing.assert_allclose(second, near, rtol=1e-5)
