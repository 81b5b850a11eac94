"""Where pixels look: the pinhole that turns ranges into planar depths. Sizes of the array are (Y, X) everywhere."""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError


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


def principal_point(optics: Optics, pixels: tuple[int, int], /) -> tuple[float, float]:
    """Return the column and row where the optical axis meets the array: its middle, where they are not given."""
    return optics.principal_point_px or ((pixels[1] - 1) / 2.0, (pixels[0] - 1) / 2.0)


def ray_slopes(optics: Optics, pixels: tuple[int, int], /) -> tuple[Float, Float]:
    """Return X = (x − cx)/f, shape (1, X), and Y = (y − cy)/f, shape (Y, 1), of every pixel's ray.

    Raises:
        SettingsError: the focal length is unknown.
    """
    focal_length_px = known_focal_length(optics)
    cx, cy = principal_point(optics, pixels)
    x = (np.arange(pixels[1], dtype=np.float64)[np.newaxis, :] - cx) / focal_length_px
    y = (np.arange(pixels[0], dtype=np.float64)[:, np.newaxis] - cy) / focal_length_px
    return x, y


def planar_per_range(optics: Optics, pixels: tuple[int, int], /) -> Float:
    """Return z / range = 1/√(1 + X² + Y²) of every pixel, float64 (Y, X)."""
    x, y = ray_slopes(optics, pixels)
    return np.asarray(1.0 / np.sqrt(1.0 + x * x + y * y))
