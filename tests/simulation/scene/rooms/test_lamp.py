"""The lamp's light obeys the inverse-square and cosine laws; its shadows and its beam."""

import math

import numpy as np
import pytest

from cadtof_cli.simulation.scene.rooms.lamp import EDGE_RAD, Lamp
from cadtof_cli.simulation.scene.rooms.solids import Box, Interior

EMPTY = Interior(size_m=(8.0, 8.0, 8.0), albedos=(0.5,) * 6)
LAMP = Lamp(position_m=(4.0, 4.0, 1.0), axis=(0.0, 0.0, 1.0))


def lit(
    lamp: Lamp, point: tuple[float, float, float], normal: tuple[float, float, float], room: Interior = EMPTY
) -> float:
    points, normals = (np.array(vector, np.float32)[:, None] for vector in (point, normal))
    return float(lamp.irradiance(room, points, normals)[0])


def test_light_falls_off_with_the_square_of_distance_and_the_cosine() -> None:
    assert lit(LAMP, (4.0, 4.0, 3.0), (0.0, 0.0, -1.0)) == pytest.approx(1 / 4)
    assert lit(LAMP, (4.0, 4.0, 5.0), (0.0, 0.0, -1.0)) == pytest.approx(1 / 16)
    assert lit(LAMP, (7.0, 4.0, 5.0), (0.0, 0.0, -1.0)) == pytest.approx(4 / 5 / 25)
    assert lit(LAMP, (4.0, 4.0, 3.0), (0.0, 0.0, 1.0)) == 0.0


def test_a_box_throws_a_shadow() -> None:
    room = Interior(
        size_m=(8.0, 8.0, 8.0), albedos=(0.5,) * 6, boxes=(Box(centre_m=(4.0, 4.0, 3.0), half_m=(0.5, 0.5, 0.1)),)
    )
    assert lit(LAMP, (4.9, 4.0, 5.0), (0.0, 0.0, -1.0), room) == 0.0
    assert lit(LAMP, (5.2, 4.0, 5.0), (0.0, 0.0, -1.0), room) > 0.0


def test_the_beam_ends() -> None:
    lamp = Lamp(position_m=(4.0, 4.0, 1.0), axis=(0.0, 0.0, 1.0), beam_rad=math.radians(30.0))
    full, half, none = (
        lit(lamp, (4.0 + 3.0 * math.tan(math.radians(angle)), 4.0, 4.0), (0.0, 0.0, -1.0))
        * 9.0
        / math.cos(math.radians(angle)) ** 3
        for angle in (29.0, 35.0, 41.0)
    )
    assert full == pytest.approx(1.0, rel=1e-4)
    assert none == 0.0
    assert half == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("beam_rad", [0.7, 1.2, math.pi])
def test_the_flux_is_the_integral_of_the_intensity(beam_rad: float) -> None:
    lamp = Lamp(position_m=(4.0, 4.0, 1.0), axis=(0.0, 0.0, 1.0), beam_rad=beam_rad)

    def intensity(angle: float) -> float:
        point = (4.0 + math.sin(angle), 4.0, 1.0 + math.cos(angle))
        return lit(lamp, point, (-math.sin(angle), 0.0, -math.cos(angle)))

    angles = np.linspace(0.0, math.pi, 4001)
    values = [2 * math.pi * math.sin(angle) * intensity(angle) for angle in angles]
    assert lamp.flux == pytest.approx(np.trapezoid(values, angles), rel=1e-3)


def test_emitted_light_goes_where_the_beam_goes() -> None:
    lamp = Lamp(position_m=(4.0, 4.0, 1.0), axis=(0.6, 0.0, 0.8), beam_rad=0.7)
    directions = lamp.emitted(20_000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=0), 1.0, rtol=1e-5)
    cosine = np.asarray(lamp.axis) @ directions
    assert cosine.min() > math.cos(0.7 + EDGE_RAD) - 1e-4
    within = 2 * math.pi * (1 - math.cos(0.35)) / lamp.flux
    assert (cosine > math.cos(0.35)).mean() == pytest.approx(within, abs=2e-3)


@pytest.mark.parametrize("beam_deg", [30.0, 180.0])
def test_directions_of_the_light_go_round_the_axis_evenly_and_fill_the_beam(beam_deg: float) -> None:
    lamp = Lamp(position_m=(0.0, 0.0, 0.0), axis=(0.0, 0.6, 0.8), beam_rad=math.radians(beam_deg))
    found = lamp.emitted(20_000).astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(found, axis=0), 1.0, atol=1e-5)
    mean = found.mean(axis=1)
    share = (1.0 + math.cos(math.radians(beam_deg + math.degrees(EDGE_RAD) / 2))) / 2 if beam_deg < 180 else 0.0
    np.testing.assert_allclose(mean, share * np.array(lamp.axis), atol=0.01)
    across = np.cross(lamp.axis, (1.0, 0.0, 0.0))
    turns = np.arctan2(across @ found, found[0])
    counts, _ = np.histogram(turns, bins=12, range=(-np.pi, np.pi))
    np.testing.assert_allclose(counts, 20_000 / 12, rtol=0.05)
