"""A net in a room: its distance, what it hides, and how its light and the light from behind add up."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.net import drawn_net
from cadtof_cli.simulation.scene.rooms.room import RandomRoom
from cadtof_cli.simulation.scene.rooms.solids import Interior
from cadtof_cli.simulation.scene.rooms.view import Room

CAMERA = Camera(width=32, height=24)
ALL_ROWS = slice(0, 24)
C_M_PER_NS = 0.299792458

BARE = RandomRoom(seed=2001, light_paths=8)
HUNG = replace(BARE, net_fill=0.3, net_distance_m=1.5)


def with_and_without() -> tuple[Light, Light]:
    return HUNG.light(CAMERA, ALL_ROWS), BARE.light(CAMERA, ALL_ROWS)


def test_the_net_hangs_where_it_is_asked_for() -> None:
    """The net hangs upright, 1.5 m along the optical axis: this is its range at the height of its middle."""
    net, bare = with_and_without()
    range_m = net.delays_ns[0] * C_M_PER_NS / 2
    hidden = net.delays_ns[0] < bare.delays_ns[0] - 0.1
    assert 0.05 < hidden.mean() < 0.5
    pitch = HUNG.room.pitch_rad
    nearest = 1.5 * math.cos(pitch)
    assert range_m[hidden].min() > nearest - 0.3
    assert abs(float(range_m[hidden].min()) - 1.5) < 0.35
    np.testing.assert_array_equal(net.delays_ns[0][~hidden], bare.delays_ns[0][~hidden])


def test_surfaces_behind_the_net_are_seen_through_its_holes() -> None:
    net, bare = with_and_without()
    hidden = net.delays_ns[0] < bare.delays_ns[0] - 0.1
    np.testing.assert_allclose(net.photons[1][hidden], 0.7 * bare.photons[0][hidden])
    np.testing.assert_array_equal(net.delays_ns[1][hidden], bare.delays_ns[0][hidden])
    assert (net.photons[1][~hidden] == 0.0).all()


def test_a_nearly_open_net_leaves_the_room_as_it_was() -> None:
    net = replace(HUNG, net_fill=1e-6).light(CAMERA, ALL_ROWS)
    bare = BARE.light(CAMERA, ALL_ROWS)
    np.testing.assert_allclose(net.photons.sum(axis=0), bare.photons.sum(axis=0), rtol=1e-3)
    np.testing.assert_allclose(net.ambient, bare.ambient, rtol=1e-3)


def test_a_seed_draws_the_net_and_not_the_room_anew() -> None:
    drawn = replace(HUNG, net_distance_m=None)
    assert drawn.room == BARE.room
    assert drawn.net == replace(drawn).net
    assert drawn.net != replace(drawn, seed=2002).net
    assert "a net" in drawn.summary
    assert BARE.net is None


def hall(pitch_rad: float) -> Room:
    """A camera 4 m before a wall and 1.5 m above the floor."""
    interior = Interior(size_m=(40.0, 20.0, 4.5), albedos=(0.5,) * 6)
    position_m = (20.0, 18.5, 0.5)
    return Room(
        interior=interior, position_m=position_m, yaw_rad=0.0, pitch_rad=pitch_rad, beam_rad=1.0, summary="a hall"
    )


def middle_of_hall_m(pitch_rad: float) -> float:
    """Return the median of the ranges in the middle third of a view of 60 by 45 degrees."""
    x, y = np.meshgrid(np.linspace(-0.23, 0.23, 51), np.linspace(-0.16, 0.16, 51))
    cosine, sine = math.cos(pitch_rad), math.sin(pitch_rad)
    ahead, down = cosine - sine * y, sine + cosine * y
    ways = np.minimum(4.0 / ahead, np.where(down > 0.0, 1.5 / np.where(down > 0.0, down, 1.0), np.inf))
    return float(np.median(ways * np.sqrt(1.0 + x * x + y * y)))


def test_a_net_is_drawn_at_a_share_of_the_distance_that_the_middle_of_the_view_shows() -> None:
    """The view shows a wall, or the floor if the camera looks down. A seed's share, .35 to .85, is equal in all rooms."""
    pitches = np.radians([-25.0, 0.0, 12.0, 30.0, 55.0])
    shares = [
        [drawn_net(hall(p), fill=0.3, distance_m=None, seed=seed).distance_m / middle_of_hall_m(p) for p in pitches]
        for seed in range(40)
    ]
    np.testing.assert_allclose(shares, np.array(shares)[:, 1:2] * np.ones(5), rtol=0.02)
    assert 0.34 < np.min(shares) < 0.4
    assert 0.8 < np.max(shares) < 0.86


@pytest.mark.parametrize(
    ("fill", "distance_m", "message"),
    [
        (0.0, None, "net fill: found 0.0, expected a share above 0 and below 1"),
        (1.0, None, "net fill: found 1.0, expected a share above 0 and below 1"),
        (0.5, 0.1, "net distance: found 0.1, expected 0.2 to 10 m"),
        (None, 1.0, "net distance: found 1.0, expected both a net distance and a net fill"),
    ],
)
def test_nets_that_cannot_be_are_refused(fill: float | None, distance_m: float | None, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        RandomRoom(seed=1, net_fill=fill, net_distance_m=distance_m)
