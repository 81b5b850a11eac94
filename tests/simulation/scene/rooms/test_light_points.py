"""Where the lamp's light goes: points that it reaches directly, points after surfaces, and directions of its rays."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.simulation.scene.rooms.directions import cosine_weighted, evenly_spread_pairs
from cadtof_cli.simulation.scene.rooms.lamp import Lamp, LampLight, lamp_light
from cadtof_cli.simulation.scene.rooms.solids import Interior

ALBEDO, RAYS = 0.6, 6000

ROOM = Interior(size_m=(3.0, 2.5, 4.0), albedos=(ALBEDO,) * 6)

LAMP = Lamp(position_m=(1.4, 1.2, 0.6), axis=(0.0, 0.0, 1.0), beam_rad=0.9)


def known(room: Interior = ROOM) -> LampLight:
    return lamp_light(room, LAMP, np.random.default_rng(2), RAYS)


def test_first_points_are_those_that_the_lamp_lights() -> None:
    first = known().first
    assert first.points_m.shape == (3, RAYS)
    way = np.linalg.norm(first.points_m - np.array(LAMP.position_m)[:, np.newaxis], axis=0)
    assert_allclose(first.lengths_m, way, rtol=1e-5)
    lit = LAMP.irradiance(ROOM, first.points_m, first.normals)
    assert_allclose(first.density, lit / LAMP.flux, rtol=1e-5)
    assert first.flux == LAMP.flux
    assert_allclose(first.albedo, ALBEDO)


def test_later_points_share_the_light_that_surfaces_give_back() -> None:
    """A ray goes on with probability ρ, the albedo: it has ρ/(1 − ρ) later points on average, each with equal light."""
    found = known()
    later = found.later
    count = len(later.albedo)
    assert count == pytest.approx(RAYS * ALBEDO / (1.0 - ALBEDO), rel=0.06)
    assert later.flux == pytest.approx(LAMP.flux * count / RAYS)
    even = 8.0 / (2.0 * (3.0 * 2.5 + 2.5 * 4.0 + 4.0 * 3.0))
    assert_allclose(later.density, even, rtol=1e-6)
    assert found.later_density == pytest.approx(even, rel=1e-6)
    inside = (later.points_m > -1e-3) & (later.points_m < np.array(ROOM.size_m)[:, np.newaxis] + 1e-3)
    assert inside.all()


def test_later_points_of_a_ray_follow_each_other_by_the_way_between_them() -> None:
    """At each point a ray goes on with the probability of the albedo; when it ends, the points of another ray begin."""
    later = known().later
    way = np.linalg.norm(np.diff(later.points_m, axis=1), axis=0)
    follows = np.abs(np.diff(later.lengths_m) - way) < 2e-3
    assert follows.mean() == pytest.approx(ALBEDO, abs=0.03)
    begins = np.concatenate([[True], ~follows])
    assert np.median(later.lengths_m[begins]) < np.median(later.lengths_m[~begins])
    shortest = known().first.lengths_m.min()
    assert (later.lengths_m[begins] > shortest).all()


def test_a_black_room_gives_nothing_on() -> None:
    later = known(Interior(size_m=(3.0, 2.5, 4.0), albedos=(0.0,) * 6)).later
    assert (later.flux, later.albedo.size, later.points_m.shape) == (0.0, 0, (3, 0))


def test_any_consecutive_pairs_are_spread_evenly() -> None:
    for part in (slice(0, 400), slice(137, 537)):
        first, second = (values[part] for values in evenly_spread_pairs(600))
        counts, _, _ = np.histogram2d(first, second, bins=5, range=[[0.0, 1.0], [0.0, 1.0]])
        assert np.abs(counts - 16.0).max() <= 4.0
        assert ((first >= 0.0) & (first < 1.0) & (second >= 0.0) & (second < 1.0)).all()


def test_directions_about_a_normal_have_the_density_of_the_cosine() -> None:
    """The mean cosine is 2/3, the mean of its square 1/2, and no direction across the normal is favoured."""
    first, second = (values.astype(np.float32) for values in evenly_spread_pairs(20_000))
    x, y, z = cosine_weighted(first, second).astype(np.float64)
    assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-5)
    assert z.min() > 0.0
    assert (z.mean(), (z * z).mean()) == pytest.approx((2 / 3, 1 / 2), abs=2e-3)
    assert (x.mean(), y.mean(), (x * y).mean()) == pytest.approx((0.0, 0.0, 0.0), abs=3e-3)
    counts, _ = np.histogram(np.arctan2(y, x), bins=8, range=(-math.pi, math.pi))
    assert_allclose(counts, 2500, rtol=0.03)
