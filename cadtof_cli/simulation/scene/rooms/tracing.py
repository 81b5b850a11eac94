"""Light that reaches a point by way of other surfaces, by Monte-Carlo path tracing: exact in expectation.

From the point, a path goes in a direction drawn with the density cos/π to the surface that it meets there. The lamp's
light on that surface, times its albedo, is one estimate of the irradiance by two bounces. A connection with a point that the
lamp's own light has found is another estimate, which is better if the lamp is near a surface. The two ways to come to the same
place have the densities p_c and p_v (per area). With the irradiance E = Φ p_v and the albedo ρ, both count as
ρ Φ p_v p_c/(p_c + p_v), the balance heuristic (Veach and Guibas 1995, doi:10.1145/218380.218498). The path then goes on, for
the light of three bounces, and so on. Its probability to go on is ρ p_c/(p_c + p_v), with the density p_v that is assumed for
points that light reaches after other surfaces: connections with such points bring the rest of that light. Nothing is divided
into patches and no system of equations is solved. The arrival times of light are kept in bins that are finer than any
modulation period; each bin has its mean time.
"""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float, Float32, Index
from cadtof_cli.simulation.scene.rooms.directions import cosine_weighted, directions_about, evenly_spread_pairs
from cadtof_cli.simulation.scene.rooms.lamp import MOST_BOUNCES, Lamp, LampLight, LightPoints
from cadtof_cli.simulation.scene.rooms.solids import MARGIN_M, Interior
from cadtof_cli.units import C_M_PER_NS

BINS = 160
"""Number of bins of a transient. The light of a bin counts at its mean time, so only the spread within a bin is lost."""

FIRST_NS, LAST_NS = 4.0, 150.0
"""Bins are equally wide in log(FIRST_NS + delay), up to LAST_NS: 0.1 ns wide at the start, 0.6 ns at 20 ns."""


@dataclass(frozen=True)
class Transients:
    """Irradiance of points, by the delay after their direct light.

    Attributes:
        once: (2, n, BINS), light by way of one other surface: irradiance in 1/m², the unit of the lamp's own light cos/r², and
            irradiance times the delay after the direct light in ns/m².
        later: (2, n, BINS), the same for light by way of more surfaces.
    """

    once: Float
    later: Float


@dataclass(frozen=True)
class _Ends:
    """Ends of the unfinished paths.

    Attributes:
        pixels: (n,), number of the point from which the path started.
        numbers: (n,), number of the path among the paths from this point.
        points_m, normals: (3, n), place of the end, and the normal of the surface there.
        lengths_m: (n,), length of the path, minus the length of the direct way from the lamp to the point where it started.
    """

    pixels: Index
    numbers: Index
    points_m: Float32
    normals: Float32
    lengths_m: Float32


def transients(
    interior: Interior,
    lamp: Lamp,
    light: LampLight,
    points_m: Float32,
    normals: Float32,
    /,
    *,
    paths: int,
    generator: np.random.Generator,
) -> Transients:
    """Trace `paths` paths from each point on a surface, (3, n) with normals (3, n), to the light of a lamp in a room."""
    count = points_m.shape[1]
    pixels, numbers = np.repeat(np.arange(count), paths), np.tile(np.arange(paths), count)
    ends = _Ends(pixels, numbers, points_m[:, pixels], normals[:, pixels], -lamp.distances_m(points_m)[pixels])
    first, second = (np.mod(generator.random((count, 1)) + part, 1.0).ravel() for part in evenly_spread_pairs(paths))
    once, later = np.zeros((2, count * BINS)), np.zeros((2, count * BINS))
    for bounce in range(MOST_BOUNCES):
        lamp_total = once if bounce == 0 else later
        for points, total in ((light.first, lamp_total), (light.later, later)):
            if points.flux > 0:
                starts = generator.integers(len(points.albedo), size=(count,))
                _add_connected(total, interior, points, (starts[ends.pixels] + ends.numbers) % len(points.albedo), ends)
        local = cosine_weighted(first.astype(np.float32), second.astype(np.float32))
        ends = _continued(lamp_total, interior, lamp, light, ends, local, generator)
        if not len(ends.pixels):
            break
        first, second = generator.random((2, len(ends.pixels)), dtype=np.float32)
    return Transients(once.reshape(2, count, BINS) / paths, later.reshape(2, count, BINS) / paths)


