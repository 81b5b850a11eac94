"""Furniture stands on the floor, is symmetric from left to right, and turns about its own middle."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.rooms.cornell import CornellBox
from cadtof_cli.simulation.scene.rooms.furniture import Piece, random_piece
from cadtof_cli.simulation.scene.rooms.room import RandomRoom


def pieces(count: int = 120, scale: float = 1.0) -> list[Piece]:
    generator = np.random.default_rng(3)
    return [random_piece(generator, scale=scale) for _ in range(count)]


def test_pieces_stand_on_the_floor_and_are_of_the_size_of_furniture() -> None:
    for piece in pieces():
        half_width, half_depth = piece.half_footprint_m
        assert 0.05 < half_width < 1.2
        assert 0.015 < half_depth < 1.1
        assert 0.35 < piece.height_m < 2.3
        if piece.parts:
            assert min(centre[1] - half[1] for centre, half in piece.parts) == pytest.approx(0.0, abs=0.03)
            assert all(min(half) > 0.0 for _, half in piece.parts)


def test_pieces_are_symmetric_from_left_to_right() -> None:
    for piece in pieces():
        parts = {(round(c[0], 9), c[1:], half) for c, half in piece.parts}
        assert len(parts) == len(piece.parts)
        assert {(round(-c[0], 9) + 0.0, c[1:], half) for c, half in piece.parts} == {
            (x + 0.0, rest, half) for x, rest, half in parts
        }


def test_parts_of_a_piece_touch_each_other() -> None:
    """Every part touches another part, except for a gap below the thickness of a board."""
    for piece in pieces():
        for number, (centre, half) in enumerate(piece.parts):
            others = [part for index, part in enumerate(piece.parts) if index != number]
            gaps = [max(abs(centre[axis] - c[axis]) - half[axis] - h[axis] for axis in range(3)) for c, h in others]
            assert not others or min(gaps) < 0.05


def test_footprint_and_height_hold_all_parts() -> None:
    piece = Piece(parts=(((0.1, 0.5, -0.2), (0.3, 0.5, 0.1)), ((-0.4, 0.2, 0.3), (0.1, 0.2, 0.05))))
    assert piece.half_footprint_m == pytest.approx((0.5, 0.35))
    assert piece.height_m == pytest.approx(1.0)
    ball = Piece(radius_m=0.3)
    assert (ball.half_footprint_m, ball.height_m) == ((0.3, 0.3), 0.6)


def test_a_piece_in_a_room_is_turned_from_x_towards_z() -> None:
    piece = Piece(parts=(((0.2, 0.4, -0.1), (0.1, 0.4, 0.05)),))
    (box,), balls = piece.solids(1.0, 2.5, 3.0, turn_rad=math.pi / 2, albedo=0.37)
    assert not balls
    assert_allclose(box.centre_m, (1.1, 2.1, 3.2))
    assert (box.half_m, box.turn_rad, box.albedo) == ((0.1, 0.4, 0.05), math.pi / 2, 0.37)
    boxes, (ball,) = Piece(radius_m=0.3).solids(1.0, 2.5, 3.0, turn_rad=0.2, albedo=0.4)
    assert not boxes
    assert (ball.centre_m, ball.radius_m, ball.albedo) == ((1.0, 2.2, 3.0), 0.3, 0.4)


def test_a_smaller_scale_takes_less_floor_and_leaves_the_height() -> None:
    for whole, half in zip(pieces(60), pieces(60, 0.5), strict=True):
        assert half.half_footprint_m[0] < 0.75 * whole.half_footprint_m[0]
        if whole.parts:
            assert half.height_m == whole.height_m


@pytest.mark.parametrize("albedo", [-0.1, 0.0, 0.951])
def test_rooms_without_an_albedo_are_refused(albedo: float) -> None:
    with pytest.raises(SettingsError, match="albedo: found"):
        RandomRoom(albedo=albedo)
    assert RandomRoom(albedo=0.95).albedo == 0.95
    assert RandomRoom(albedo=0.001).albedo == 0.001


def test_rooms_at_their_limits_are_accepted_and_beyond_refused() -> None:
    for room in (
        RandomRoom(seed=0, furniture=0, beam_deg=1.0, light_paths=1, asr=0.0),
        RandomRoom(furniture=12, beam_deg=180.0, light_paths=100_000, lamp_offset_m=(0.0, 0.3, 0.0)),
        CornellBox(asr=0.0, light_paths=1),
        CornellBox(light_paths=100_000),
    ):
        assert room.asr >= 0.0
    for furniture, beam in ((-1, 50.0), (13, 50.0), (3, 0.9), (3, 180.1)):
        with pytest.raises(SettingsError, match=r"furniture: found|beam: found"):
            RandomRoom(furniture=furniture, beam_deg=beam)
    for paths, asr in ((0, 1.0), (100_001, 1.0), (3, -0.1)):
        with pytest.raises(SettingsError, match=r"light paths: found|ASR: found"):
            CornellBox(light_paths=paths, asr=asr)
        with pytest.raises(SettingsError, match=r"light paths: found|ASR: found"):
            RandomRoom(light_paths=paths, asr=asr)


def test_cornell_s_walls_are_those_of_the_original_and_space_before_it_is_black() -> None:
    """Left is red, right is green, all else white. A view of 59.5° shows no wall behind or beside the camera."""
    interior = CornellBox().room.interior
    left, right, ceiling, floor, near, far = interior.albedos
    assert (left, right) == (0.6, 0.35)
    assert ceiling == floor == far == 0.75
    assert near == 0.0
    assert {patch.face for patch in interior.patches} == {0, 1, 2, 3}
    for patch in interior.patches:
        assert patch.albedo == 0.0
        assert (patch.low_m, patch.high_m) == ((0.0, 0.0, 0.0), (2.765, 2.765, 1.6))
    assert {box.albedo for box in interior.boxes} == {0.75}
    assert CornellBox().room.beam_rad == pytest.approx(math.radians(40.0))
    assert CornellBox().room.position_m == pytest.approx((2.765 / 2, 2.765 / 2, 0.05))
