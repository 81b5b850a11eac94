"""Rooms drawn by a seed: living rooms, corners, corridors and closets, with doors, windows, rugs and furniture."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.furniture import random_piece
from cadtof_cli.simulation.scene.rooms.solids import FACES, Ball, Box, Interior, Patch
from cadtof_cli.simulation.scene.rooms.view import COARSE_CAMERA, Room, View

MOST_FURNITURE = 12
"""How many pieces of furniture may be asked for."""

DRAWN_FURNITURE = 8
"""How many pieces of furniture are drawn at most."""

FARTHEST_M = 5.7
"""Limit of the ranges that the camera may see, below the unambiguous range of 6 m. Nothing stands right before the lens."""

DRAWN_BEAM_DEG = (42.0, 65.0)
"""Limits between which half the angle of the lamp's beam is drawn."""

LIGHT_LOST = 0.3
"""Largest share of the view that openings may take, and largest share of the seen surfaces that may have no direct light."""

TRIES = 400
"""How many rooms are drawn for a seed until one fits; mostly one of the first ten fits."""

PLACES, SMALLER = 40, 0.97
"""How many places are tried for a piece of furniture, and the factor on its size from one place to the next."""

AGAINST_WALL = 0.6
"""Share of the furniture that stands with its back to a wall."""

KINDS = {"room": 0.5, "corner": 0.2, "corridor": 0.15, "closet": 0.15}
"""Kinds of room, and how often each is drawn."""

_CAMERA_ROOM_M = 0.5
"""Radius of the free floor around the camera."""

_FLOOR = 3


@lru_cache(maxsize=4)
def random_room(
    seed: int, /, *, furniture: int | None = None, albedo: float | None = None, beam_deg: float | None = None
) -> Room:
    """Return the room of a seed; it is the same for the same arguments.

    `furniture` is the number of pieces of furniture, up to MOST_FURNITURE, `albedo` the albedo of every surface, and
    `beam_deg` half the beam's angle. An argument that is None is drawn. A SettingsError is raised if no room of this
    seed has place for the furniture, or if the beam lights too little of what the camera sees.
    """
    generator = np.random.default_rng(seed)
    kind = str(generator.choice(list(KINDS), p=list(KINDS.values())))
    pieces = int(generator.integers(DRAWN_FURNITURE + 1)) if furniture is None else furniture
    drawn_deg = generator.uniform(*DRAWN_BEAM_DEG)
    beam = drawn_deg if beam_deg is None else beam_deg
    held = False
    for _ in range(TRIES):
        empty = _empty_room(kind, generator, beam_rad=math.radians(beam))
        interior = _furnished(empty, pieces, generator)
        if interior is None:
            continue
        held = True
        patches, opening = _patches(interior.size_m, generator)
        interior = replace(interior, patches=patches, albedos=_face_albedos(generator))
        width, height, depth = interior.size_m
        size = f"{kind} of {width:.2f} × {depth:.2f} × {height:.2f} m"
        room = replace(empty, interior=interior, summary=f"{size}{opening}, pieces of furniture: {pieces}")
        if _fits(room):
            return room if albedo is None else replace(room, interior=_in_one_albedo(interior, albedo))
    if held and beam < DRAWN_BEAM_DEG[0]:
        raise SettingsError(
            f"beam: found {beam:g}°, expected a wider one, of 25° or more: it lights too little of what the camera sees"
        )
    raise SettingsError(
        f"furniture: found {pieces} pieces, expected few enough that the {kind} of seed {seed} holds them"
    )


def _empty_room(kind: str, generator: np.random.Generator, *, beam_rad: float) -> Room:
    """Return a room that has only its size, with the camera in it."""
    width, height, depth = (float(v) for v in generator.uniform((2.5, 2.3, 2.5), (7.0, 3.2, 7.0)))
    if kind == "corridor":
        width, depth = generator.uniform(1.2, 2.2), generator.uniform(4.0, 7.0)
    if kind == "closet":
        width, depth = (float(v) for v in generator.uniform(1.5, 2.7, 2))
    margin = min(_CAMERA_ROOM_M, 0.4 * width)
    x = generator.uniform(margin, width - margin)
    y = height - generator.uniform(0.8, min(2.0, height - 0.4))
    z = generator.uniform(0.25, max(0.5, 0.45 * depth))
    yaw = math.radians(generator.uniform(-12, 12) if kind == "corridor" else generator.uniform(-40, 40))
    if kind == "corner":
        side = float(generator.choice([0.0, width]))
        yaw = math.atan2(side - x, depth - z) + math.radians(generator.uniform(-12, 12))
    pitch = math.radians(generator.uniform(-8, 28))
    empty = Interior(size_m=(width, height, depth), albedos=(0.0,) * 6)
    return Room(interior=empty, position_m=(x, y, z), yaw_rad=yaw, pitch_rad=pitch, beam_rad=beam_rad)


