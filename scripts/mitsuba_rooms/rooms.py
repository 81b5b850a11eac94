"""The kinds of rooms. Each function builds a room on a stage, and draws its details from the stage's random numbers."""

from collections.abc import Callable
from functools import partial

import mitsuba as mi
import numpy as np
import trimesh
from trimesh.creation import annulus, box, cylinder, icosphere, torus

from mitsuba_rooms import furniture
from mitsuba_rooms.furniture import UP, rotation_matrix
from mitsuba_rooms.materials import ceiling, drawn, glossy, ground, matt, mirror, pane, tiles
from mitsuba_rooms.stage import Stage

LIFT = rotation_matrix(np.pi / 2, (1, 0, 0))
"""Rotation that raises a lying object, so that it faces the front wall."""

DOOR_M = 2.0


def kitchen(stage: Stage, layout: str) -> None:
    """A kitchen that scene_synthesizer drew, in a room around it."""
    parts = furniture.kitchen(layout, int(stage.rng.integers(1 << 20)))
    low, high = furniture.bounds(parts)
    stage.furnish(parts, materials=6)
    before = stage.between(2.2, 3.2) if layout == "single_wall" else stage.between(0.4, 1.2)
    x0, x1 = low[0] - stage.between(0.02, 0.5), high[0] + stage.between(0.02, 0.8)
    y0, y1 = low[1] - before, high[1] + 0.01
    left = stage.between(0.3, 0.6)
    window = {"left": ((left, left + 0.9), (1.0, 2.0))} if stage.rng.random() < 0.5 else {}
    stage.shell((x0, y0, 0), (x1, y1, stage.between(2.45, 2.8)), ground(stage.rng), ceiling(stage.rng), window)
    stage.stand = (x0 + 0.3, y0 + 0.3, 1.2), (x1 - 0.3, y1 - 0.3, 1.7)
    stage.look = (low[0] + 0.3, low[1] + 0.2, 0.6), (high[0] - 0.3, high[1] - 0.1, 1.6)


def living(stage: Stage) -> None:
    """Furniture along the walls and in the middle, a window, a door, a mirror."""
    wide, deep = stage.between(3.2, 4.6), stage.between(3.0, 4.4)
    holes = {}
    if stage.rng.random() < 0.6:
        holes[str(stage.rng.choice(["left", "right", "back"]))] = (0.5, 2.1), (0.9, 2.1)
    if stage.rng.random() < 0.4:
        holes["front"] = (0.3, 1.2), (0.0, DOOR_M)
    stage.shell((0, 0, 0), (wide, deep, stage.between(2.4, 2.9)), ground(stage.rng), ceiling(stage.rng), holes)
    for _ in range(int(stage.rng.integers(3, 8))):
        _along_a_wall(stage, wide, deep)
    if stage.rng.random() < 0.3:
        stage.rectangle((wide - 0.02, 0.3 * deep, 1.2), (0, 0.8, 0), (0, 0, 0.9), mirror())
    stage.stand = (0.4, 0.3, 1.0), (wide - 0.4, 0.4 * deep, 1.75)
    stage.look = (0.2, 0.5 * deep, 0.4), (wide - 0.2, deep, 1.4)


def _along_a_wall(stage: Stage, wide: float, deep: float) -> None:
    parts = furniture.piece(stage.rng)
    low, high = furniture.bounds(parts)
    gap, t, side = float(high[1] - low[1]) / 2 + 0.03, stage.between(0.2, 0.8), int(stage.rng.integers(4))
    at = ((t * wide, deep - gap), (gap, t * deep), (wide - gap, t * deep), (t * wide, t * deep))[side]
    turn = (0.0, np.pi / 2, -np.pi / 2, stage.between(0, 2 * np.pi))[side]
    stage.furnish(furniture.placed(parts, turn, (*at, 0.0)), materials=3)


def staircase(stage: Stage) -> None:
    """A flight of steps with posts and a handrail."""
    wide, deep, flight = stage.between(1.9, 2.8), stage.between(3.8, 4.6), stage.between(0.9, 1.1)
    rise, tread, steps = stage.between(0.16, 0.19), stage.between(0.25, 0.3), int(stage.rng.integers(9, 14))
    stone, rail = drawn(stage.rng), drawn(stage.rng, shine=0.6)
    for i in range(steps):
        y, top = 1.0 + (i + 0.5) * tread, rise * (i + 1)
        stage.mesh(box((flight, tread, top)).apply_translation((flight / 2, y, top / 2)), stone)
        stage.mesh(cylinder(0.018, 0.9, sections=12).apply_translation((flight + 0.03, y, top + 0.4)), rail)
    ends = [(flight + 0.03, 1.0 + i * tread, rise * (i + 1) + 0.85) for i in (0, steps)]
    stage.mesh(cylinder(0.03, segment=ends, sections=16), rail, smooth=True)
    holes = {"right": ((deep - 2.0, deep - 1.0), (0.0, DOOR_M))} if stage.rng.random() < 0.5 else {}
    if stage.rng.random() < 0.4:
        holes["back"] = (0.4, 1.3), (1.2, 2.4)
    stage.shell((0, 0, 0), (wide, deep, stage.between(3.0, 3.6)), ground(stage.rng), ceiling(stage.rng), holes)
    stage.stand = (flight + 0.3, 0.25, 1.2), (wide - 0.25, 0.7, 1.8)
    stage.look = (0.3, 2.2, 0.6), (wide - 0.3, deep, 1.6)


