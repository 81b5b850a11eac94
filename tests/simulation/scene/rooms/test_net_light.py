"""The panel of a net is where geometry puts it; threads and holes share the light."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.simulation.scene.light import Light
from cadtof_cli.simulation.scene.rooms.net import Net, drawn_net
from cadtof_cli.simulation.scene.rooms.solids import Box, Interior
from cadtof_cli.simulation.scene.rooms.view import Room

ROOM = Room(
    interior=Interior(size_m=(6.0, 2.6, 6.0), albedos=(0.5,) * 6),
    position_m=(3.0, 1.3, 1.0),
    yaw_rad=0.3,
    pitch_rad=0.2,
    beam_rad=1.0,
    summary="a room",
)


def net(seed: int = 1, *, distance_m: float | None = 2.0, room: Room = ROOM) -> Net:
    return drawn_net(room, fill=0.3, distance_m=distance_m, seed=seed)


@pytest.mark.parametrize("seed", range(6))
def test_the_panel_is_at_its_distance_about_the_middle_of_the_view(seed: int) -> None:
    """The panel is upright, turned with the camera, and its middle is at most 8° beside the axis."""
    panel = net(seed).panel
    x, y, z = (at - from_m for at, from_m in zip(panel.centre_m, ROOM.position_m, strict=True))
    assert math.hypot(x, y, z) == pytest.approx(2.0)
    assert y == pytest.approx(2.0 * math.sin(0.2))
    assert abs(math.atan2(x, z) - 0.3) <= math.radians(8.0)
    assert panel.turn_rad == -0.3
    assert 0.24 <= panel.half_m[0] <= 0.6
    assert 0.24 <= panel.half_m[1] <= 0.5
    assert panel.half_m[2] == 0.002
    assert 0.4 <= panel.albedo <= 0.9
    assert (net(seed).fill, net(seed).distance_m) == (0.3, 2.0)
    away = {
        round(math.atan2(one.panel.centre_m[0] - 3.0, one.panel.centre_m[2] - 1.0), 6) for one in map(net, range(6))
    }
    assert len(away) == 6


@pytest.mark.parametrize("seed", range(4))
def test_a_drawn_net_is_between_the_camera_and_the_surfaces_behind(seed: int) -> None:
    """The camera looks straight at the far wall, 5 m away; the net is at .35 to .85 of the distance behind it."""
    straight = replace(ROOM, yaw_rad=0.0, pitch_rad=0.0)
    assert 0.35 * 4.9 < net(seed, distance_m=None, room=straight).distance_m < 0.85 * 5.4


def test_a_net_is_added_to_the_solids_of_a_room() -> None:
    box = Box(centre_m=(1.0, 2.0, 3.0), half_m=(0.1, 0.1, 0.1))
    room = replace(ROOM, interior=replace(ROOM.interior, boxes=(box,)))
    assert net().hung(room).interior.boxes == (box, net().panel)
    assert net().hung(room).position_m == room.position_m


def light(direct: float, later: float, delays: tuple[float, float]) -> Light:
    """Return the light of two pixels: direct light at these delays, and one MPI path 3 ns later."""
    return Light(
        delays_ns=np.array([[delays], [[delays[0] + 3.0, delays[1] + 3.0]]]),
        photons=np.array([[[direct, direct]], [[later, later]]]),
        ambient=np.array([[direct, 2.0 * direct]]),
        ranges_m=np.array([[1.0, 2.0]]),
    )


def test_threads_and_holes_share_the_light() -> None:
    """The net hides the surface of the first pixel only; in the second pixel both rooms show the same surface."""
    panel, behind = light(4.0, 0.5, (10.0, 30.0)), light(1.0, 0.3, (20.0, 30.0))
    both = net().mixed(panel, behind)
    assert_allclose(both.photons[:, 0], [[1.2, 1.9], [0.7, 0.0], [0.15, 0.15], [0.21, 0.21]])
    assert_allclose(both.delays_ns[:, 0], [[10.0, 30.0], [20.0, 30.0], [13.0, 33.0], [23.0, 33.0]])
    assert_allclose(both.ambient, [[0.3 * 4.0 + 0.7, 0.3 * 8.0 + 1.4]])
    assert both.ranges_m is panel.ranges_m


def test_nets_are_drawn_over_all_of_their_sizes_places_and_albedos() -> None:
    """Half widths are .12 to .3 of the distance, half heights .12 to .25, angles −8° to 8°, albedos .4 to .9."""
    drawn = [net(seed, distance_m=1.0).panel for seed in range(300)]
    aside = [math.atan2(one.centre_m[0] - 3.0, one.centre_m[2] - 1.0) - 0.3 for one in drawn]
    for values, low, high in (
        ([one.half_m[0] for one in drawn], 0.12, 0.3),
        ([one.half_m[1] for one in drawn], 0.12, 0.25),
        (aside, -math.radians(8.0), math.radians(8.0)),
        ([one.albedo for one in drawn], 0.4, 0.9),
    ):
        assert low <= min(values) < low + 0.03 * (high - low)
        assert high - 0.03 * (high - low) < max(values) <= high


def test_nets_are_drawn_at_35_to_85_percent_of_the_distance_behind() -> None:
    straight = replace(ROOM, yaw_rad=0.0, pitch_rad=0.0)
    behind = net(0, distance_m=None, room=straight).distance_m / share_of(0)
    drawn = [net(seed, distance_m=None, room=straight).distance_m / behind for seed in range(120)]
    assert 0.35 <= min(drawn) < 0.37
    assert 0.83 < max(drawn) <= 0.85


def share_of(seed: int) -> float:
    """Return the share of the distance that a seed draws: the first number of the seed's branch for nets."""
    return float(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(7,))).uniform(0.35, 0.85))
