"""The box around a view: walls that the view shows, walls that are guessed, and the wall that a ray meets first."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.box import Box, unseen_walls
from cadtof_cli.resolver.diffuse.planes import Surfaces
from tests.support.diffuse_frames import F

YAW, PITCH = np.radians(25.0), np.radians(12.0)


def room_axes() -> F:
    """Return the room's directions right, down and far, as rows, as seen by a camera that looks to the left and up."""
    yaw = np.array([[np.cos(YAW), 0, np.sin(YAW)], [0, 1, 0], [-np.sin(YAW), 0, np.cos(YAW)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(PITCH), np.sin(PITCH)], [0, -np.sin(PITCH), np.cos(PITCH)]])
    return np.asarray((pitch @ yaw).T)


def view_of_a_room(walls_m: F, axes: F, across: float = 0.6, down: float = 0.45) -> Surfaces:
    """Return the surfaces that a camera sees in a room with walls at these distances along ±`axes`.

    The walls are in the order right, down, far, left, up, near.
    """
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
    """Return the distances of the box's walls along +axes, then along −axes."""
    outward = np.concatenate([axes, -axes])
    return np.asarray([box.distance_m[(box.outward @ direction).argmax()] for direction in outward])


def test_walls_that_the_view_shows_are_not_guessed() -> None:
    walls = np.array([1.6, 1.2, 3.5, 1.4, 1.1, 2.0])
    found = unseen_walls(view_of_a_room(walls, room_axes()))
    np.testing.assert_allclose(found.outward @ found.outward.T, np.kron([[1, -1], [-1, 1]], np.eye(3)), atol=1e-12)
    guessed = np.isfinite(distances(found, room_axes()))
    np.testing.assert_array_equal(guessed, [True, True, False, False, False, True])


def test_walls_that_the_view_does_not_show_are_guessed_behind_the_outermost_surfaces() -> None:
    """The view shows only one wall, 2 m away. The room must hold this wall and the camera.

    So walls are guessed 20 cm behind the outermost surfaces that are seen, and at least 70 cm from the camera.
    """
    walls = np.array([9.0, 9.0, 2.0, 9.0, 9.0, 9.0])
    found = distances(unseen_walls(view_of_a_room(walls, np.eye(3))), np.eye(3))
    assert found[2] == np.inf
    assert found[5] == 0.7
    np.testing.assert_allclose(found[[0, 3]], 1.2 + 0.2)
    np.testing.assert_allclose(found[[1, 4]], 0.9 + 0.2)


def test_a_few_wrong_patches_do_not_hide_a_wall() -> None:
    rng = np.random.default_rng(3)
    clean = view_of_a_room(np.array([1.6, 1.2, 3.5, 1.4, 1.1, 2.0]), room_axes())
    outliers = rng.choice(300, 4, replace=False)
    normal, range_m = clean.normal.copy(), clean.range_m.copy()
    direction = rng.normal(size=(3, 4))
    normal[:, outliers] = direction / np.linalg.norm(direction, axis=0)
    range_m[outliers] = 5.9
    found = unseen_walls(Surfaces(range_m, normal, clean.ray, clean.cosine, clean.area_m2))
    guessed = np.isfinite(distances(found, room_axes()))
    np.testing.assert_array_equal(guessed, [True, True, False, False, False, True])


