"""Flat targets: how far each pixel looks until it meets a wall."""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.optics.pinhole import ray_slopes


def wall_range_m(
    optics: Optics, pixels: tuple[int, int], /, *, distance_m: float, slopes: tuple[float, float] = (0.0, 0.0)
) -> Float:
    """Return the range to a flat wall, D·√(1 + X² + Y²)/(1 + αX + βY), of every pixel in m, (Y, X).

    Args:
        optics: gives X = (x − cx)/f and Y = (y − cy)/f.
        pixels: (Y, X) of the array.
        distance_m: D, along the optical axis; the perpendicular distance where the wall faces the camera.
        slopes: (α, β), the tilt of the wall.

    Raises:
        SettingsError: the focal length is unknown.
    """
    x, y = ray_slopes(optics, pixels)
    alpha, beta = slopes
    return np.asarray(distance_m * np.sqrt(1.0 + x * x + y * y) / (1.0 + alpha * x + beta * y))
