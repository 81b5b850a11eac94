"""Rays in a furnished room; the reference intersects each ray with each solid in double precision, one by one."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.rooms.solids import Ball, Box, Interior, Patch

BOXES = (
    Box(centre_m=(1.0, 2.1, 2.0), half_m=(0.3, 0.4, 0.2), turn_rad=0.4, albedo=0.31),
    Box(centre_m=(1.5, 2.2, 2.3), half_m=(0.2, 0.3, 0.5), turn_rad=-0.7, albedo=0.32),
    Box(centre_m=(3.2, 1.9, 4.0), half_m=(0.4, 0.6, 0.3), turn_rad=2.2, albedo=0.33),
    Box(centre_m=(0.6, 2.3, 4.3), half_m=(0.25, 0.2, 0.6), albedo=0.34),
)

BALLS = (
    Ball(centre_m=(3.0, 2.2, 1.5), radius_m=0.3, albedo=0.41),
    Ball(centre_m=(2.2, 2.0, 4.2), radius_m=0.45, albedo=0.42),
)

WALLS = (0.11, 0.12, 0.13, 0.14, 0.15, 0.16)

SIZE = (4.0, 2.5, 5.0)

ROOM = Interior(size_m=SIZE, albedos=WALLS, boxes=BOXES, balls=BALLS)

INSIDE = ((2.0, 1.0, 0.5), (0.3, 0.4, 4.7), (3.8, 2.4, 2.8), (1.5, 1.6, 1.95), (0.05, 0.03, 0.04))
"""Origins of rays. The fourth is above furniture, nearer to it than it is wide; the last is in the corner (0, 0, 0)."""


def rays(origin: tuple[float, float, float], count: int, seed: int) -> tuple[Float32, Float32]:
    """Return rays from one place to all sides; two thirds of them go near some solid."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((3, count))
    centres = np.array([solid.centre_m for solid in (*BOXES, *BALLS)])[rng.integers(6, size=count)].T
    aimed = centres - np.array(origin)[:, None] + 0.4 * directions
    directions = np.where(rng.random(count) < 2 / 3, aimed, directions)
    directions /= np.linalg.norm(directions, axis=0)
    return np.repeat(np.array(origin)[:, None], count, axis=1).astype(np.float32), directions.astype(np.float32)


