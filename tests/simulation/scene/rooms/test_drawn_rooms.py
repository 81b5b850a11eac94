"""Rooms that must not change: those of the seeds that docs report figures for, and Cornell's box as it was measured."""

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.simulation.scene.rooms.random_rooms import KINDS, random_room
from cadtof_cli.simulation.scene.rooms.solids import Box
from cadtof_cli.simulation.scene.rooms.view import Room

DRAWN = "ffab05c50b342b52"
"""Digest of the rooms of seeds 2000 to 2029."""


def numbers(value: object) -> Iterator[float | str]:
    """Yield everything in a room: numbers to a micrometre, everything else as text."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for one in value:
            yield from numbers(one)
    elif isinstance(value, int | float):
        yield round(float(value), 6) + 0.0
    else:
        yield str(value)


def parts(room: Room) -> list[object]:
    interior = asdict(room.interior)
    solid = [interior[name] for name in ("size_m", "albedos", "patches", "boxes", "balls")]
    return [*solid, room.position_m, room.yaw_rad, room.pitch_rad, room.beam_rad, room.summary]


def test_a_seed_draws_the_room_that_figures_were_reported_for() -> None:
    """docs/diffuse.md reports figures of these rooms by seed: they would be wrong if a seed drew another room."""
    rooms = [random_room(seed) for seed in range(2000, 2030)]
    assert {room.summary.split(" of ")[0] for room in rooms} == set(KINDS)
    drawn = json.dumps(list(numbers([parts(room) for room in rooms])))
    assert hashlib.sha256(drawn.encode()).hexdigest()[:16] == DRAWN


def test_furniture_albedo_and_beam_can_be_asked_for() -> None:
    room = random_room(2003, furniture=0, albedo=0.4, beam_deg=50.0)
    assert not room.interior.boxes
    assert not room.interior.balls
    assert set(room.interior.albedos) == {0.4}
    assert room.beam_rad == pytest.approx(math.radians(50.0))
    assert room.summary.endswith("pieces of furniture: 0")


def corners(block: Box) -> np.ndarray:
    half_x, _, half_z = block.half_m
    cos, sin = math.cos(block.turn_rad), math.sin(block.turn_rad)
    x, _, z = block.centre_m
    around = [(a * half_x, b * half_z) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    return np.array([(x + cos * a + sin * b, z - sin * a + cos * b) for a, b in around])


def test_the_blocks_stand_as_in_the_original() -> None:
    """Floor corners in mm from graphics.cornell.edu/online/box/data.html; x grows to the left. Our box is 5 times larger."""
    measured = {
        165: [(130, 65), (82, 225), (240, 272), (290, 114)],
        330: [(423, 247), (265, 296), (314, 456), (472, 406)],
    }
    box = CornellBox().room
    blocks = {round(1000 * 2 * block.half_m[1] / 5): block for block in box.interior.boxes}
    assert set(blocks) == set(measured)
    for height, floor in measured.items():
        block = blocks[height]
        assert block.centre_m[1] + block.half_m[1] == pytest.approx(2.765)
        expected = np.array([(2.765 - 0.005 * x, 1.6 + 0.005 * z) for x, z in floor])
        for corner in corners(block):
            assert np.hypot(*(expected - corner).T).min() < 0.04
    assert_allclose(box.interior.size_m, (2.765, 2.765, 4.365))


@pytest.mark.parametrize("seed", [2001, 2003, 2009, 2015])
def test_openings_stay_open_where_all_surfaces_get_one_albedo(seed: int) -> None:
    drawn, same = random_room(seed).interior, random_room(seed, albedo=0.35).interior
    assert [patch.albedo for patch in same.patches] == [0.35 if patch.albedo else 0.0 for patch in drawn.patches]
    assert {box.albedo for box in same.boxes} | {ball.albedo for ball in same.balls} <= {0.35}
    assert [box.centre_m for box in same.boxes] == [box.centre_m for box in drawn.boxes]


def test_cornell_s_box_is_lit_from_the_camera() -> None:
    """The back wall above the blocks is as bright on the left as on the right."""
    camera = Camera(width=24, height=18)
    direct = CornellBox(light_paths=1).light(camera, slice(4, 5)).photons[0, 0]
    assert_allclose(direct[8:12], direct[12:16][::-1], rtol=1e-4)


def test_a_room_that_has_no_place_for_its_furniture_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The room is drawn again, but only so many times."""
    kind = random_room(2003, furniture=12).summary.split(" of ")[0]
    random_room.cache_clear()
    monkeypatch.setattr("cadtof_cli.simulation.scene.rooms.random_rooms.TRIES", 0)
    message = f"furniture: found 12 pieces, expected few enough that the {kind} of seed 2003 holds them"
    for beam_deg in (None, 10.0):
        with pytest.raises(SettingsError, match=message):
            random_room(2003, furniture=12, beam_deg=beam_deg)


@pytest.mark.parametrize("beam_deg", [1.0, 10.0])
def test_a_beam_that_lights_too_little_of_the_view_is_refused_by_its_name(beam_deg: float) -> None:
    with pytest.raises(SettingsError, match=f"beam: found {beam_deg:g}°, expected a wider one, of 25° or more"):
        random_room(3, furniture=0, beam_deg=beam_deg)
    assert random_room(3, furniture=0, beam_deg=25.0).beam_rad == pytest.approx(math.radians(25.0))
