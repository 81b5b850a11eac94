"""Where a camera in a room looks, and where its lamp is; the camera turns to the right first, then down."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.rooms.rendering import median_irradiance
from cadtof_cli.simulation.scene.rooms.solids import Interior
from cadtof_cli.simulation.scene.rooms.view import Room, View

ROOM = Interior(size_m=(4.0, 2.5, 5.0), albedos=(0.5,) * 6)

POSITION = (1.5, 1.2, 0.5)


def view(yaw_rad: float = 0.0, pitch_rad: float = 0.0, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> View:
    room = Room(interior=ROOM, position_m=POSITION, yaw_rad=yaw_rad, pitch_rad=pitch_rad, beam_rad=0.9)
    return View(room=room, camera=Camera(width=24, height=18), lamp_offset_m=offset)


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 0.0), (0.4, 0.0), (0.0, 0.3), (-0.7, 0.5), (1.2, -0.4)])
def test_yaw_and_pitch_turn_the_axes_of_the_camera(yaw: float, pitch: float) -> None:
    right, down, ahead = view(yaw, pitch).turn.T
    cosine, sine = math.cos(pitch), math.sin(pitch)
    assert_allclose(ahead, (cosine * math.sin(yaw), sine, cosine * math.cos(yaw)), atol=1e-12)
    assert_allclose(right, (math.cos(yaw), 0.0, -math.sin(yaw)), atol=1e-12)
    assert_allclose(down, np.cross(ahead, right), atol=1e-12)


@pytest.mark.parametrize(
    ("yaw", "pitch", "length"), [(0.0, 0.0, 4.5), (math.pi / 2, 0.0, 2.5), (0.0, 1.5, 1.3 / math.sin(1.5))]
)
def test_rays_of_any_length_go_from_the_camera_to_the_wall_ahead(yaw: float, pitch: float, length: float) -> None:
    meetings = view(yaw, pitch).meet(np.array([[0.0], [0.0], [7.0]]))
    assert meetings.lengths_m[0] == pytest.approx(length, rel=1e-5)


def test_the_lamp_turns_with_the_camera() -> None:
    lamp = view(math.pi / 2, 0.0, (0.1, 0.2, 0.05)).lamp
    assert_allclose(lamp.position_m, (1.5 + 0.05, 1.4, 0.5 - 0.1))
    assert_allclose(lamp.axis, (1.0, 0.0, 0.0), atol=1e-12)
    assert lamp.beam_rad == 0.9
    turned = view(0.3, -0.2).lamp
    assert_allclose(turned.axis, view(0.3, -0.2).turn @ (0.0, 0.0, 1.0))


@pytest.mark.parametrize("offset", [(0.0, 0.0, -0.5), (-1.5, 0.0, 0.0), (0.0, 1.3, 0.0), (2.5, 0.0, 0.0)])
def test_a_lamp_in_or_behind_a_wall_is_refused(offset: tuple[float, float, float]) -> None:
    with pytest.raises(SettingsError, match="lamp offset: found"):
        view(offset=offset)
    nearly = (0.999 * offset[0], 0.999 * offset[1], 0.999 * offset[2])
    assert view(offset=nearly).lamp_offset_m == nearly


@pytest.mark.parametrize(("width", "height", "step"), [(24, 18, 1), (320, 240, 8), (1000, 30, 2), (64, 48, 3)])
def test_the_median_is_that_of_every_eighth_pixel_with_direct_light_or_of_more_in_small_pictures(
    width: int, height: int, step: int
) -> None:
    """The beam, .9 rad and an edge of 10° to each side, covers the view. The light of a pixel is cos/r²."""
    straight = replace(view(), camera=Camera(width=width, height=height))
    x, y, z = straight.camera.rays(slice(None))[:, ::step, ::step].reshape(3, -1)
    meetings = straight.meet(np.stack([x, y, z]))
    lit = straight.direct(meetings)
    assert (lit > 0).all()
    cosine = (
        np.abs((meetings.normals * (meetings.points_m - np.array(POSITION)[:, None])).sum(axis=0)) / meetings.lengths_m
    )
    assert median_irradiance(straight) == pytest.approx(float(np.median(cosine / meetings.lengths_m**2)), rel=1e-4)
