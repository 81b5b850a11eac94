"""The surfaces of patches, and surfaces outside the view: continued planes and guessed walls."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.beyond import surfaces_beyond, surfaces_guessed
from cadtof_cli.resolver.diffuse.grid import PatchGrid, View, assumed_view, patch_grid
from cadtof_cli.resolver.diffuse.planes import PatchPlanes, Surfaces, patch_planes
from tests.support.diffuse_frames import F, wall_range

HEIGHT, WIDTH, FOCAL = 90, 130, 120.0
TILT = (0.4, -0.25)
NORMAL = -np.array([*TILT, 1.0]) / np.linalg.norm([*TILT, 1.0])
"""Normal of the wall z + αx + βy = D, towards the camera."""


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
    pixels = full.rows * full.side * full.columns * full.side
    assert area.sum() == pytest.approx((2.0 / FOCAL) ** 2 * pixels, rel=0.02)


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


def test_pieces_beyond_the_view_lie_on_the_continued_wall() -> None:
    found = planes_of(tilted())
    pieces = surfaces_beyond(found.surfaces, found.found, grid())
    assert len(pieces.range_m) > 30
    point = pieces.ray * pieces.range_m
    np.testing.assert_allclose(point[2] + TILT[0] * point[0] + TILT[1] * point[1], 2.5, rtol=0.02)
    x, y = FOCAL * point[0] / point[2], FOCAL * point[1] / point[2]
    assert ((np.abs(x) > WIDTH / 2 - 1) | (np.abs(y) > HEIGHT / 2 - 1)).all()


@pytest.mark.parametrize("size", [(121, 160), (120, 161), (122, 162), (180, 240), (1024, 1024), (172, 224)])
def test_a_wall_goes_on_beyond_edges_that_hold_only_slivers_of_their_patches(size: tuple[int, int]) -> None:
    """The frame may hold so little of a patch in the last row or column that no surface is found there."""
    height, width = size
    view = View(0.9 * width, ((width - 1) / 2, (height - 1) / 2))
    frame_grid = patch_grid(height, width, view)
    range_m = wall_range(height, width, view.focal_length_px, 2.5, TILT)
    sampled, seen = frame_grid.samples(range_m), frame_grid.samples(np.ones(size, bool))
    planes = patch_planes(np.where(seen, sampled, 1.0), seen, frame_grid)
    assert not planes.found.all()
    pieces = surfaces_beyond(planes.surfaces, planes.found, frame_grid)
    point = pieces.ray * pieces.range_m
    np.testing.assert_allclose(point[2] + TILT[0] * point[0] + TILT[1] * point[1], 2.5, rtol=0.02)
    normal = np.broadcast_to(NORMAL[:, None, None], frame_grid.ray.shape)
    cosine = -(normal * frame_grid.ray).sum(0)
    wall = Surfaces(-2.5 * NORMAL[2] / cosine, normal, frame_grid.ray, cosine, np.ones_like(cosine))
    expected = surfaces_beyond(wall, np.ones_like(planes.found), frame_grid)
    assert len(pieces.range_m) == len(expected.range_m) > 40


def test_walls_that_are_not_seen_are_guessed_before_the_continued_wall() -> None:
    """Their pieces are at right angles to the wall, and outside the view."""
    found = planes_of(tilted())
    pieces = surfaces_guessed(found.surfaces, found.found, grid(), seen=found.surfaces[found.found])
    assert len(pieces.range_m) > 10
    np.testing.assert_allclose((pieces.normal * NORMAL[:, None]).sum(0), 0.0, atol=0.02)
    point = pieces.ray * pieces.range_m
    assert (point[2] + TILT[0] * point[0] + TILT[1] * point[1] < 2.5).all()
    x, y = FOCAL * point[0] / point[2], FOCAL * point[1] / point[2]
    assert ((np.abs(x) > WIDTH / 2 - 1) | (np.abs(y) > HEIGHT / 2 - 1)).all()
    np.testing.assert_allclose(pieces.cosine, -(pieces.normal * pieces.ray).sum(0))


def test_with_unknown_optics_the_view_is_sixty_degrees_across() -> None:
    view = assumed_view(240, 320)
    assert not view.known
    assert view.principal_point_px == (159.5, 119.5)
    assert 2 * np.degrees(np.arctan(160 / view.focal_length_px)) == pytest.approx(60)


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (37, 53), (240, 320), (1000, 1300)])
def test_the_patches_of_a_frame_of_any_size_hold_every_pixel(size: tuple[int, int]) -> None:
    frame_grid = patch_grid(*size, assumed_view(*size))
    assert frame_grid.rows * frame_grid.side >= size[0]
    assert frame_grid.columns * frame_grid.side >= size[1]
    assert (frame_grid.rows - 1) * frame_grid.side < size[0]
    assert (frame_grid.columns - 1) * frame_grid.side < size[1]
    ones = frame_grid.samples(np.ones(size))
    assert 0 < ones.sum() <= size[0] * size[1]
    assert ones.shape[1:] == (frame_grid.rows, frame_grid.columns)


@pytest.mark.parametrize("distance_m", [1.0, 2.5])
def test_a_wall_that_faces_the_camera_continues_in_pieces_of_one_size(distance_m: float) -> None:
    """Pieces are squares of equal size on the array, and so they are on a wall parallel to the array."""
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


def middles_outside(extent: int, side: int) -> list[float]:
    """Return the middles of pieces along one direction, from two pieces before the view to two pieces beyond it."""
    return [place for place in (-1.5 * side + side * n for n in range(1000)) if place < extent + 2 * side]


def test_pieces_are_two_rings_of_squares_of_three_patches_around_the_view() -> None:
    grid = patch_grid(120, 160, View(140.0, (70.0, 50.0)))
    normal = np.zeros_like(grid.ray)
    normal[2] = -1.0
    every = np.ones(grid.ray.shape[1:], bool)
    found = surfaces_beyond(Surfaces(2.0 / grid.ray[2], normal, grid.ray, grid.ray[2], every * 1.0), every, grid)
    x = 140.0 * found.ray[0] / found.ray[2] + 70.5
    y = 140.0 * found.ray[1] / found.ray[2] + 50.5
    side = 3 * grid.side
    expected = {
        (a, b)
        for a in middles_outside(160, side)
        for b in middles_outside(120, side)
        if not (0 <= a <= 160 and 0 <= b <= 120)
    }
    assert {(round(a, 6), round(b, 6)) for a, b in zip(x.tolist(), y.tolist(), strict=True)} == expected
    np.testing.assert_allclose(np.linalg.norm(found.ray, axis=0), 1.0)


def test_a_piece_beyond_the_view_continues_the_patch_that_is_nearest_in_the_image() -> None:
    """Every patch has a depth of its own."""
    grid = patch_grid(120, 160, View(140.0, (70.0, 50.0)))
    normal, every = np.zeros_like(grid.ray), np.ones(grid.ray.shape[1:], bool)
    normal[2] = -1.0
    depth = 2.0 + 0.01 * np.arange(every.size).reshape(every.shape)
    found = surfaces_beyond(Surfaces(depth / grid.ray[2], normal, grid.ray, grid.ray[2], every * 1.0), every, grid)
    place = 140.0 * found.ray[:2] / found.ray[2] + np.array([[70.5], [50.5]])
    column, row = (
        np.abs(along[:, np.newaxis] - grid.side * (np.arange(count) + 0.5)).argmin(axis=1)
        for along, count in zip(place, (grid.columns, grid.rows), strict=True)
    )
    np.testing.assert_allclose(found.range_m * found.ray[2], depth[row, column])


@pytest.mark.parametrize(("distance_m", "some_left"), [(0.2, False), (0.3, True)])
def test_pieces_too_near_the_camera_are_left_out(distance_m: float, some_left: bool) -> None:
    """Pieces are kept from a range of .25 m on. In this narrow view, all pieces of a wall have nearly one range."""
    grid = patch_grid(120, 160, View(1400.0, (79.5, 59.5)))
    normal = np.zeros_like(grid.ray)
    normal[2] = -1.0
    every = np.ones(grid.ray.shape[1:], bool)
    wall = Surfaces(distance_m / grid.ray[2], normal, grid.ray, grid.ray[2], every * 1.0)
    assert (len(surfaces_beyond(wall, every, grid).range_m) > 0) is some_left
    assert len(surfaces_beyond(wall, ~every, grid).range_m) == 0


@pytest.mark.parametrize(("lit", "found"), [(19, False), (20, True)])
def test_a_surface_needs_three_tenths_of_the_samples_of_a_patch(lit: int, found: bool) -> None:
    frame_grid = patch_grid(120, 160, View(FOCAL, (79.5, 59.5)))
    seen = np.zeros((64, frame_grid.rows, frame_grid.columns), bool)
    seen[:lit] = True
    planes = patch_planes(np.full(seen.shape, 2.0) / frame_grid.cosine, seen, frame_grid)
    assert planes.found.all() == planes.found.any() == found


@pytest.mark.parametrize("near_share", [0.4, 0.6])
def test_a_patch_has_the_depth_of_most_of_its_samples(near_share: float) -> None:
    frame_grid = patch_grid(120, 160, View(FOCAL, (79.5, 59.5)))
    near = np.zeros((64, frame_grid.rows, frame_grid.columns), bool)
    near[: round(64 * near_share)] = True
    depth = np.where(near, 1.0, 3.0)
    planes = patch_planes(depth / frame_grid.cosine, np.ones_like(near), frame_grid)
    np.testing.assert_array_equal(planes.on_plane, near == (near_share > 0.5))
    np.testing.assert_allclose(planes.surfaces.range_m * frame_grid.ray[2], 1.0 if near_share > 0.5 else 3.0)


def test_samples_within_a_tenth_of_the_median_inverse_depth_are_on_the_plane() -> None:
    frame_grid = patch_grid(120, 160, View(FOCAL, (79.5, 59.5)))
    inverse = np.full((64, frame_grid.rows, frame_grid.columns), 0.5)
    inverse[:4] *= np.array([1.09, 1.11, 0.91, 0.89])[:, None, None]
    planes = patch_planes(1.0 / (inverse * frame_grid.cosine), np.ones(inverse.shape, bool), frame_grid)
    assert planes.on_plane[:6, 3, 4].tolist() == [True, False, True, False, True, True]


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("stride", [1, 2])
def test_a_step_tilts_a_plane_unless_it_is_to_be_fitted_over_steps(upright: bool, noise: float, stride: int) -> None:
    """Two boards that face the camera, one 6 % nearer: each patch sees both, and no surface that is tilted."""
    height, width = 120 * stride, 160 * stride
    frame_grid = patch_grid(height, width, View(FOCAL * stride, (width / 2 - 0.5, height / 2 - 0.5)))
    assert (frame_grid.side, frame_grid.stride) == (8 * stride, stride)
    place = np.mgrid[:height, :width][int(upright)] // stride % 8
    depth = np.where(place < 5, 2.0, 1.88) * (1 + noise * np.random.default_rng(0).normal(size=(height, width)))
    range_m = frame_grid.samples(depth) / frame_grid.cosine
    seen = np.ones(range_m.shape, bool)
    forward = [-patch_planes(range_m, seen, frame_grid, over_steps=over).surfaces.normal[2] for over in (False, True)]
    assert forward[0].max() < 0.85
    assert forward[1].min() > 0.99


def test_planes_without_steps_are_the_same_over_steps() -> None:
    rng = np.random.default_rng(1)
    noisy = grid().samples(tilted() * (1 + 0.004 * rng.normal(size=(HEIGHT, WIDTH))))
    seen = noisy > 0
    plain, over = (patch_planes(np.where(seen, noisy, 1.0), seen, grid(), over_steps=steps) for steps in (False, True))
    np.testing.assert_array_equal(over.surfaces.normal, plain.surfaces.normal)


def test_few_pairs_of_samples_tell_no_step() -> None:
    """Of 6 × 2 samples, the last row is nearer."""
    frame_grid = patch_grid(120, 160, View(FOCAL, (79.5, 59.5)))
    row, column = np.divmod(np.arange(64), 8)
    seen = np.zeros((64, frame_grid.rows, frame_grid.columns), bool)
    seen[(row > 1) & (column < 2)] = True
    depth = np.where(row < 7, 2.0, 1.88)[:, None, None]
    range_m = depth / frame_grid.cosine
    plain, over = (patch_planes(range_m, seen, frame_grid, over_steps=steps) for steps in (False, True))
    np.testing.assert_array_equal(over.surfaces.normal, plain.surfaces.normal)


@pytest.mark.parametrize(("missing", "told"), [(0, True), (1, False)])
def test_twelve_pairs_of_samples_tell_a_step(missing: int, told: bool) -> None:
    """Three columns of six samples have 12 pairs across; without a corner they have 11."""
    frame_grid = patch_grid(120, 160, View(FOCAL, (79.5, 59.5)))
    row, column = np.divmod(np.arange(64), 8)
    seen = np.zeros((64, frame_grid.rows, frame_grid.columns), bool)
    seen[(row < 6) & (column < 3) & (row + column >= missing)] = True
    range_m = np.where(row < 4, 2.0, 1.88)[:, None, None] / frame_grid.cosine
    forward = -patch_planes(range_m, seen, frame_grid, over_steps=True).surfaces.normal[2]
    assert (forward.min() > 0.99) == told
    assert (forward.max() < 0.85) != told


def test_the_cosine_of_grazing_surfaces_has_a_lower_limit() -> None:
    """The cosine of incidence is at least .08, so that areas and albedos have bounds."""
    frame_grid = patch_grid(120, 160, View(400.0, (79.5, 59.5)))
    _, x = np.mgrid[:120, :160].astype(float)
    depth = 2.0 / (1.0 + 60.0 * ((x - 79.5) / 400.0 + 0.21))
    planes = patch_planes(
        frame_grid.samples(depth) / frame_grid.cosine, np.ones(frame_grid.cosine.shape, bool), frame_grid
    )
    assert planes.surfaces.cosine.min() == 0.08


def test_pieces_whose_rays_do_not_meet_the_plane_of_the_border_are_left_out() -> None:
    """The wall z = 2 + 4·x recedes to the right. Rays beyond x = z/4 miss it, and grazing rays count as missing it."""
    frame_grid = patch_grid(120, 160, View(400.0, (79.5, 59.5)))
    normal = np.zeros_like(frame_grid.ray)
    normal[0], normal[2] = 4.0 / np.sqrt(17.0), -1.0 / np.sqrt(17.0)
    range_m = 2.0 / np.maximum(frame_grid.ray[2] - 4.0 * frame_grid.ray[0], 0.1)
    wall = Surfaces(
        range_m, normal, frame_grid.ray, -(normal * frame_grid.ray).sum(0), np.ones(frame_grid.ray.shape[1:])
    )
    found = surfaces_beyond(wall, np.ones(frame_grid.ray.shape[1:], bool), frame_grid)
    assert (found.cosine > 0.08).all()
    point = found.ray * found.range_m
    np.testing.assert_allclose(point[2] - 4.0 * point[0], 2.0, rtol=1e-6)
    assert (found.ray[0] / found.ray[2] < 0.25).all()
    assert (found.ray[0] < 0).any()
    assert (found.ray[0] / found.ray[2] > 0.12).any()