def test_rays_meet_the_first_wall() -> None:
    box = Box(np.concatenate([np.eye(3), -np.eye(3)]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    ray = np.array([[1.0, 0.0, 0.0, -1.0, 0.6], [0.0, 0.6, 0.0, 0.0, 0.0], [0.0, 0.8, -1.0, 0.0, 0.8]])
    distance, normal = box.meet(ray)
    np.testing.assert_allclose(distance, [1.0, 2.0 / 0.6, 6.0, 4.0, 1.0 / 0.6])
    np.testing.assert_allclose(normal.T, [[-1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0]], atol=1e-12)


def patches(*groups: tuple[F, tuple[float, float, float]]) -> Surfaces:
    """Return patches from groups of positions, (n, 3), each with the direction that points out of the room there."""
    place = np.concatenate([group for group, _ in groups]).T
    outward = np.concatenate([np.tile(direction, (len(group), 1)) for group, direction in groups]).T
    range_m = np.linalg.norm(place, axis=0)
    ray = place / range_m
    outward = outward / np.linalg.norm(outward, axis=0)
    return Surfaces(range_m, -outward, ray, (outward * ray).sum(0), np.ones_like(range_m))


def far_wall(count: int, half_width_m: float = 1.0) -> tuple[F, tuple[float, float, float]]:
    """Return patches side by side on a wall 3 m away, from −half_width_m to half_width_m; the wall is 1 m high."""
    x = np.linspace(-half_width_m, half_width_m, count)
    return np.stack([x, 0.5 * np.cos(np.arange(count) * np.pi), np.full(count, 3.0)], axis=1), (0.0, 0.0, 1.0)


def positions_at_right(count: int, x_m: float) -> F:
    """Return positions one behind another, `x_m` to the right."""
    return np.stack([np.full(count, x_m), np.zeros(count), np.linspace(1.5, 2.5, count)], axis=1)


def turned_right(degrees: float) -> tuple[float, float, float]:
    """Return the direction that is turned to the right by this angle from straight ahead."""
    return float(np.sin(np.radians(degrees))), 0.0, float(np.cos(np.radians(degrees)))


def has_wall_towards(box: Box, direction: tuple[float, float, float]) -> bool:
    """Return whether a wall of the box lies in this direction, within .1°."""
    unit = np.array(direction) / np.linalg.norm(direction)
    return bool((box.outward @ unit).max() > np.cos(np.radians(0.1)))


@pytest.mark.parametrize(("angle_deg", "is_one_direction"), [(13.0, True), (15.0, False)])
def test_normals_up_to_fourteen_degrees_apart_are_one_direction(angle_deg: float, is_one_direction: bool) -> None:
    """Sixty patches face one way and forty another. The box has their mean direction, or that of the sixty."""
    box = unseen_walls(patches(far_wall(60), (far_wall(40)[0], turned_right(angle_deg))))
    x, _, z = turned_right(angle_deg)
    mean = 0.4 * x, 0.0, 0.6 + 0.4 * z
    assert has_wall_towards(box, mean) is is_one_direction
    assert has_wall_towards(box, (0.0, 0.0, 1.0)) is not is_one_direction


@pytest.mark.parametrize(("count", "second"), [(4, False), (5, True)])
def test_more_than_four_in_a_hundred_patches_make_a_second_direction(count: int, second: bool) -> None:
    """The second direction is that of a wall at the right that leans by 30°. Without it, the camera counts as level."""
    slant = (np.cos(np.radians(30.0)), np.sin(np.radians(30.0)), 0.0)
    box = unseen_walls(patches(far_wall(100 - count), (positions_at_right(count, 1.0), slant)))
    assert has_wall_towards(box, slant) is second
    assert has_wall_towards(box, (1.0, 0.0, 0.0)) is not second


@pytest.mark.parametrize(("angle", "second"), [(74.0, False), (76.0, True)])
def test_a_second_direction_is_within_fifteen_degrees_of_a_right_angle_to_the_first(angle: float, second: bool) -> None:
    """The second direction is then turned to a right angle with the first."""
    rise = float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))
    slant = (0.6 * rise[1], 0.8 * rise[1], rise[0])
    box = unseen_walls(patches(far_wall(80), (positions_at_right(20, 1.0), slant)))
    assert has_wall_towards(box, (0.6, 0.8, 0.0)) is second
    assert has_wall_towards(box, (1.0, 0.0, 0.0)) is not second
    np.testing.assert_allclose(box.outward[:3] @ box.outward[:3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("degrees", "level"), [(13.0, (0.0, 0.0, 1.0)), (15.0, (1.0, 0.0, 0.0))])
def test_if_only_one_wall_is_seen_the_camera_counts_as_level(degrees: float, level: tuple[float, float, float]) -> None:
    """The second direction is the camera's horizontal, or straight ahead if the wall's normal is nearly horizontal."""
    sine = float(np.sin(np.radians(degrees)))
    normal = (float(np.cos(np.radians(degrees))), 0.6 * sine, 0.8 * sine)
    box = unseen_walls(patches((positions_at_right(100, 1.2), normal)))
    second = np.array(level) - np.dot(level, normal) * np.array(normal)
    assert has_wall_towards(box, normal)
    assert has_wall_towards(box, (float(second[0]), float(second[1]), float(second[2])))


def right_wall(box: Box) -> float:
    return float(box.distance_m[(box.outward @ np.array([1.0, 0.0, 0.0])).argmax()])


@pytest.mark.parametrize(("count", "seen"), [(4, False), (5, True)])
def test_a_wall_is_seen_by_more_than_two_in_a_hundred_patches(count: int, seen: bool) -> None:
    box = unseen_walls(
        patches(
            far_wall(200 - count - 8, 1.5),
            (positions_at_right(8, 1.5), (0.0, 1.0, 0.0)),
            (positions_at_right(count, 1.5), (1.0, 0.0, 0.0)),
        )
    )
    assert right_wall(box) == (np.inf if seen else pytest.approx(1.7))


@pytest.mark.parametrize(("outliers", "is_behind_outliers"), [(4, False), (5, True)])
def test_a_wall_lies_behind_ninety_eight_in_a_hundred_patches(outliers: int, is_behind_outliers: bool) -> None:
    box = unseen_walls(patches(far_wall(200 - outliers, 1.5), (positions_at_right(outliers, 2.5), (0.0, 0.0, 1.0))))
    assert right_wall(box) == pytest.approx(2.7 if is_behind_outliers else 1.7, abs=0.02)


@pytest.mark.parametrize(("degrees", "seen"), [(64.0, False), (66.0, True)])
def test_patches_of_a_wall_face_it_within_twenty_six_degrees(degrees: float, seen: bool) -> None:
    box = unseen_walls(patches(far_wall(170, 1.5), (positions_at_right(10, 1.5), turned_right(degrees))))
    assert has_wall_towards(box, (1.0, 0.0, 0.0))
    assert np.isinf(right_wall(box)) == seen


@pytest.mark.parametrize(
    ("outermost_m", "wall_m", "seen"), [(1.5, 1.36, True), (1.5, 1.34, False), (0.4, 0.34, True), (0.4, 0.32, False)]
)
def test_patches_lie_on_a_wall_within_a_tenth_of_its_distance(outermost_m: float, wall_m: float, seen: bool) -> None:
    """For walls nearer than 70 cm, the limit is a tenth of 70 cm."""
    outermost = positions_at_right(8, outermost_m), (0.0, 0.0, 1.0)
    box = unseen_walls(
        patches(far_wall(180, outermost_m), outermost, (positions_at_right(12, wall_m), (1.0, 0.0, 0.0)))
    )
    assert np.isinf(right_wall(box)) == seen


def test_walls_that_face_each_other_are_one_direction() -> None:
    """The two sides of a corridor have 30 patches each, and its end has 45.

    So the sides set the first direction, and the direction of the end, which leans by 10°, is turned to a right angle.
    """
    sides = [(positions_at_right(30, side), (side, 0.0, 0.0)) for side in (1.2, -1.2)]
    box = unseen_walls(patches((far_wall(45)[0], turned_right(10.0)), *sides))
    assert has_wall_towards(box, (1.0, 0.0, 0.0))
    assert has_wall_towards(box, (0.0, 0.0, 1.0))
