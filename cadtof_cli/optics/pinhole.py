"""Where pixels look: the pinhole that turns ranges into planar depths."""

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


def ray_slopes(optics: Optics, height: int, width: int, /) -> tuple[Float, Float]:
    """Return X = (x − cx)/f, shape (1, width), and Y = (y − cy)/f, shape (height, 1), of every pixel's ray.

    Raises:
        SettingsError: the focal length is unknown. A principal point that is not given is the middle of the array.
    """
    focal_length_px = known_focal_length(optics)
    cx, cy = optics.principal_point_px or ((width - 1) / 2.0, (height - 1) / 2.0)
    x = (np.arange(width, dtype=np.float64)[np.newaxis, :] - cx) / focal_length_px
    y = (np.arange(height, dtype=np.float64)[:, np.newaxis] - cy) / focal_length_px
    return x, y


def planar_per_range(optics: Optics, height: int, width: int, /) -> Float:
    """Return z / range = 1/√(1 + X² + Y²) of every pixel, float64 (height, width)."""
    x, y = ray_slopes(optics, height, width)
    factor: Float = 1.0 / np.sqrt(1.0 + x * x + y * y)
    return factor