def _furnished(room: Room, pieces: int, generator: np.random.Generator) -> Interior | None:
    """Return the room with furniture that touches neither itself nor the camera; None if there is no room for it."""
    width, height, depth = size_m = room.interior.size_m
    boxes: tuple[Box, ...] = ()
    balls: tuple[Ball, ...] = ()
    taken = [(room.position_m[0], room.position_m[2], _CAMERA_ROOM_M)]
    for _ in range(pieces):
        for attempt in range(PLACES):
            piece = random_piece(generator, scale=SMALLER**attempt)
            half_width, half_depth = piece.half_footprint_m
            radius = math.hypot(half_width, half_depth)
            turn = generator.uniform(-math.pi, math.pi)
            x, z = generator.uniform(0, width), generator.uniform(0, depth)
            if generator.random() < AGAINST_WALL:
                x, z, turn = _against_wall(x, z, half_depth, size_m)
                across, along = (half_width, half_depth) if abs(math.cos(turn)) > 0.5 else (half_depth, half_width)
            else:
                across = along = radius
            inside = across < x < width - across and along < z < depth - along and piece.height_m < height - 0.05
            if inside and all(math.hypot(x - a, z - b) > radius + r for a, b, r in taken):
                more, rounder = piece.solids(x, height, z, turn_rad=turn, albedo=generator.uniform(0.2, 0.9))
                boxes, balls = boxes + more, balls + rounder
                taken.append((x, z, radius))
                break
        else:
            return None
    return replace(room.interior, boxes=boxes, balls=balls)


def _against_wall(x: float, z: float, half_depth: float, size_m: Vector) -> tuple[float, float, float]:
    """Return the place and the turn of a piece with its back to the left, right or far wall, whichever is nearest."""
    width, _, depth = size_m
    gap = half_depth + 0.02
    left, right, far = x, width - x, depth - z
    if far <= min(left, right):
        return x, depth - gap, math.pi
    return (gap, z, -math.pi / 2) if left < right else (width - gap, z, math.pi / 2)


def _face_albedos(generator: np.random.Generator) -> tuple[float, float, float, float, float, float]:
    """Return the albedos of the faces: the walls are similar to each other, the ceiling is lighter, and the floor darker."""
    walls = np.clip(generator.uniform(0.25, 0.8) + generator.uniform(-0.15, 0.15, 4), 0.2, 0.9)
    left, right, near, far = (float(wall) for wall in walls)
    return left, right, generator.uniform(0.4, 0.9), generator.uniform(0.2, 0.6), near, far


def _patches(size_m: Vector, generator: np.random.Generator) -> tuple[tuple[Patch, ...], str]:
    """Return pictures and rugs, then a door, a window or an open side, if there is one, and words for it."""
    width, height, depth = size_m
    patches = []
    for _ in range(int(generator.integers(4))):
        face = int(generator.choice([0, 1, _FLOOR, 5]))
        low, high = _rectangle(size_m, generator)
        patches.append(Patch(face=face, low_m=low, high_m=high, albedo=generator.uniform(0.2, 0.9)))
    chance = generator.random()
    face = int(generator.choice([0, 1, 4, 5]))
    if chance < 0.12:
        words, low, high = f"{FACES[face]} side open", (0.0, 0.0, 0.0), size_m
    elif chance < 0.5:
        words = f"open door {FACES[face]}"
        x, z = (generator.uniform(0.0, length - 0.9) for length in (width, depth))
        low, high = (x, height - 2.0, z), (x + 0.9, height, z + 0.9)
    elif chance < 0.7:
        words = f"window {FACES[face]}"
        low, high = _rectangle(size_m, generator)
    else:
        return tuple(patches), ""
    return (*patches, Patch(face=face, low_m=low, high_m=high, albedo=0.0)), f", {words}"


def _rectangle(size_m: Vector, generator: np.random.Generator) -> tuple[Vector, Vector]:
    """Return opposite corners of a box within the room, a quarter to six tenths as large along each axis."""
    spans = generator.uniform(0.25, 0.6, 3) * size_m
    lows = generator.uniform(0.0, 1.0, 3) * (np.asarray(size_m) - spans)
    (a, b, c), (d, e, f) = lows, lows + spans
    return (float(a), float(b), float(c)), (float(d), float(e), float(f))


def _in_one_albedo(interior: Interior, albedo: float) -> Interior:
    """Return the room with this albedo on all surfaces; openings stay open."""
    return replace(
        interior,
        albedos=(albedo,) * 6,
        patches=tuple(replace(patch, albedo=albedo if patch.albedo > 0 else 0.0) for patch in interior.patches),
        boxes=tuple(replace(box, albedo=albedo) for box in interior.boxes),
        balls=tuple(replace(ball, albedo=albedo) for ball in interior.balls),
    )


def _fits(room: Room) -> bool:
    """Return whether the camera sees surfaces at ranges that it can measure, and most of these surfaces are lit."""
    view = View(room=room, camera=COARSE_CAMERA)
    seen = view.meet(COARSE_CAMERA.rays(slice(None)).reshape(3, -1))
    closed = seen.albedo > 0
    if closed.mean() < 1 - LIGHT_LOST:
        return False
    ranges_m = seen.lengths_m[closed]
    lit = (view.direct(seen)[closed] > 0).mean()
    return bool(ranges_m.max() < FARTHEST_M and lit > 1 - LIGHT_LOST)
