"""A net in a room: how far it is, what it hides, and how its light and that from behind add up."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.room import RandomRoom

CAMERA = Camera(width=32, height=24)
ALL_ROWS = slice(0, 24)
C_M_PER_NS = 0.299792458

BARE = RandomRoom(seed=2001, light_paths=8)
HUNG = replace(BARE, net_fill=0.3, net_distance_m=1.5)


def with_and_without() -> tuple[Light, Light]:
    return HUNG.light(CAMERA, ALL_ROWS), BARE.light(CAMERA, ALL_ROWS)


def test_the_net_hangs_where_it_is_asked_for() -> None:
    """Upright at 1.5 m along the axis: that is its range where the view is level with its middle."""
    net, bare = with_and_without()
    range_m = net.delays_ns[0] * C_M_PER_NS / 2
    hidden = net.delays_ns[0] < bare.delays_ns[0] - 0.1
    assert 0.05 < hidden.mean() < 0.5
    pitch = HUNG.room.pitch_rad
    nearest = 1.5 * math.cos(pitch)
    assert range_m[hidden].min() > nearest - 0.3
    assert abs(float(range_m[hidden].min()) - 1.5) < 0.35
    np.testing.assert_array_equal(net.delays_ns[0][~hidden], bare.delays_ns[0][~hidden])


def test_what_is_behind_the_net_is_seen_through_its_holes() -> None:
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


@pytest.mark.parametrize(
    ("fill", "distance_m", "message"),
    [
        (0.0, None, "net fill: found 0.0, expected a share above 0 and below 1"),
        (1.0, None, "net fill: found 1.0, expected a share above 0 and below 1"),
        (0.5, 0.1, "net distance: found 0.1, expected 0.2 to 10 m"),
        (None, 1.0, "net distance: found 1.0, expected one with a net fill"),
    ],
)
def test_nets_that_cannot_be_are_refused(fill: float | None, distance_m: float | None, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        RandomRoom(seed=1, net_fill=fill, net_distance_m=distance_m)
