"""Pieces of furniture made of boxes and balls, with sizes drawn at random."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.solids import Ball, Box

_BOARD_M = 0.02
"""Half the thickness of boards, tops and panels."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece of furniture at the origin of the floor, with its back towards smaller z; heights count upwards.

    Attributes:
        parts: boxes; for each box, (x, height, z) of its centre, and half of its size along each axis.
        radius_m: radius of the ball that the piece is if it has no parts.
    """

    parts: tuple[tuple[Vector, Vector], ...] = ()
    radius_m: float = 0.0

    @property
    def half_footprint_m(self) -> tuple[float, float]:
        """Half the width and half the depth of the floor that the piece covers."""
        if not self.parts:
            return self.radius_m, self.radius_m
        return (
            max(abs(centre[0]) + half[0] for centre, half in self.parts),
            max(abs(centre[2]) + half[2] for centre, half in self.parts),
        )

    @property
    def height_m(self) -> float:
        """Height of its highest point over the floor."""
        return max((centre[1] + half[1] for centre, half in self.parts), default=2 * self.radius_m)

    def solids(
        self, x_m: float, floor_m: float, z_m: float, /, *, turn_rad: float, albedo: float
    ) -> tuple[tuple[Box, ...], tuple[Ball, ...]]:
        """Return its boxes and balls on a floor at y = floor_m."""
        if not self.parts:
            return (), (Ball(centre_m=(x_m, floor_m - self.radius_m, z_m), radius_m=self.radius_m, albedo=albedo),)
        cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
        boxes = tuple(
            Box(
                centre_m=(x_m + cosine * x - sine * z, floor_m - height, z_m + sine * x + cosine * z),
                half_m=half,
                turn_rad=turn_rad,
                albedo=albedo,
            )
            for (x, height, z), half in self.parts
        )
        return boxes, ()


def random_piece(generator: np.random.Generator, /, *, scale: float = 1.0) -> Piece:
    """Return a piece of a random kind; its width and depth are multiplied by `scale`."""
    make = _KINDS[int(generator.integers(len(_KINDS)))]
    return make(generator.uniform, scale)


Between = Callable[[float, float], float]
"""Draws a number between two limits."""


def _cupboard(between: Between, scale: float) -> Piece:
    width, height, depth = scale * between(0.3, 0.8), between(0.3, 1.0), scale * between(0.2, 0.35)
    return Piece(parts=(((0.0, height, 0.0), (width, height, depth)),))


def _table(between: Between, scale: float) -> Piece:
    width, height, depth = scale * between(0.35, 0.8), between(0.4, 0.75), scale * between(0.3, 0.45)
    top = ((0.0, height, 0.0), (width, _BOARD_M, depth))
    leg = height / 2 - _BOARD_M
    sides = tuple(((side * (width - 0.05), leg, 0.0), (_BOARD_M, leg, 0.8 * depth)) for side in (-1.0, 1.0))
    return Piece(parts=(top, *sides))


def _chair(between: Between, scale: float) -> Piece:
    half, height, rest = scale * between(0.2, 0.26), between(0.4, 0.5), between(0.2, 0.3)
    seat = ((0.0, height, 0.0), (half, 0.03, half))
    back = ((0.0, height + rest, 0.03 - half), (half, rest, 0.03))
    leg = ((0.0, height / 2, 0.0), (0.05, height / 2 - 0.03, 0.05))
    return Piece(parts=(seat, back, leg))


def _shelf(between: Between, scale: float) -> Piece:
    width, height, depth = scale * between(0.3, 0.6), between(0.5, 1.0), scale * between(0.13, 0.2)
    back = ((0.0, height, _BOARD_M - depth), (width, height, _BOARD_M))
    sides = tuple(((side * width, height, 0.0), (_BOARD_M, height, depth)) for side in (-1.0, 1.0))
    boards = tuple(((0.0, share * height, 0.0), (width, _BOARD_M, depth)) for share in (0.1, 1.0, 1.95))
    return Piece(parts=(back, *sides, *boards))


def _sofa(between: Between, scale: float) -> Piece:
    width, height, depth = scale * between(0.5, 1.0), between(0.18, 0.24), scale * between(0.35, 0.45)
    rest = between(0.15, 0.25)
    seat = ((0.0, height, 0.0), (width, height, depth))
    back = ((0.0, 2 * height + rest, 0.1 - depth), (width, rest, 0.1))
    arms = tuple(((side * width, 0.3, 0.0), (0.08, 0.3, depth)) for side in (-1.0, 1.0))
    return Piece(parts=(seat, back, *arms))


def _bed(between: Between, scale: float) -> Piece:
    width, depth = scale * between(0.45, 0.9), scale * between(0.8, 1.0)
    mattress = ((0.0, 0.25, 0.0), (width, 0.25, depth))
    head = ((0.0, 0.5, _BOARD_M - depth), (width, 0.5, _BOARD_M))
    return Piece(parts=(mattress, head))


def _panel(between: Between, scale: float) -> Piece:
    width, height = scale * between(0.25, 0.7), between(0.5, 1.0)
    return Piece(parts=(((0.0, height, 0.0), (width, height, _BOARD_M)),))


def _pillar(between: Between, scale: float) -> Piece:
    half = scale * between(0.1, 0.25)
    return Piece(parts=(((0.0, 1.1, 0.0), (half, 1.1, half)),))


def _ball(between: Between, scale: float) -> Piece:
    return Piece(radius_m=scale * between(0.2, 0.45))


_KINDS = (_cupboard, _table, _chair, _shelf, _sofa, _bed, _panel, _pillar, _ball)
