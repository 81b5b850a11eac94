"""Flat diffuse surfaces in front of a camera that carries its own light: hits, irradiance, and light of one bounce.

The camera and its light stand at the origin; x points right, y down, z forward; lengths are in metres. Every surface
is Lambertian, so irradiance is enough to follow light: the irradiance by the camera's light is cos/r², and a surface with
albedo ρ and irradiance E has the radiance ρE/π in every direction.
"""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A flat rectangle, spanned by two unit vectors at right angles.

    Attributes:
        origin_m: a point in the plane of the surface, from which its extents are counted.
        across, along: unit vectors in the surface; their cross product is its normal.
        extents_m: lower and upper limit across, then lower and upper limit along.
        albedo: share of light that the surface reflects.
    """

    origin_m: Vector
    across: Vector
    along: Vector
    extents_m: tuple[float, float, float, float] = (-math.inf, math.inf, -math.inf, math.inf)
    albedo: float = 0.5

    @property
    def normal(self) -> Float:
        """Unit normal, (3,)."""
        return np.cross(self.across, self.along)

    def distances(self, origins_m: Float, directions: Float, /) -> Float:
        """Return the distance from the origin of each ray to the surface; inf if the ray misses the surface.

        The unit is the length of the ray's direction. Origins and directions, (3, ...), are broadcast against each other.
        """
        approach = _dot(self.normal, directions)
        height = _dot(self.normal, np.asarray(self.origin_m)) - _dot(self.normal, origins_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            times = height / approach
        times = np.where(times > 1e-9, times, np.inf)
        points = origins_m + np.where(np.isfinite(times), times, np.nan) * directions
        return np.where(self._holds(points), times, np.inf)

    def _holds(self, points_m: Float) -> Bool:
        left, right, low, high = self.extents_m
        offset = points_m - np.asarray(self.origin_m).reshape(3, *[1] * (points_m.ndim - 1))
        u, v = _dot(np.asarray(self.across), offset), _dot(np.asarray(self.along), offset)
        return np.asarray((u >= left) & (u <= right) & (v >= low) & (v <= high))

    def patches(self, count: int) -> tuple[Float, float]:
        """Return the centres of count × count equal patches, (3, count²), and the area of one in m²."""
        left, right, low, high = self.extents_m
        steps = (np.arange(count) + 0.5) / count
        u, v = np.meshgrid(left + (right - left) * steps, low + (high - low) * steps)
        centres = (
            np.asarray(self.origin_m)[:, None]
            + np.asarray(self.across)[:, None] * u.ravel()
            + np.asarray(self.along)[:, None] * v.ravel()
        )
        return centres, (right - left) * (high - low) / count**2


@dataclass(frozen=True)
class Hits:
    """The points of surfaces that the pixels see.

    Attributes:
        points_m: (3, Y, X), NaN where a pixel sees nothing.
        normals: (3, Y, X), unit normals that face the camera.
        albedo: (Y, X), 0 where a pixel sees nothing.
        surface: (Y, X), index of the surface, −1 for none.
    """

    points_m: Float
    normals: Float
    albedo: Float
    surface: np.ndarray[tuple[int, ...], np.dtype[np.intp]]

    @property
    def ranges_m(self) -> Float:
        """Distance from the camera, (Y, X)."""
        return np.asarray(np.linalg.norm(self.points_m, axis=0))

    def of_surface(self, index: int) -> "Hits":
        """Return the hits of the pixels that see one surface, as a single row, (3, 1, n) and (1, n)."""
        chosen = self.surface == index
        return Hits(
            self.points_m[:, chosen][:, None],
            self.normals[:, chosen][:, None],
            self.albedo[chosen][None],
            self.surface[chosen][None],
        )

    @property
    def irradiance(self) -> Float:
        """Irradiance by the camera's light, cos/r² in 1/m², (Y, X); 0 where a pixel sees nothing."""
        return irradiance(self.points_m, self.normals)


def hits(surfaces: tuple[Surface, ...], rays: Float, /) -> Hits:
    """Return the nearest point of a surface that each ray from the camera meets; rays are (3, Y, X)."""
    times = np.stack([surface.distances(np.zeros((3, 1, 1)), rays) for surface in surfaces])
    nearest = np.argmin(times, axis=0)
    reach = np.take_along_axis(times, nearest[None], axis=0)[0]
    seen = np.isfinite(reach)
    points = np.where(seen, reach, np.nan) * rays
    normals = np.moveaxis(np.array([surface.normal for surface in surfaces])[nearest], -1, 0)
    normals = np.where(_dot3(normals, rays) > 0, -normals, normals)
    albedo = np.where(seen, np.array([surface.albedo for surface in surfaces])[nearest], 0.0)
    return Hits(points, normals, albedo, np.where(seen, nearest, -1))


