"""The camera's lamp in a room: a point with a beam, and the points that its light reaches, from surface to surface."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.simulation.scene.geometry import Vector
from cadtof_cli.simulation.scene.rooms.directions import cosine_weighted, directions_about, evenly_spread_pairs
from cadtof_cli.simulation.scene.rooms.solids import MARGIN_M, Interior

EDGE_RAD = math.radians(10.0)
"""Angle beyond the half angle of the beam at which the beam has faded to 0."""

LIGHT_RAYS = 131_072
"""Number of rays that leave the lamp."""

EVENNESS = 8.0
"""Density, times the room's area, that is assumed for the points that light reaches after other surfaces. The larger it is, the
more light of nearby points comes from connections with these points, although traced paths find that light better."""

MOST_BOUNCES = 64
"""Number of bounces after which light is given up; at a mean albedo of 0.8, 10⁻⁶ of the light is left then."""


@dataclass(frozen=True, kw_only=True)
class Lamp:
    """A small lamp that is equally bright in all directions of its beam.

    Attributes:
        position_m: position in the room's coordinates.
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
        """Return evenly spread directions of the lamp's light, (3, count); any consecutive directions are spread evenly too."""
        theta, light = self._by_angle()
        share = np.concatenate([[0.0], np.cumsum(light)])
        first, second = evenly_spread_pairs(count)
        angle, turn = np.interp(first * share[-1], share, theta), 2.0 * np.pi * second
        local = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
        return directions_about(
            np.repeat(np.asarray(self.axis, np.float32)[:, None], count, axis=1), local.astype(np.float32)
        )

    @property
    def flux(self) -> float:
        """Total light of the lamp; the unit is the light on one square metre at a distance of 1 m."""
        theta, light = self._by_angle()
        return float(light.sum() * theta[1])

    def _by_angle(self) -> tuple[Float, Float]:
        """Return angles to the axis in even steps from 0 on, (n + 1,), and the light per angle between them, (n,)."""
        theta = np.linspace(0.0, min(self.beam_rad + EDGE_RAD, math.pi), 4096)
        middles = (theta[1:] + theta[:-1]) / 2
        return theta, 2.0 * np.pi * np.sin(middles) * self._profile(middles)

    def _ways(self, points_m: Float32) -> Float32:
        return points_m - np.asarray(self.position_m, np.float32)[:, None]

    def _intensity(self, directions: Float32) -> Float32:
        """Return 1 within the beam, falling to 0 as a cosine over its edge."""
        cosine = np.asarray(self.axis, np.float32) @ directions
        return self._profile(np.arccos(np.clip(cosine, -1, 1))).astype(np.float32)

    def _profile(self, theta: Float) -> Float:
        beyond = np.clip((theta - self.beam_rad) / EDGE_RAD, 0, 1)
        return np.asarray(0.5 + 0.5 * np.cos(np.pi * beyond))


@dataclass(frozen=True)
class LightPoints:
    """Points on surfaces. Each point is reached by an equal share of the light.

    Attributes:
        points_m, normals: (3, n).
        albedo: (n,).
        lengths_m: (n,), length of the light's way from the lamp to the point.
        density: (n,), density of the points in 1/m², for the balance heuristic (see `tracing`).
        flux: light that all points together receive, in the unit of `Lamp.flux`.
    """

    points_m: Float32
    normals: Float32
    albedo: Float32
    lengths_m: Float32
    density: Float32
    flux: float


@dataclass(frozen=True)
class LampLight:
    """Where the lamp's light goes.

    Attributes:
        first: points that the light reaches directly from the lamp; their density is the irradiance by the lamp over its flux.
        later: points that the light reaches after other surfaces; their true density is not known, and a fixed one is assumed.
        later_density: this assumed density, 1/m².
    """

    first: LightPoints
    later: LightPoints
    later_density: np.float32


def lamp_light(interior: Interior, lamp: Lamp, generator: np.random.Generator, /, rays: int = LIGHT_RAYS) -> LampLight:
    """Follow the rays of the lamp's light; at every surface, a share of 1 − albedo of the rays ends."""
    directions = lamp.emitted(rays)
    origins = np.repeat(np.asarray(lamp.position_m, np.float32)[:, None], rays, axis=1)
    met = interior.meet(origins, directions)
    numbers, lengths = np.arange(rays), met.lengths_m
    density = lamp.irradiance(interior, met.points_m, met.normals) / np.float32(lamp.flux)
    first = LightPoints(met.points_m, met.normals, met.albedo, lengths, density, lamp.flux)
    # no points at first, because it may be that every ray ends at the first surface
    later = [(met.points_m[:, :0], met.normals[:, :0], met.albedo[:0], lengths[:0], numbers[:0])]
    for _ in range(MOST_BOUNCES):
        onward = np.flatnonzero(generator.random(len(met.albedo), dtype=np.float32) < met.albedo)
        if not len(onward):
            break
        numbers, normals = numbers[onward], met.normals[:, onward]
        draws = generator.random((2, len(onward)), dtype=np.float32)
        directions = directions_about(normals, cosine_weighted(draws[0], draws[1]))
        met = interior.meet(met.points_m[:, onward] + np.float32(MARGIN_M) * normals, directions)
        lengths = lengths[onward] + met.lengths_m
        later.append((met.points_m, met.normals, met.albedo, lengths, numbers))
    points, normals, albedo, lengths, numbers = (np.concatenate(part, axis=-1) for part in zip(*later, strict=True))
    # sorted by ray, so that consecutive points come from all over the beam
    order = np.argsort(numbers, kind="stable")
    even, flux = np.float32(EVENNESS / interior.area_m2), lamp.flux / rays * len(order)
    further = LightPoints(
        points[:, order], normals[:, order], albedo[order], lengths[order], np.full(len(order), even), flux
    )
    return LampLight(first, further, even)