def corridor(stage: Stage) -> None:
    """A corridor with a door that stands open, and doorways: into a room on the left, into the dark on the right."""
    wide, deep, high = stage.between(1.3, 2.0), stage.between(4.0, 5.2), stage.between(2.3, 2.7)
    right = stage.between(0.8, 2.0)
    doorways = {"left": ((1.6, 2.5), (0.0, DOOR_M)), "right": ((right, right + 0.9), (0.0, DOOR_M))}
    stage.shell((0, 0, 0), (wide, deep, high), ground(stage.rng), ceiling(stage.rng), doorways)
    way_back = {"right": ((1.1, 2.0), (0.0, DOOR_M))}
    stage.shell((-2.6, 0.8, 0), (-0.12, 3.6, high), ground(stage.rng), ceiling(stage.rng), way_back)
    door = box((0.85, 0.04, 1.98)).apply_translation((0.425, 0, 0.99))
    door.apply_transform(rotation_matrix(stage.between(0.3, 1.3), UP))
    stage.mesh(door.apply_translation((0.02, deep - 1.4, 0)), drawn(stage.rng))
    stage.stand = (0.35, 0.2, 1.2), (wide - 0.35, 0.7, 1.7)
    stage.look = (0.2, 2.0, 0.8), (wide - 0.2, deep, 1.5)


def bathroom(stage: Stage) -> None:
    """Tiles, a tub, bowls, a mirror, a pane."""
    wide, deep = stage.between(1.8, 2.6), stage.between(2.2, 3.2)
    window = {"left": ((0.4, 1.0), (1.4, 2.0))} if stage.rng.random() < 0.5 else {}
    stage.shell(
        (0, 0, 0), (wide, deep, stage.between(2.3, 2.6)), glossy(tiles(0.2, 0.5, 8)), ceiling(stage.rng), window
    )
    tiled = glossy(tiles(stage.between(0.5, 0.7), stage.between(0.7, 0.85), int(stage.rng.integers(8, 16))))
    stage.rectangle((0, deep - 0.005, 0), (wide, 0, 0), (0, 0, 1.8), tiled)
    stage.rectangle((wide - 0.005, deep, 0), (0, -deep, 0), (0, 0, 1.8), tiled)
    white, tub_at = glossy(0.8), (wide - 0.42, deep - 0.85)
    for part, z in ((annulus(0.3, 0.38, 0.5, sections=48), 0.28), (cylinder(0.34, 0.04, sections=48), 0.1)):
        stage.mesh(part.apply_scale((1, 2, 1)).apply_translation((*tub_at, z)), white)
    bowl = icosphere(3, 0.24).apply_scale((1, 1.2, 0.8)).apply_translation((0.3, deep - 0.5, 0.35))
    stage.mesh(bowl, white, smooth=True)
    stage.mesh(box((0.18, 0.42, 0.4)).apply_translation((0.1, deep - 0.5, 0.7)), white)
    stage.mesh(torus(0.22, 0.05).apply_translation((0.3, 0.5 * deep, 0.85)), white, smooth=True)
    stage.mesh(box((0.5, 0.7, 0.06)).apply_translation((0.26, 0.5 * deep, 0.8)), drawn(stage.rng))
    if stage.rng.random() < 0.6:
        stage.rectangle((0.015, 0.5 * deep - 0.3, 1.15), (0, 0.6, 0), (0, 0, 0.7), mirror())
    if stage.rng.random() < 0.4:
        stage.rectangle((wide - 0.85, deep - 1.6, 0.5), (0, 1.5, 0), (0, 0, 1.4), pane())
    stage.stand, stage.across_deg = ((0.4, 0.2, 1.2), (wide - 0.3, 0.5, 1.75)), (60, 75)
    stage.look = (0.2, 0.7 * deep, 0.3), (wide - 0.2, deep, 1.3)


def rotunda(stage: Stage) -> None:
    """A round room with columns under a dome."""
    radius, high = stage.between(1.8, 2.5), stage.between(2.2, 2.8)
    stage.mesh(annulus(radius, radius + 0.05, high, sections=96).apply_translation((0, 0, high / 2)), matt(0.65))
    dome = icosphere(4, radius).apply_scale((1, 1, 0.5)).apply_translation((0, 0, high))
    stage.mesh(dome.slice_plane((0, 0, high - 0.001), UP), ceiling(stage.rng))
    stage.rectangle((-radius, -radius, 0), (2 * radius, 0, 0), (0, 2 * radius, 0), ground(stage.rng))
    stone, columns = drawn(stage.rng, shine=0.2), int(stage.rng.integers(5, 9))
    for turn in 2 * np.pi * (np.arange(columns) + 0.5) / columns:
        at = 0.78 * radius * np.cos(turn), 0.78 * radius * np.sin(turn), high / 2
        stage.mesh(cylinder(0.14, high, sections=32).apply_translation(at), stone, smooth=True)
    ball = icosphere(4, stage.between(0.3, 0.45)).apply_translation((stage.between(-0.4, 0.4), 0.3, 0.8))
    stage.mesh(ball, drawn(stage.rng), smooth=True)
    stage.mesh(cylinder(0.25, 0.5, sections=40).apply_translation((0, 0.3, 0.25)), stone)
    stage.stand = (-0.6, -0.75 * radius, 1.1), (0.6, -0.6 * radius, 1.7)
    stage.look = (-0.6, 0.2, 0.5), (0.6, radius, 1.6)


