"""Points that the lamp's light reaches, followed from the lamp from surface to surface."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float32, Index
from cadtof_cli.simulation.scene.rooms.directions import about, cosine_weighted
from cadtof_cli.simulation.scene.rooms.lamp import Lamp
from cadtof_cli.simulation.scene.rooms.solids import MARGIN_M, Interior

LIGHT_RAYS = 131_072
"""Rays that leave the lamp."""

EVENNESS = 8.0
"""Density by which connections to later light are weighed, times the room's area. Paths bring what is nearer."""

MOST_BOUNCES = 64
"""Where light is given up at the latest; at a mean albedo of 0.8, 10⁻⁶ of it is beyond."""


@dataclass(frozen=True)
class LightPoints:
    """Points on surfaces, each reached by an equal share of the light.

    Attributes:
        points_m, normals: (3, n).
        albedo: (n,).
        lengths_m: (n,), of the light's way from the lamp.
        density: (n,), 1/m², against which ways to them are weighed.
        flux: light that all points together receive, where the lamp's is 1 on a square metre at a metre.
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
        first: points that it reaches from the lamp; their density is the irradiance by the lamp over its flux.
        later: points that it reaches after surfaces; their density stands for theirs, which is not known.
        later_density: this one, 1/m².
    """

    first: LightPoints
    later: LightPoints
    later_density: np.float32


def lamp_light(interior: Interior, lamp: Lamp, generator: np.random.Generator, /, rays: int = LIGHT_RAYS) -> LampLight:
    """Follow the lamp's light; at every surface a share of 1 − albedo of the rays ends."""
    directions = lamp.emitted(rays)
    origins = np.repeat(np.asarray(lamp.position_m, np.float32)[:, None], rays, axis=1)
    met = interior.meet(origins, directions)
    numbers, lengths = np.arange(rays), met.lengths_m
    density = lamp.irradiance(interior, met.points_m, met.normals) / np.float32(lamp.flux)
    first = LightPoints(met.points_m, met.normals, met.albedo, lengths, density, lamp.flux)
    later: list[tuple[Float32, Float32, Float32, Float32, Index]] = []
    for _ in range(MOST_BOUNCES):
        onward = np.flatnonzero(generator.random(len(met.albedo), dtype=np.float32) < met.albedo)
        if not len(onward):
            break
        numbers, normals = numbers[onward], met.normals[:, onward]
        draws = generator.random((2, len(onward)), dtype=np.float32)
        directions = about(normals, cosine_weighted(draws[0], draws[1]))
        met = interior.meet(met.points_m[:, onward] + np.float32(MARGIN_M) * normals, directions)
        lengths = lengths[onward] + met.lengths_m
        later.append((met.points_m, met.normals, met.albedo, lengths, numbers))
    even = np.float32(EVENNESS / interior.area_m2)
    return LampLight(first, _in_order_of_rays(later, even, lamp.flux / rays), even)


def _in_order_of_rays(
    bounces: list[tuple[Float32, Float32, Float32, Float32, Index]], density: np.float32, share: float
) -> LightPoints:
    """Return the points of all bounces, those of one ray together, so that neighbours come from all over the beam."""
    if not bounces:
        none, no_points = np.zeros(0, np.float32), np.zeros((3, 0), np.float32)
        return LightPoints(no_points, no_points, none, none, none, 0.0)
    points, normals, albedo, lengths, numbers = (np.concatenate(part, axis=-1) for part in zip(*bounces, strict=True))
    order = np.argsort(numbers, kind="stable")
    densities = np.full(len(order), density)
    return LightPoints(
        points[:, order], normals[:, order], albedo[order], lengths[order], densities, share * len(order)
    )
