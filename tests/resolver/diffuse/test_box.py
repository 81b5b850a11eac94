"""The box that a view lies in: walls that are seen, walls that are not, and what rays meet."""

import numpy as np

from cadtof_cli.resolver.diffuse.box import BEHIND_M, NEAREST_M, Box, unseen_walls
from cadtof_cli.resolver.diffuse.planes import Surfaces
from tests.support.diffuse_frames import F

YAW, PITCH = np.radians(25.0), np.radians(12.0)


def turned() -> F:
    """Directions of the room (right, down, far), rows, as a camera sees them that looks to the left and up."""
    yaw = np.array([[np.cos(YAW), 0, np.sin(YAW)], [0, 1, 0], [-np.sin(YAW), 0, np.cos(YAW)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(PITCH), np.sin(PITCH)], [0, -np.sin(PITCH), np.cos(PITCH)]])
    return np.asarray((pitch @ yaw).T)


def view_of_a_room(walls_m: F, axes: F, across: float = 0.6, down: float = 0.45) -> Surfaces:
    """What a camera sees of a room with walls at these distances along ±`axes`: right, down, far, left, up, near."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-across, across, 20), np.linspace(-down, down, 15)))
    ray = np.stack([x, y, np.ones_like(x)])
    ray /= np.linalg.norm(ray, axis=0)
    outward = np.concatenate([axes, -axes])
    towards = outward @ ray
    way = np.where(towards > 0, walls_m[:, None] / np.where(towards > 0, towards, 1), np.inf)
    wall = way.argmin(0)
    normal = -outward[wall].T
    cosine = -(normal * ray).sum(0)
    return Surfaces(way.min(0), normal, ray, cosine, np.ones_like(cosine))


def distances(box: Box, axes: F) -> F:
    """The box's distances along ±axes, in that order."""
    outward = np.concatenate([axes, -axes])
    return np.asarray([box.distance_m[(box.outward @ direction).argmax()] for direction in outward])


def test_walls_that_are_seen_need_no_guess() -> None:
    walls = np.array([1.6, 1.2, 3.5, 1.4, 1.1, 2.0])
    found = unseen_walls(view_of_a_room(walls, turned()))
    np.testing.assert_allclose(found.outward @ found.outward.T, np.kron([[1, -1], [-1, 1]], np.eye(3)), atol=1e-12)
    guessed = np.isfinite(distances(found, turned()))
    np.testing.assert_array_equal(guessed, [True, True, False, False, False, True])


def test_walls_that_are_not_seen_are_guessed_behind_the_outermost_surfaces() -> None:
    """One wall 2 m before the camera: all that is known of the room is that it holds what is seen, and the camera."""
    walls = np.array([9.0, 9.0, 2.0, 9.0, 9.0, 9.0])
    found = distances(unseen_walls(view_of_a_room(walls, np.eye(3))), np.eye(3))
    assert found[2] == np.inf
    assert found[5] == NEAREST_M
    np.testing.assert_allclose(found[[0, 3]], 1.2 + BEHIND_M, rtol=0.1)
    np.testing.assert_allclose(found[[1, 4]], 0.9 + BEHIND_M, rtol=0.1)


def test_a_few_wrong_patches_make_no_wall_unseen() -> None:
    rng = np.random.default_rng(3)
    clean = view_of_a_room(np.array([1.6, 1.2, 3.5, 1.4, 1.1, 2.0]), turned())
    wrong = rng.choice(300, 4, replace=False)
    normal, range_m = clean.normal.copy(), clean.range_m.copy()
    direction = rng.normal(size=(3, 4))
    normal[:, wrong] = direction / np.linalg.norm(direction, axis=0)
    range_m[wrong] = 5.9
    spoilt = unseen_walls(Surfaces(range_m, normal, clean.ray, clean.cosine, clean.area_m2))
    guessed = np.isfinite(distances(spoilt, turned()))
    np.testing.assert_array_equal(guessed, [True, True, False, False, False, True])


def test_rays_meet_the_first_wall() -> None:
    box = Box(np.concatenate([np.eye(3), -np.eye(3)]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    ray = np.array([[1.0, 0.0, 0.0, -1.0, 0.6], [0.0, 0.6, 0.0, 0.0, 0.0], [0.0, 0.8, -1.0, 0.0, 0.8]])
    distance, normal = box.meet(ray)
    np.testing.assert_allclose(distance, [1.0, 2.0 / 0.6, 6.0, 4.0, 1.0 / 0.6])
    np.testing.assert_allclose(normal.T, [[-1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0]], atol=1e-12)
