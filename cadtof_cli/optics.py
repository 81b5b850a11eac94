"""Rays of pixels: their directions, the range to a flat wall, the range that field curvature adds, and a lamp beside
the camera.

Sizes of arrays are (Y, X).
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.records import dataclass


def known_focal_length(optics: Optics, /) -> float:
    """Return the focal length in pixels.

    Raises:
        SettingsError: it is unknown.
    """
    if optics.focal_length_px is None:
        raise SettingsError(
            "the optics are unknown: set focal_length_px under [optics] in capture.toml, or --focal-length-px"
        )
    return optics.focal_length_px


def ray_slopes(optics: Optics, pixels: tuple[int, int], /) -> tuple[Float, Float]:
    """Return X = (x − cx)/f, shape (1, X), and Y = (y − cy)/f, shape (Y, 1), of every pixel's ray.

    Raises:
        SettingsError: the focal length is unknown.
    """
    focal_length_px = known_focal_length(optics)
    cx, cy = optics.principal_point(pixels)
    x = (np.arange(pixels[1], dtype=np.float64)[np.newaxis, :] - cx) / focal_length_px
    y = (np.arange(pixels[0], dtype=np.float64)[:, np.newaxis] - cy) / focal_length_px
    return x, y


def planar_per_range(optics: Optics, pixels: tuple[int, int], /) -> Float:
    """Return z / range = 1/√(1 + X² + Y²) of every pixel, float64 (Y, X)."""
    x, y = ray_slopes(optics, pixels)
    return np.asarray(1.0 / np.sqrt(1.0 + x * x + y * y))


def wall_range_m(
    optics: Optics, pixels: tuple[int, int], /, *, distance_m: float, slopes: tuple[float, float] = (0.0, 0.0)
) -> Float:
    """Return the range to a flat wall, D·√(1 + X² + Y²)/(1 + αX + βY), of every pixel in m, (Y, X).

    X and Y are those of `ray_slopes`, D is the distance along the optical axis, and the slopes (α, β) are the tilt of the wall.

    Raises:
        SettingsError: the focal length is unknown.
    """
    x, y = ray_slopes(optics, pixels)
    alpha, beta = slopes
    return np.asarray(distance_m * np.sqrt(1.0 + x * x + y * y) / (1.0 + alpha * x + beta * y))


def squared_field_radius(pixels: tuple[int, int], principal_point_px: tuple[float, float], /) -> Float:
    """Return ρ² of every pixel, float64 (Y, X): ρ is the distance from the principal point, over half the array's
    diagonal."""
    height, width = pixels
    column, row = principal_point_px
    x, y = np.arange(width)[np.newaxis, :] - column, np.arange(height)[:, np.newaxis] - row
    return np.asarray((x * x + y * y) / (0.25 * (height * height + width * width)))


def curvature_m(
    pixels: tuple[int, int], principal_point_px: tuple[float, float], coefficients_m: tuple[float, float], /
) -> Float:
    """Return the length Δ(ρ) = k2 ρ² + k4 ρ⁴ that the lens adds to the range of every pixel, in m, float64 (Y, X)."""
    squared = squared_field_radius(pixels, principal_point_px)
    k2, k4 = coefficients_m
    return squared * (k2 + k4 * squared)


@dataclass(frozen=True, eq=False)
class LampBeside:
    """A lamp beside the camera: half the way of the light → range from the camera.

    The lamp stands at o, and the light returns from a point at the range d along a unit ray r. Its way is 2h = |d·r − o| + d.
    Solved for |d·r − o| and squared, this is linear in d: d = (h² − |o|²/4)/(h − o·r/2).

    Attributes:
        along_m: o·r/2 of every pixel, float64 (Y·X,).
        distance_m: |o|/2, the smallest possible h.
    """

    along_m: Float
    distance_m: float

    @classmethod
    def of(cls, optics: Optics, pixels: tuple[int, int], /) -> "LampBeside | None":
        """Return the lamp that the optics name, for an array (Y, X); None if it is at the camera.

        Raises:
            SettingsError: the lamp is beside the camera, and the focal length is unknown.
        """
        offset = optics.lamp_offset_m
        if offset is None or not any(offset):
            return None
        x, y = ray_slopes(optics, pixels)
        right, down, forward = offset
        along = (right * x + down * y + forward) / np.sqrt(1.0 + x * x + y * y)
        return cls(0.5 * along.ravel(), 0.5 * float(np.linalg.norm(offset)))

    def range_m(self, half_way_m: Float, pixels: slice, /) -> Float:
        """Return the ranges of consecutive pixels, (n,), from half the ways of their light, which exceed `distance_m`."""
        return (half_way_m * half_way_m - self.distance_m**2) / (half_way_m - self.along_m[pixels])

    def range_per_half_way(self, half_way_m: Float, pixels: slice, /) -> Float:
        """Return by how much the ranges of consecutive pixels, (n,), grow per metre of half the way of their light.

        It is more than 1 where the lamp is to one side of the pixel's ray. Half the ways must exceed `distance_m`.
        """
        return (2.0 * half_way_m - self.range_m(half_way_m, pixels)) / (half_way_m - self.along_m[pixels])

    def half_way_m(self, range_m: Float, /) -> Float:
        """Return half the ways of the light, (N, n), from the ranges from the camera, (N, n), of all n pixels."""
        to_lamp = np.sqrt(range_m * (range_m - 4.0 * self.along_m) + 4.0 * self.distance_m**2)
        return np.asarray(0.5 * (range_m + to_lamp))