def bin_numbers(delays_ns: Float, /) -> Index:
    """Return the bin of each delay after the direct light; rounding may make a delay of 0 a little negative."""
    steps = np.log1p(delays_ns / FIRST_NS) * (BINS / math.log1p(LAST_NS / FIRST_NS))
    return np.minimum(steps, BINS - 1).astype(np.intp)


def _add_connected(total: Float, interior: Interior, points: LightPoints, chosen: Index, ends: _Ends) -> None:
    """Connect the end of each path with a point that light has reached, and add the light from this point."""
    ways = points.points_m[:, chosen] - ends.points_m
    lengths = np.maximum(np.sqrt((ways * ways).sum(axis=0)), np.float32(MARGIN_M))
    ways /= lengths
    leaving, arriving = -(ways * points.normals[:, chosen]).sum(axis=0), (ways * ends.normals).sum(axis=0)
    density = _path_density(leaving, arriving, lengths)
    light = points.albedo[chosen] * np.float32(points.flux) * _balanced(density, points.density[chosen])
    seen = np.flatnonzero(light)
    origins = ends.points_m[:, seen] + np.float32(MARGIN_M) * ends.normals[:, seen]
    seen = seen[interior.clear(origins, ways[:, seen], lengths[seen] - np.float32(3 * MARGIN_M))]
    _add(total, ends.pixels[seen], light[seen], ends.lengths_m[seen] + lengths[seen] + points.lengths_m[chosen[seen]])


def _continued(
    total: Float,
    interior: Interior,
    lamp: Lamp,
    light: LampLight,
    ends: _Ends,
    local: Float32,
    generator: np.random.Generator,
) -> _Ends:
    """Follow the paths to the next surface, add the lamp's light there, and return the paths that go on."""
    directions = directions_about(ends.normals, local)
    met = interior.meet(ends.points_m + np.float32(MARGIN_M) * ends.normals, directions)
    lengths = ends.lengths_m + met.lengths_m
    density = _path_density(-(directions * met.normals).sum(axis=0), local[2], met.lengths_m)
    flux = np.float32(light.first.flux)
    arriving = met.albedo * flux * _balanced(density, lamp.irradiance(interior, met.points_m, met.normals) / flux)
    seen = np.flatnonzero(arriving)
    _add(total, ends.pixels[seen], arriving[seen], lengths[seen] + lamp.distances_m(met.points_m[:, seen]))
    chance = met.albedo * density / (density + light.later_density)
    onward = generator.random(len(chance), dtype=np.float32) < chance
    return _Ends(
        ends.pixels[onward], ends.numbers[onward], met.points_m[:, onward], met.normals[:, onward], lengths[onward]
    )


def _path_density(leaving: Float32, arriving: Float32, lengths_m: Float32) -> Float32:
    """Return the density, 1/m², with which a path arrives at a place: cos cos/(π r²); 0 if one surface faces away."""
    lengths_m = np.maximum(lengths_m, np.float32(MARGIN_M))
    return np.asarray(np.maximum(leaving, 0) * np.maximum(arriving, 0) / (np.float32(math.pi) * lengths_m**2))


def _balanced(density: Float32, other: Float32) -> Float32:
    """Return the product of two densities over their sum, 0 where both are 0."""
    return np.asarray(density * other / np.maximum(density + other, np.finfo(np.float32).tiny))


def _add(total: Float, pixels: Index, light: Float32, lengths_m: Float32) -> None:
    """Add light whose ways are longer than the direct ways by these lengths."""
    delays_ns = lengths_m.astype(np.float64) / C_M_PER_NS
    places, weights = pixels * BINS + bin_numbers(delays_ns), light.astype(np.float64)
    total[0] += np.bincount(places, weights, minlength=total.shape[1])
    total[1] += np.bincount(places, weights * delays_ns, minlength=total.shape[1])
