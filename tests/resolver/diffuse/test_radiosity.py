"""Interreflections inside a sphere, where all form factors are equal and the light is known in closed form."""

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


def no_surfaces() -> Surfaces:
    return Surfaces(np.empty(0), np.empty((3, 0)), np.empty((3, 0)), np.empty(0), np.empty(0))


def second_bounce(h: int) -> complex:
    """Return Σ F·exp(ihω r/c) over distances r; seen from a point of the sphere, their density is r/(2R²)."""
    r = np.linspace(0, 2 * RADIUS, 200_001)
    return complex(np.trapezoid(r / (2 * RADIUS**2) * np.exp(1j * h * OMEGA * r / C_M_PER_NS), r))


@pytest.mark.parametrize("h", [1, 2, 3])
def test_light_inside_a_sphere_has_its_closed_form(h: int) -> None:
    light = interreflections(
        sphere(), no_surfaces(), np.full(POINTS, 0.3), harmonics=(1, 2, 3), rad_per_m=OMEGA / C_M_PER_NS
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
    light = interreflections(sphere(), no_surfaces(), amplitude, harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.seen[0].real, 1.0, rtol=0.02)
    near, far = sphere().ray[2] > 0.9, sphere().ray[2] < -0.9
    assert light.seen[0][near].real.mean() == pytest.approx(light.seen[0][far].real.mean(), rel=0.02)


def test_surfaces_that_face_away_give_no_light() -> None:
    wall = sphere()
    outside = Surfaces(wall.range_m, wall.ray, wall.ray, wall.cosine, wall.area_m2)
    light = interreflections(outside, no_surfaces(), np.full(POINTS, 0.3), harmonics=(1, 2), rad_per_m=1.0)
    assert np.abs(light.seen).max() == 0.0
    assert np.abs(light.later).max() == 0.0


@pytest.mark.parametrize("distance_m", [0.5, 1.0, 2.0])
def test_light_between_two_pieces_that_face_each_other_has_its_closed_form(distance_m: float) -> None:
    """A small piece A is at (0, 0, 2) m, and another piece beside the axis faces it.

    The light is E·F·exp(iω(d_s + r − d)/c), over the direct light E of A.
    """
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


def test_the_open_share_is_0_inside_a_sphere_and_a_half_inside_half_of_one() -> None:
    light = interreflections(sphere(), no_surfaces(), np.full(POINTS, 0.3), harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.open_share, 0.0, atol=0.03)
    half = sphere().ray[2] > 0
    light = interreflections(sphere()[half], no_surfaces(), np.full(half.sum(), 0.3), harmonics=(1,), rad_per_m=0.0)
    np.testing.assert_allclose(light.open_share, 0.5, atol=0.03)


def pieces(count: int, seed: int) -> Surfaces:
    """Return small pieces of surface with random positions and normals."""
    rng = np.random.default_rng(seed)
    ray, normal = rng.normal(size=(2, 3, count))
    ray[2] = np.abs(ray[2]) + 0.5
    ray /= np.linalg.norm(ray, axis=0)
    normal -= 2.0 * ray
    normal /= np.linalg.norm(normal, axis=0)
    return Surfaces(rng.uniform(1.0, 4.0, count), normal, ray, -(ray * normal).sum(0), rng.uniform(0.05, 0.4, count))


def joined_pieces(seen: Surfaces, beyond: Surfaces) -> tuple[F, F, F, F]:
    """Return points, normals, areas and direct light of all pieces."""
    point = np.concatenate([s.ray * s.range_m for s in (seen, beyond)], axis=1)
    normal = np.concatenate([seen.normal, beyond.normal], axis=1)
    area = np.concatenate([seen.area_m2, beyond.area_m2])
    return point, normal, area, np.concatenate([s.cosine / s.range_m**2 for s in (seen, beyond)])


@pytest.mark.parametrize("outside", [0, 4])
@pytest.mark.parametrize("harmonics", [(1, 2), (1, 2, 4)])
def test_light_between_pieces_is_a_sum_over_pairs(harmonics: tuple[int, ...], outside: int) -> None:
    seen, beyond = pieces(7, 1), pieces(outside, 2)
    amplitude = np.random.default_rng(3).uniform(0.05, 0.5, 7)
    amplitude[2], amplitude[5] = 40.0, 1e-4
    albedo = amplitude * seen.range_m**2 / seen.cosine
    albedo = np.clip(albedo / np.median(albedo), 0.1, 4.0)
    albedo = np.append(albedo / np.average(albedo, weights=seen.area_m2), np.ones(outside))
    point, normal, area, direct = joined_pieces(seen, beyond)
    count, per_m = 7 + outside, 0.9
    light = interreflections(seen, beyond, amplitude, harmonics=harmonics, rad_per_m=per_m)
    np.testing.assert_allclose(light.direct, direct[:7])
    for row, h in enumerate(harmonics):
        kernel = np.zeros((count, count), complex)
        for i in range(count):
            for j in range(count):
                way = point[:, i] - point[:, j]
                square = way @ way
                leaving, arriving = max(float(way @ normal[:, j]), 0.0), max(float(-way @ normal[:, i]), 0.0)
                if i != j:
                    form = leaving * arriving / square * area[j] / (np.pi * square + area[j])
                    kernel[i, j] = form * albedo[j] * np.exp(1j * h * per_m * np.sqrt(square))
        arrival = direct * np.exp(1j * h * per_m * np.linalg.norm(point, axis=0))
        from_seen, from_beyond = kernel[:, :7] @ arrival[:7], kernel[:, 7:] @ arrival[7:]
        later, bounce = np.zeros(count, complex), from_seen + from_beyond
        for n in range(5):
            bounce = kernel @ bounce
            later += LATER_ALBEDO**n * bounce
        for found, expected_light in ((light.seen, from_seen), (light.beyond, from_beyond), (light.later, later)):
            np.testing.assert_allclose(found[row], (expected_light / arrival)[:7], rtol=2e-3, atol=2e-5)
