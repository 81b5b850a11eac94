"""Rays meet solids where rectangles, intersected one by one, and geometry by hand say that they do."""

import math

import numpy as np
import pytest

from cadtof_cli.arrays import Float32
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.geometry import Surface
from cadtof_cli.simulation.scene.rooms.solids import Ball, Box, Interior, Patch

BOX = Box(centre_m=(2.2, 1.9, 2.5), half_m=(0.5, 0.4, 0.3), turn_rad=0.6, albedo=0.3)
ALBEDOS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
ROOM = Interior(size_m=(4.0, 2.5, 5.0), albedos=ALBEDOS, boxes=(BOX,))


def rays(count: int, seed: int = 0) -> tuple[Float32, Float32]:
    generator = np.random.default_rng(seed)
    directions = generator.standard_normal((3, count))
    starts = np.repeat(np.array([[1.0], [1.2], [0.7]]), count, axis=1)
    return starts.astype(np.float32), (directions / np.linalg.norm(directions, axis=0)).astype(np.float32)


def towards(*direction: float) -> Float32:
    vector = np.array(direction, np.float32)[:, None]
    return np.asarray(vector / np.linalg.norm(vector))


def sides_of(box: Box) -> list[Surface]:
    """Return the six sides of a box as rectangles."""
    cosine, sine = math.cos(box.turn_rad), math.sin(box.turn_rad)
    axes = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    sides = []
    for axis in range(3):
        u, v = ((axis + step) % 3 for step in (1, 2))
        for sign in (-1.0, 1.0):
            origin = np.asarray(box.centre_m) + sign * box.half_m[axis] * axes[axis]
            extents = (-box.half_m[u], box.half_m[u], -box.half_m[v], box.half_m[v])
            sides.append(
                Surface(origin_m=tuple(origin), across=tuple(axes[u]), along=tuple(axes[v]), extents_m=extents)
            )
    return sides


def test_rays_meet_a_box_where_they_meet_its_six_rectangles() -> None:
    starts, directions = rays(20_000)
    shell = Box(centre_m=(2.0, 1.25, 2.5), half_m=(2.0, 1.25, 2.5))
    surfaces = [*sides_of(shell), *sides_of(BOX)]
    lengths = np.stack([side.distances(starts.astype(float), directions.astype(float)) for side in surfaces])
    meetings = ROOM.meet(starts, directions)
    np.testing.assert_allclose(meetings.lengths_m, lengths.min(axis=0), rtol=2e-5)
    nearest = np.argmin(lengths, axis=0)
    normals = np.array([side.normal for side in surfaces])[nearest].T
    np.testing.assert_allclose(np.abs((meetings.normals * normals).sum(axis=0)), 1.0, atol=1e-5)
    assert ((meetings.normals * directions).sum(axis=0) < 0).all()
    assert (nearest >= 6).mean() > 0.005
    np.testing.assert_allclose(meetings.albedo, np.where(nearest < 6, np.array(ALBEDOS)[nearest % 6], 0.3), rtol=1e-6)


def test_surfaces_have_numbers_of_their_own() -> None:
    starts, directions = rays(20_000)
    meetings = ROOM.meet(starts, directions)
    for number in np.unique(meetings.surface):
        same = meetings.normals[:, meetings.surface == number]
        np.testing.assert_allclose(same, np.repeat(same[:, :1], same.shape[1], axis=1), atol=1e-6)
    assert len(np.unique(meetings.surface)) >= 8


def test_a_ball_is_met_where_geometry_says() -> None:
    room = Interior(size_m=(4.0, 2.5, 5.0), albedos=ALBEDOS, balls=(Ball(centre_m=(1.0, 1.2, 3.0), radius_m=0.5),))
    meetings = room.meet(np.array([[1.0], [1.2], [0.7]], np.float32), towards(0.0, 0.0, 1.0))
    assert meetings.lengths_m[0] == pytest.approx(1.8)
    np.testing.assert_allclose(meetings.normals[:, 0], [0.0, 0.0, -1.0], atol=1e-6)
    beside = room.meet(np.array([[1.0], [1.2], [0.7]], np.float32), towards(0.53 / 2.3, 0.0, 1.0))
    assert beside.lengths_m[0] > 3.0


def test_a_way_is_clear_up_to_the_solid_and_not_beyond() -> None:
    start, direction = np.array([[2.2], [1.9], [0.5]], np.float32), towards(0.0, 0.0, 1.0)
    reach = float(ROOM.meet(start, direction).lengths_m[0])
    assert ROOM.clear(start, direction, np.array([reach - 0.01], np.float32))[0]
    assert not ROOM.clear(start, direction, np.array([reach + 0.01], np.float32))[0]


def test_patches_change_the_albedo_of_their_part_of_a_wall() -> None:
    door = Patch(face=5, low_m=(1.0, 0.5, 0.0), high_m=(2.0, 2.5, 0.0), albedo=0.0)
    room = Interior(size_m=(4.0, 2.5, 5.0), albedos=ALBEDOS, patches=(door,))
    starts = np.array([[1.5, 2.5, 1.5], [1.2, 1.2, 0.4], [1.0, 1.0, 1.0]], np.float32)
    meetings = room.meet(starts, np.repeat(towards(0.0, 0.0, 1.0), 3, axis=1))
    np.testing.assert_allclose(meetings.albedo, [0.0, 0.6, 0.6], rtol=1e-6)


@pytest.mark.parametrize("size_m", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1000.0), (1.0, math.nan, 1.0)])
def test_a_room_without_an_extent_is_refused(size_m: tuple[float, float, float]) -> None:
    with pytest.raises(SettingsError, match="room: found"):
        Interior(size_m=size_m, albedos=(0.5,) * 6)