def irradiance(points_m: Float, normals: Float, /) -> Float:
    """Return cos/r² of light from the origin on points with the given normals, 0 on the back of a surface and at NaN."""
    squared = _dot3(points_m, points_m)
    cosine = -_dot3(points_m, normals) / np.sqrt(squared)
    return np.nan_to_num(np.maximum(cosine, 0.0) / squared)


def cosine_directions(count: int) -> Float:
    """Return directions about the z axis, (3, count); their density is the cosine of the angle to the axis over π.

    Each direction stands for an equal share of the light that a flat surface receives from a uniformly bright hemisphere. The
    directions lie on a Fibonacci spiral, which lines up with no edge of a scene.
    """
    index = np.arange(count) + 0.5
    squared_sine, turn = index / count, math.pi * (3.0 - math.sqrt(5.0)) * index
    sine = np.sqrt(squared_sine)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - squared_sine)])


@dataclass(frozen=True)
class Bounce:
    """Light that reaches the seen points by way of another surface.

    Attributes:
        irradiance: (B, Y, X), by each of B ways, in 1/m², the unit of the irradiance by the camera's own light.
        lengths_m: (B, Y, X), length of each way from the light to the point; 0 if a way carries no light.
    """

    irradiance: Float
    lengths_m: Float


def bounce_by_directions(seen: Hits, other: Surface, /, *, count: int) -> Bounce:
    """Follow `count` directions from every seen point to another surface and on to the light.

    This is for surfaces that fill much of each other's view, such as the two sides of a corner. Each direction stands for an
    equal share of the hemisphere's cosine-weighted solid angle, so it brings ρ E / count.
    """
    local = cosine_directions(count)[:, :, None, None]
    across, along = _tangents(seen.normals)
    directions = local[0] * across[:, None] + local[1] * along[:, None] + local[2] * seen.normals[:, None]
    times = other.distances(seen.points_m[:, None], directions)
    times = np.where(np.isfinite(times), times, np.nan)
    points = seen.points_m[:, None] + times * directions
    towards = np.where(_dot(other.normal, points) > 0, -1.0, 1.0)
    lit = irradiance(points, other.normal.reshape(3, 1, 1, 1) * towards)
    return Bounce(other.albedo * lit / count, np.nan_to_num(times + np.sqrt(_dot3(points, points))))


def bounce_by_patches(seen: Hits, other: Surface, /, *, count: int) -> Bounce:
    """Return the light that comes to every seen point by way of each of count² patches of another surface.

    This is for surfaces that are small or far in each other's view. A patch of area dA brings (ρ E / π) cos cos dA / d², with
    the cosines at both ends of the way.
    """
    centres, area = other.patches(count)
    towards = -1.0 if float(other.normal @ np.asarray(other.origin_m)) > 0 else 1.0
    normal = other.normal * towards
    lit = irradiance(centres, np.broadcast_to(normal[:, None], centres.shape))
    ways = seen.points_m[:, None] - centres[:, :, None, None]
    squared = _dot3(ways, ways)
    leaving = np.maximum(_dot(normal, ways), 0.0)
    arriving = np.maximum(-_dot3(ways, seen.normals[:, None]), 0.0)
    share = other.albedo / math.pi * lit[:, None, None] * leaving * arriving / squared**2 * area
    lengths = np.sqrt(squared) + np.linalg.norm(centres, axis=0)[:, None, None]
    return Bounce(share, np.where(share > 0, lengths, 0.0))


def spread_over(seen: Hits, bounces: dict[int, Bounce], /, *, ways: int) -> Bounce:
    """Return the light on all pixels, (ways, Y, X), from the light on the pixels of each surface, (ways, 1, n)."""
    whole = np.zeros((2, ways, *seen.surface.shape))
    for index, bounce in bounces.items():
        whole[:, :, seen.surface == index] = bounce.irradiance[:, 0], bounce.lengths_m[:, 0]
    return Bounce(whole[0], whole[1])


def _dot(vector: Float, field: Float) -> Float:
    """Return the product of one vector, (3,), with a field of vectors, (3, ...)."""
    return np.tensordot(vector, field, axes=1)


def _dot3(first: Float, second: Float) -> Float:
    """Return the product of two fields of vectors along their first axis."""
    return np.asarray((first * second).sum(axis=0))


def _tangents(normals: Float) -> tuple[Float, Float]:
    """Return two unit vectors at right angles to each normal, (3, Y, X); no normal may be along y, the vertical."""
    up = np.zeros_like(normals)
    up[1] = 1.0
    across = np.cross(up, normals, axis=0)
    across /= np.linalg.norm(across, axis=0)
    return across, np.cross(normals, across, axis=0)
