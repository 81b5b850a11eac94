"""Interreflections inside a sphere: form factors are the same between all points, and all is known in closed form."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.planes import Surfaces
from cadtof_cli.resolver.diffuse.radiosity import LATER_ALBEDO, LATER_BOUNCES, interreflections, light_of
from tests.support.diffuse_frames import C_M_PER_NS, OMEGA, F

RADIUS = 2.0
POINTS = 600


def sphere(points: int = POINTS) -> Surfaces:
    i = np.arange(points) + 0.5
    z, turn = 1 - 2 * i / points, np.pi * (1 + 5**0.5) * i
    ray = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    ones = np.ones(points)
    return Surfaces(RADIUS * ones, -ray, ray, ones, ones * 4 * np.pi * RADIUS**2 / points)


def nothing() -> Surfaces:
    return Surfaces(np.empty(0), np.empty((3, 0)), np.empty((3, 0)), np.empty(0), np.empty(0))


def second_bounce(h: int) -> complex:
    """Σ F·exp(ihω r/c) over distances r, whose density over a sphere seen from one of its points is r/(2R²)."""
    r = np.linspace(0, 2 * RADIUS, 200_001)
    return complex(np.trapezoid(r / (2 * RADIUS**2) * np.exp(1j * h * OMEGA * r / C_M_PER_NS), r))


@pytest.mark.parametrize("h", [1, 2, 3])
def test_light_inside_a_sphere(h: int) -> None:
    light = interreflections(
        sphere(), nothing(), np.full(POINTS, 0.3), harmonics=(1, 2, 3), rad_per_m=OMEGA / C_M_PER_NS
    )
    second = second_bounce(h)
    later = sum(LATER_ALBEDO ** (n - 1) * second ** (n + 1) for n in range(1, LATER_BOUNCES + 1))
    np.testing.assert_allclose(light.seen[h - 1].mean(), second, rtol=0.02, atol=0.005)
    np.testing.assert_allclose(light.seen[h - 1], second, atol=0.02)
    np.testing.assert_allclose(light.later[h - 1].mean(), later, rtol=0.03, atol=0.01)


def test_brighter_walls_give_more_light() -> None:
    amplitude: F = np.full(POINTS, 0.3)
    half = sphere().ray[2] > 0
    amplitude[half] *= 0.5
    light = interreflections(sphere(), nothing(), amplitude, harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.seen[0].real, 1.0, rtol=0.02)
    near, far = sphere().ray[2] > 0.9, sphere().ray[2] < -0.9
    assert light.seen[0][near].real.mean() == pytest.approx(light.seen[0][far].real.mean(), rel=0.02)


def test_surfaces_that_face_away_give_none() -> None:
    wall = sphere()
    outside = Surfaces(wall.range_m, wall.ray, wall.ray, wall.cosine, wall.area_m2)
    light = interreflections(outside, nothing(), np.full(POINTS, 0.3), harmonics=(1, 2), rad_per_m=1.0)
    assert np.abs(light.seen).max() == 0.0
    assert np.abs(light.later).max() == 0.0


@pytest.mark.parametrize("distance_m", [0.5, 1.0, 2.0])
def test_light_of_one_piece_is_that_of_two_pieces_that_face_each_other(distance_m: float) -> None:
    """A small piece A at (0, 0, 2) m and one beside the axis that looks at it: E·F·exp(iω(d_s + r − d)/c) over E of A."""
    wall = Surfaces(
        np.array([2.0]), np.array([[0.6], [0.0], [-0.8]]), np.array([[0.0], [0.0], [1.0]]), np.array([0.8]), np.ones(1)
    )
    place = np.array([0.6, 0.0, -0.8]) * distance_m + np.array([0.0, 0.0, 2.0])
    range_m = float(np.linalg.norm(place))
    ray = place / range_m
    normal = np.array([-0.6, 0.0, 0.8])
    lit = 0.4
    source = Surfaces(np.array([range_m]), normal[:, None], ray[:, None], np.array([lit]), np.array([0.01]))
    form = 0.01 / (np.pi * distance_m**2 + 0.01)
    expected = form * lit / range_m**2 / (0.8 / 4.0) * np.exp(1j * 1.5 * (range_m + distance_m - 2.0))
    np.testing.assert_allclose(light_of(source, wall, rad_per_m=1.5), [expected], rtol=1e-6)


def test_a_closed_sphere_leaves_nothing_open() -> None:
    light = interreflections(sphere(), nothing(), np.full(POINTS, 0.3), harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.open_share, 0.0, atol=0.03)
    half = sphere().ray[2] > 0
    light = interreflections(sphere()[half], nothing(), np.full(half.sum(), 0.3), harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.open_share, 0.5, atol=0.03)