def attic(stage: Stage) -> None:
    """A room under a pitched roof with a skylight and beams."""
    wide, deep = stage.between(3.4, 4.4), stage.between(3.2, 4.4)
    knee, top = stage.between(0.6, 1.2), stage.between(2.4, 3.0)
    roof, wall, beam = ceiling(stage.rng), ceiling(stage.rng), drawn(stage.rng, shine=0.2)
    stage.rectangle((0, 0, 0), (wide, 0, 0), (0, deep, 0), ground(stage.rng))
    for x in (0.0, wide):
        stage.rectangle((x, 0, 0), (0, deep, 0), (0, 0, knee), wall)
    stage.wall((0, 0, knee), (0, deep, 0), (wide / 2, 0, top - knee), roof, ((deep / 2, deep / 2 + 0.8), (0.4, 1.4)))
    stage.rectangle((wide, 0, knee), (0, deep, 0), (-wide / 2, 0, top - knee), roof)
    for y in (0.0, deep):
        corners = [(0, y, 0), (wide, y, 0), (wide, y, knee), (wide / 2, y, top), (0, y, knee)]
        stage.mesh(trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3), (0, 3, 4)], process=False), wall)
    for y in np.arange(0.7, deep, 1.1):
        stage.mesh(box((0.7 * wide, 0.12, 0.14)).apply_translation((wide / 2, y, 0.8 * top)), beam)
    for _ in range(int(stage.rng.integers(2, 5))):
        _somewhere(stage, wide, deep)
    stage.stand = (0.35 * wide, 0.25, 1.1), (0.65 * wide, 0.6, 1.6)
    stage.look = (0.2 * wide, 0.6 * deep, 0.4), (0.8 * wide, deep, 1.4)


def hall(stage: Stage) -> None:
    """A large room with columns and arches."""
    wide, deep, high = stage.between(4.5, 6.0), stage.between(4.4, 5.0), stage.between(2.8, 3.6)
    window = {"back": ((0.8, 2.6), (0.8, 2.4))} if stage.rng.random() < 0.6 else {}
    stage.shell((0, 0, 0), (wide, deep, high), ground(stage.rng), ceiling(stage.rng), window)
    stone = drawn(stage.rng, shine=0.2)
    for x in (0.3, 0.7):
        for y in (0.45, 0.8):
            column = cylinder(0.18, high, sections=40).apply_translation((x * wide, y * deep, high / 2))
            stage.mesh(column, stone, smooth=True)
    for x in (0.2, 0.5, 0.8):
        arch = torus(0.8, 0.08).apply_transform(LIFT).apply_translation((x * wide, 0.8 * deep, high - 0.9))
        stage.mesh(arch, stone, smooth=True)
    for _ in range(int(stage.rng.integers(2, 6))):
        _somewhere(stage, wide, deep)
    stage.stand = (0.5, 0.4, 1.2), (wide - 0.5, 0.9, 1.8)
    stage.look = (0.3 * wide, 0.7 * deep, 0.5), (0.7 * wide, deep, 1.5)


def _somewhere(stage: Stage, wide: float, deep: float) -> None:
    at = stage.between(0.2, 0.8) * wide, stage.between(0.45, 0.85) * deep, 0.0
    stage.furnish(furniture.placed(furniture.piece(stage.rng), stage.between(0, 2 * np.pi), at), materials=3)


def cornell(stage: Stage) -> None:
    """Mitsuba's own Cornell box, two to three metres wide, seen from its open side."""
    half = stage.between(1.0, 1.5)
    upright = mi.ScalarTransform4f().scale(half) @ mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    for name, shape in mi.cornell_box().items():
        if isinstance(shape, dict) and shape["type"] in ("rectangle", "cube") and name != "light":
            albedo = {"green-wall": 0.3, "red-wall": 0.35}.get(name, 0.7)
            stage.add({"type": shape["type"], "to_world": upright @ shape["to_world"], "bsdf": matt(albedo)})
    stage.stand = (-0.3 * half, -3.6 * half, -0.2 * half), (0.3 * half, -2.6 * half, 0.4 * half)
    stage.look, stage.across_deg = ((-0.1, 0, -0.1), (0.1, 0, 0.1)), (42, 52)


ROOMS: dict[str, Callable[[Stage], None]] = {
    **{f"kitchen_{layout}": partial(kitchen, layout=layout) for layout in furniture.KITCHENS},
    **{room.__name__: room for room in (living, staircase, corridor, bathroom, rotunda, attic, hall, cornell)},
}
