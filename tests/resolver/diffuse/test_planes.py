import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.beyond import surfaces_beyond, surfaces_guessed
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, assumed_view, patch_grid
from cadtof_cli.resolver.diffuse.planes import PatchPlanes, Surfaces, patch_planes
from tests.support.diffuse_frames import F, wall_range

HEIGHT, WIDTH, FOCAL = 90, 130, 120.0
TILT = (0.4, -0.25)
NORMAL = -np.array([*TILT, 1.0]) / np.linalg.norm([*TILT, 1.0])
"""z + αx + βy = D: towards the camera."""


def grid() -> PatchGrid:
    return patch_grid(HEIGHT, WIDTH, View(FOCAL, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)))


def planes_of(range_m: F) -> PatchPlanes:
    sampled = grid().samples(range_m)
    return patch_planes(np.where(sampled > 0, sampled, 1.0), sampled > 0, grid())


def tilted() -> F:
    return wall_range(HEIGHT, WIDTH, FOCAL, 2.5, TILT)


def test_a_tilted_wall_is_found_in_every_patch() -> None:
    found = planes_of(tilted())
    assert found.found[:-1, :-1].all()
    inner = (slice(None), slice(0, -1), slice(0, -1))
    np.testing.assert_allclose(
        found.surfaces.normal[inner],
        np.broadcast_to(NORMAL[:, None, None], found.surfaces.normal[inner].shape),
        atol=1e-5,
    )
    ray = grid().ray[inner]
    expected = 2.5 / (ray[2] + TILT[0] * ray[0] + TILT[1] * ray[1])
    np.testing.assert_allclose(found.surfaces.range_m[:-1, :-1], expected, rtol=0.02)
    np.testing.assert_allclose(found.surfaces.cosine[:-1, :-1], -np.einsum("i,ijk->jk", NORMAL, ray), atol=1e-5)


def test_the_patches_of_a_wall_cover_its_area() -> None:
    height, width = 96, 128
    full = patch_grid(height, width, View(FOCAL, ((width - 1) / 2, (height - 1) / 2)))
    sampled = full.samples(wall_range(height, width, FOCAL, 2.0))
    area = patch_planes(np.where(sampled > 0, sampled, 1.0), sampled > 0, full).surfaces.area_m2
    cut = full.rows * full.side * full.columns * full.side
    assert area.sum() == pytest.approx((2.0 / FOCAL) ** 2 * cut, rel=0.02)


def test_holes_and_another_surface_do_not_bend_a_plane() -> None:
    range_m = tilted()
    range_m[::3, ::2] = 0.0
    range_m[1::4, 1::4] = 6.0
    found = planes_of(range_m)
    np.testing.assert_allclose(
        found.surfaces.normal[:, 3:-2, 3:-2],
        np.broadcast_to(NORMAL[:, None, None], found.surfaces.normal[:, 3:-2, 3:-2].shape),
        atol=1e-4,
    )


def test_patches_without_pixels_are_not_found() -> None:
    range_m = tilted()
    range_m[:, :40] = 0.0
    found = planes_of(range_m)
    assert not found.found[:, : 40 // grid().side].any()
    assert np.isfinite(found.surfaces.range_m).all()


def test_pieces_beyond_the_view_lie_on_the_wall_that_goes_on_there() -> None:
    found = planes_of(tilted())
    pieces = surfaces_beyond(found.surfaces, found.found, grid())
    assert len(pieces.range_m) > 30
    point = pieces.ray * pieces.range_m
    np.testing.assert_allclose(point[2] + TILT[0] * point[0] + TILT[1] * point[1], 2.5, rtol=0.02)
    x, y = FOCAL * point[0] / point[2], FOCAL * point[1] / point[2]
    assert ((np.abs(x) > WIDTH / 2 - 1) | (np.abs(y) > HEIGHT / 2 - 1)).all()


def test_walls_that_are_not_seen_are_guessed_before_the_one_that_is() -> None:
    """At right angles to it, and outside the view."""
    found = planes_of(tilted())
    pieces = surfaces_guessed(found.surfaces, found.found, grid())
    assert len(pieces.range_m) > 10
    np.testing.assert_allclose((pieces.normal * NORMAL[:, None]).sum(0), 0.0, atol=0.02)
    point = pieces.ray * pieces.range_m
    assert (point[2] + TILT[0] * point[0] + TILT[1] * point[1] < 2.5).all()
    x, y = FOCAL * point[0] / point[2], FOCAL * point[1] / point[2]
    assert ((np.abs(x) > WIDTH / 2 - 1) | (np.abs(y) > HEIGHT / 2 - 1)).all()
    np.testing.assert_allclose(pieces.cosine, -(pieces.normal * pieces.ray).sum(0))


def test_unknown_optics_are_sixty_degrees_across() -> None:
    view = assumed_view(240, 320)
    assert not view.known
    assert view.principal_point_px == (159.5, 119.5)
    assert 2 * np.degrees(np.arctan(160 / view.focal_length_px)) == pytest.approx(60)


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (37, 53), (240, 320), (1000, 1300)])
def test_any_frame_is_cut_into_patches_that_hold_every_pixel(size: tuple[int, int]) -> None:
    cut = patch_grid(*size, assumed_view(*size))
    assert cut.rows * cut.side >= size[0]
    assert cut.columns * cut.side >= size[1]
    assert (cut.rows - 1) * cut.side < size[0]
    assert (cut.columns - 1) * cut.side < size[1]
    ones = cut.samples(np.ones(size))
    assert 0 < ones.sum() <= size[0] * size[1]
    assert ones.shape[:2] == (cut.rows, cut.columns)


@pytest.mark.parametrize("distance_m", [1.0, 2.5])
def test_a_wall_that_faces_the_camera_goes_on_beside_the_view_in_pieces_of_one_size(distance_m: float) -> None:
    """Squares of the same angle at the array are squares of the same size on a wall parallel to it."""
    grid = patch_grid(120, 160, View(140.0, (79.5, 59.5)))
    normal = np.zeros_like(grid.ray)
    normal[2] = -1.0
    wall = Surfaces(distance_m / grid.ray[2], normal, grid.ray, grid.ray[2], np.ones(grid.ray.shape[1:]))
    found = surfaces_beyond(wall, np.ones(grid.ray.shape[1:], bool), grid)
    assert len(found.range_m)
    np.testing.assert_allclose(found.range_m * found.ray[2], distance_m)
    np.testing.assert_allclose(found.cosine, found.ray[2])
    np.testing.assert_allclose(found.area_m2, found.area_m2[0])
    side_px = round(float(np.sqrt(found.area_m2[0]) * 140.0 / distance_m), 6)
    assert side_px == pytest.approx(round(side_px))
    assert side_px % grid.side == 0
