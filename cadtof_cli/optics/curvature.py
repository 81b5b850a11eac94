"""Field curvature: what the lens adds to every range, Δ(ρ) = k2 ρ² + k4 ρ⁴.

ρ is a pixel's distance from the principal point over half the array's diagonal.
"""

import math

import numpy as np

from cadtof_cli.arrays import Float


def half_diagonal_px(pixels: tuple[int, int], /) -> float:
    """Return half the diagonal of an array of (Y, X) pixels, where ρ = 1."""
    return 0.5 * math.hypot(*pixels)


def squared_field_radius(pixels: tuple[int, int], principal_point_px: tuple[float, float], /) -> Float:
    """Return ρ² of every pixel, float64 (Y, X)."""
    height, width = pixels
    column, row = principal_point_px
    x, y = np.arange(width)[np.newaxis, :] - column, np.arange(height)[:, np.newaxis] - row
    return np.asarray((x * x + y * y) / (0.25 * (height * height + width * width)))


def curvature_m(
    pixels: tuple[int, int], principal_point_px: tuple[float, float], coefficients_m: tuple[float, float], /
) -> Float:
    """Return Δ of every pixel in m, float64 (Y, X), for the coefficients (k2, k4)."""
    squared = squared_field_radius(pixels, principal_point_px)
    k2, k4 = coefficients_m
    return squared * (k2 + k4 * squared)
