"""The camera's light in a room: a point with a beam."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.directions import about, lattice
from cadtof_cli.simulation.scene.rooms.solids import MARGIN_M, Interior

EDGE_RAD = math.radians(10.0)
"""How far beyond its half angle the beam has faded to nothing."""


@dataclass(frozen=True, kw_only=True)
class Lamp:
    """A small lamp, as bright in all directions of its beam.

    Attributes:
        position_m: in the room's frame.
        axis: unit vector along the middle of the beam.
        beam_rad: half angle within which the lamp has its full intensity of 1.
    """

    position_m: Vector
    axis: Vector
    beam_rad: float = math.pi

    def distances_m(self, points_m: Float32, /) -> Float32:
        """Return the distance of points (3, n) from the lamp, (n,)."""
        return np.asarray(np.sqrt(sum(way * way for way in self._ways(points_m))))

    def irradiance(self, interior: Interior, points_m: Float32, normals: Float32, /) -> Float32:
        """Return cos/r² in 1/m² on points (3, n) with normals (3, n), reduced by the beam's edge and by shadows, (n,)."""
        ways = self._ways(points_m)
        lengths = np.sqrt((ways * ways).sum(axis=0))
        directions = ways / lengths
        cosine = -(directions * normals).sum(axis=0)
        lit: Float32 = np.maximum(cosine, 0) / lengths**2 * self._intensity(directions)
        shone = np.flatnonzero(lit)
        origins = points_m[:, shone] + np.float32(MARGIN_M) * normals[:, shone]
        lit[shone] *= interior.clear(origins, -directions[:, shone], lengths[shone] - np.float32(MARGIN_M))
        return lit

    def emitted(self, count: int, /) -> Float32:
        """Return evenly spread directions of its light, (3, count); any run of neighbours is spread evenly too."""
        theta = np.linspace(0.0, min(self.beam_rad + EDGE_RAD, math.pi), 4096)
        share = np.concatenate([[0.0], np.cumsum(self._per_angle((theta[1:] + theta[:-1]) / 2))])
        first, second = lattice(count)
        angle, turn = np.interp(first * share[-1], share, theta), 2.0 * np.pi * second
        local = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
        return about(np.repeat(np.asarray(self.axis, np.float32)[:, None], count, axis=1), local.astype(np.float32))

    @property
    def flux(self) -> float:
        """All of its light, in units of the light on a square metre at a distance of 1 m."""
        theta = np.linspace(0.0, min(self.beam_rad + EDGE_RAD, math.pi), 4096)
        middles = (theta[1:] + theta[:-1]) / 2
        return float(self._per_angle(middles).sum() * (theta[1] - theta[0]))

    def _per_angle(self, theta: Float) -> Float:
        return 2.0 * np.pi * np.sin(theta) * self._profile(theta)

    def _ways(self, points_m: Float32) -> Float32:
        return points_m - np.asarray(self.position_m, np.float32)[:, None]

    def _intensity(self, directions: Float32) -> Float32:
        """Return 1 within the beam, falling to 0 as a cosine over its edge."""
        if self.beam_rad >= math.pi:
            return np.ones(directions.shape[1], np.float32)
        cosine = np.asarray(self.axis, np.float32) @ directions
        return self._profile(np.arccos(np.clip(cosine, -1, 1))).astype(np.float32)

    def _profile(self, theta: Float) -> Float:
        beyond = np.clip((theta - self.beam_rad) / EDGE_RAD, 0, 1)
        return np.where(beyond >= 1, 0, 0.5 + 0.5 * np.cos(np.pi * beyond))