def upright_turn(angle: float) -> Float:
    """Return the rotation from the axes of a box to those of the room: x turns towards z."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def into_box(box: Box, origin: Float, direction: Float) -> tuple[float, Float]:
    """Return how far a ray goes until it enters a box, and the normal there; inf if it misses the box."""
    turn = upright_turn(box.turn_rad)
    start, way = turn.T @ (origin - box.centre_m), turn.T @ direction
    near, far, normal = -math.inf, math.inf, np.zeros(3)
    for axis in range(3):
        ends = sorted((side * box.half_m[axis] - start[axis]) / way[axis] for side in (-1.0, 1.0))
        if ends[0] > near:
            near, normal = ends[0], -np.sign(way[axis]) * turn[:, axis]
        far = min(far, ends[1])
    return (near, normal) if 0.0 < near < far else (math.inf, normal)


def into_ball(ball: Ball, origin: Float, direction: Float) -> tuple[float, Float]:
    start = origin - np.asarray(ball.centre_m)
    roots = np.roots([direction @ direction, 2.0 * start @ direction, start @ start - ball.radius_m**2])
    if np.iscomplex(roots).any() or roots.real.min() <= 0.0:
        return math.inf, np.zeros(3)
    way = float(roots.real.min())
    return way, (start + way * direction) / ball.radius_m


def to_wall(origin: Float, direction: Float) -> tuple[float, int]:
    """Return how far a ray goes from inside the room to its walls, and the number of the wall that it meets."""
    found = []
    for axis in range(3):
        for side, at in enumerate((0.0, SIZE[axis])):
            way = (at - origin[axis]) / direction[axis]
            if way > 1e-6:
                found.append((float(way), 2 * axis + side))
    return min(found)


@pytest.mark.parametrize("origin", INSIDE)
def test_a_ray_meets_the_first_of_all_surfaces(origin: tuple[float, float, float]) -> None:
    starts, directions = rays(origin, 1500, 3)
    meetings = ROOM.meet(starts, directions)
    numbers_met = set()
    for ray in range(1500):
        start, way = starts[:, ray].astype(float), directions[:, ray].astype(float)
        wall, face = to_wall(start, way)
        inward = np.zeros(3)
        inward[face // 2] = 1.0 if face % 2 == 0 else -1.0
        candidates = [(wall, WALLS[face], inward, 0)]
        for number, solid in enumerate(ROOM.solids, start=1):
            entry, normal = into_box(solid, start, way) if isinstance(solid, Box) else into_ball(solid, start, way)
            candidates.append((entry, solid.albedo, normal, number))
        length, albedo, normal, number = min(candidates, key=lambda one: one[0])
        numbers_met.add(number)
        assert meetings.lengths_m[ray] == pytest.approx(length, rel=1e-4)
        assert meetings.albedo[ray] == pytest.approx(albedo)
        assert_allclose(meetings.normals[:, ray], normal, atol=2e-3)
        assert_allclose(meetings.points_m[:, ray], start + length * way, atol=1e-3)
        assert meetings.surface[ray] // 8 == number
    assert len(numbers_met) >= 5


def test_rays_beyond_the_first_batch_meet_the_same_surfaces() -> None:
    starts, directions = rays(INSIDE[0], 40_000, 5)
    whole, last = ROOM.meet(starts, directions), ROOM.meet(starts[:, 33_000:], directions[:, 33_000:])
    assert_allclose(whole.lengths_m[33_000:], last.lengths_m)
    assert_allclose(whole.normals[:, 33_000:], last.normals)
    np.testing.assert_array_equal(whole.surface[33_000:], last.surface)
    lengths = np.full(40_000, 2.0, np.float32)
    np.testing.assert_array_equal(
        ROOM.clear(starts, directions, lengths)[33_000:],
        ROOM.clear(starts[:, 33_000:], directions[:, 33_000:], lengths[33_000:]),
    )


@pytest.mark.parametrize("origin", INSIDE)
def test_a_way_is_clear_if_it_enters_no_solid(origin: tuple[float, float, float]) -> None:
    starts, directions = rays(origin, 1200, 4)
    lengths = np.random.default_rng(1).uniform(0.5, 4.0, 1200)
    clear = ROOM.clear(starts, directions, lengths.astype(np.float32))
    for ray in range(1200):
        start, way = starts[:, ray].astype(float), directions[:, ray].astype(float)
        entries = [into_box(box, start, way)[0] for box in BOXES] + [into_ball(ball, start, way)[0] for ball in BALLS]
        if abs(min(entries) - lengths[ray]) > 1e-3:
            assert clear[ray] == (min(entries) > lengths[ray])
    assert 0.03 < (~clear).mean() < 0.95


def test_faces_of_one_solid_have_numbers_of_their_own() -> None:
    starts, directions = rays(INSIDE[0], 20_000, 6)
    meetings = ROOM.meet(starts, directions)
    for number in np.unique(meetings.surface[meetings.surface // 8 <= 4]):
        same = meetings.normals[:, meetings.surface == number]
        assert_allclose(same, np.broadcast_to(same[:, :1], same.shape), atol=1e-6)
    walls = meetings.surface < 8
    for face in range(6):
        at = meetings.points_m[face // 2, walls & (meetings.surface == face)]
        assert_allclose(at, SIZE[face // 2] if face % 2 else 0.0, atol=1e-4)
    for number in (5, 6):
        assert len(np.unique(meetings.surface[meetings.surface // 8 == number])) == 1


def test_solids_behind_and_around_a_ray_are_not_met() -> None:
    ball, box = Ball(centre_m=(0.0, 0.0, 2.0), radius_m=0.5), Box(centre_m=(0.0, 0.0, 2.0), half_m=(0.5, 0.5, 0.5))
    ahead = np.array([[0.0], [0.0], [1.0]], np.float32)
    for solid in (ball, box):
        entries = {z: float(solid.entry(np.array([[0.0], [0.0], [z]], np.float32), ahead)[0]) for z in (0.0, 2.1, 3.0)}
        assert entries == {0.0: pytest.approx(1.5), 2.1: math.inf, 3.0: math.inf}
        aside = np.array([[0.51], [0.0], [0.0]], np.float32)
        assert solid.entry(aside, ahead)[0] == math.inf
        above = np.array([[0.0], [0.51], [0.0]], np.float32)
        assert solid.entry(above, ahead)[0] == math.inf
    assert ball.reach_m == 0.5
    assert box.reach_m == pytest.approx(0.75**0.5)


def test_later_patches_lie_over_earlier_ones_and_their_edges_belong_to_them() -> None:
    low, high = (1.0, 0.0, 1.0), (2.0, 9.0, 3.0)
    rug = Patch(face=3, low_m=low, high_m=high, albedo=0.7)
    mat = Patch(face=3, low_m=(1.5, 0.0, 0.0), high_m=(4.0, 0.0, 2.0), albedo=0.2)
    room = Interior(size_m=SIZE, albedos=WALLS, patches=(rug, mat))
    places = {(1.2, 1.5): 0.7, (1.7, 1.5): 0.2, (1.7, 2.5): 0.7, (3.0, 0.5): 0.2, (0.5, 1.5): 0.14, (1.2, 3.5): 0.14}
    starts = np.array([(x, 1.0, z) for x, z in places], np.float32).T
    down = np.repeat(np.array([[0.0], [1.0], [0.0]], np.float32), len(places), axis=1)
    assert_allclose(room.meet(starts, down).albedo, list(places.values()))
    assert_allclose(room.meet(starts, -down).albedo, 0.13)
    edges = np.array([(1.0, 2.5, 1.0), (2.0, 2.5, 3.0), (0.999, 2.5, 2.0), (1.5, 2.5, 3.001)], np.float32).T
    assert rug.holds(edges).tolist() == [True, True, False, False]


def test_a_room_s_area_is_that_of_its_faces() -> None:
    assert ROOM.area_m2 == pytest.approx(2 * (4.0 * 2.5 + 2.5 * 5.0 + 5.0 * 4.0))
    assert ROOM.solids == (*BOXES, *BALLS)


@pytest.mark.parametrize("albedo", [-0.01, 1.01])
def test_albedos_of_all_that_is_in_a_room_are_checked(albedo: float) -> None:
    half, nothing = (0.1, 0.1, 0.1), (0.0, 0.0, 0.0)
    for part in (
        {"boxes": (Box(centre_m=half, half_m=half, albedo=albedo),)},
        {"balls": (Ball(centre_m=half, radius_m=0.1, albedo=albedo),)},
        {"patches": (Patch(face=0, low_m=nothing, high_m=half, albedo=albedo),)},
    ):
        with pytest.raises(SettingsError, match="albedos: found"):
            Interior(size_m=SIZE, albedos=WALLS, **part)
    with pytest.raises(SettingsError, match="albedos: found"):
        Interior(size_m=SIZE, albedos=(*WALLS[:5], albedo))
    assert Interior(size_m=SIZE, albedos=(0.0, 1.0, 0.0, 1.0, 0.0, 1.0)).albedos[1] == 1.0


def test_the_corners_of_a_large_solid_are_met() -> None:
    """A box with corners 1.6 m from its middle."""
    large = Box(centre_m=(2.0, 1.6, 3.4), half_m=(1.1, 0.5, 1.0), turn_rad=0.3, albedo=0.3)
    room = Interior(size_m=SIZE, albedos=WALLS, boxes=(large,))
    inside = 0.98 * np.array([(x, y, z) for x in (-1.1, 1.1) for y in (-0.5, 0.5) for z in (-1.0, 1.0)]).T
    corners = upright_turn(0.3) @ inside + np.array(large.centre_m)[:, np.newaxis]
    starts = np.repeat(np.array([[2.0], [0.4], [0.2]]), 8, axis=1)
    ways = corners - starts
    directions = (ways / np.linalg.norm(ways, axis=0)).astype(np.float32)
    assert (room.meet(starts.astype(np.float32), directions).surface // 8 == 1).all()
    assert not room.clear(starts.astype(np.float32), directions, np.linalg.norm(ways, axis=0).astype(np.float32)).any()


def test_solids_are_grey_and_not_turned_by_default() -> None:
    """By default half of the light comes back, and a box is not turned."""
    box, ball = Box(centre_m=(2.0, 1.2, 2.5), half_m=(0.5, 0.5, 0.5)), Ball(centre_m=(1.0, 1.2, 4.0), radius_m=0.4)
    room = Interior(size_m=SIZE, albedos=WALLS, boxes=(box,), balls=(ball,))
    starts = np.array([[2.1, 1.0], [1.3, 1.2], [0.5, 0.5]], np.float32)
    ahead = np.repeat(np.array([[0.0], [0.0], [1.0]], np.float32), 2, axis=1)
    meetings = room.meet(starts, ahead)
    assert_allclose(meetings.albedo, 0.5)
    assert_allclose(meetings.normals, [[0.0, 0.0], [0.0, 0.0], [-1.0, -1.0]], atol=1e-6)
    assert_allclose(meetings.lengths_m, [1.5, 3.1], rtol=1e-6)


@dataclass(frozen=True, kw_only=True)
class Watched(Ball):
    """A ball that counts the rays that are intersected with it."""

    followed: list[int]

    def entry(self, origins_m: Float32, directions: Float32) -> Float32:
        self.followed.append(directions.shape[1])
        return Ball.entry(self, origins_m, directions)


@pytest.mark.parametrize("origin", INSIDE)
def test_rays_that_miss_a_solid_by_a_centimetre_are_not_followed_to_it(origin: tuple[float, float, float]) -> None:
    """Rays that go the other way are not followed to it either: a room costs as much as the solids near its rays."""
    ball = Watched(centre_m=(2.6, 1.4, 3.4), radius_m=0.5, followed=[])
    room = Interior(size_m=SIZE, albedos=WALLS, balls=(ball,))
    starts, ways = rays(origin, 12_000, 8)
    to_middle = np.array(ball.centre_m) - np.array(origin)
    along = to_middle @ ways
    missed = np.sqrt(to_middle @ to_middle - along**2)
    room.meet(starts, ways)
    room.clear(starts, ways, np.full(12_000, 1.0, np.float32))
    assert len(ball.followed) == 2
    for followed in ball.followed:
        assert ((missed < 0.5) & (along > 0.0)).sum() <= followed <= ((missed < 0.51) & (along > 0.0)).sum()


def test_a_ray_that_touches_a_ball_meets_it() -> None:
    ball = Ball(centre_m=(0.0, 0.0, 2.0), radius_m=0.5)
    ahead = np.array([[0.0], [0.0], [1.0]], np.float32)
    touching, missing = (np.array([[x], [0.0], [0.0]], np.float32) for x in (0.5, 0.5001))
    assert ball.entry(touching, ahead)[0] == 2.0
    assert ball.entry(missing, ahead)[0] == math.inf


def test_a_ray_meets_the_right_one_of_solids_beside_each_other() -> None:
    """One box stands alone, three stand beside each other; a ray from above goes to each of them."""
    places, albedos = ((0.5, 0.5), (3.0, 4.0), (3.3, 4.0), (3.6, 4.0)), (0.2, 0.4, 0.6, 0.8)
    boxes = tuple(
        Box(centre_m=(x, 2.4, z), half_m=(0.1, 0.1, 0.1), albedo=albedo)
        for (x, z), albedo in zip(places, albedos, strict=True)
    )
    starts = np.array([(x, 1.0, z) for x, z in places], np.float32).T
    down = np.repeat(np.array([[0.0], [1.0], [0.0]], np.float32), len(places), axis=1)
    meetings = Interior(size_m=SIZE, albedos=WALLS, boxes=boxes).meet(starts, down)
    assert_allclose(meetings.albedo, albedos)
    assert (meetings.surface // 8).tolist() == [1, 2, 3, 4]
