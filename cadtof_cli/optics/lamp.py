"""A lamp beside the camera: light goes out from one place and comes back to another."""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.optics.lens import ray_slopes
from cadtof_cli.records import dataclass


@dataclass(frozen=True, eq=False)
class LampBeside:
    """Half the way of the light → range from the camera.

    Where the lamp stands at o, the light that returns from a point at the range d along a unit ray r has gone
    2h = |d·r − o| + d. Squared, this is linear in d: d = (h² − |o|²/4)/(h − o·r/2).

    Attributes:
        along_m: o·r/2 of every pixel, float64 (Y·X,).
        distance_m: |o|/2, the least h that there can be.
    """

    along_m: Float
    distance_m: float

    @classmethod
    def of(cls, optics: Optics, pixels: tuple[int, int], /) -> "LampBeside | None":
        """Return the lamp that the optics name, for an array (Y, X); None where it is at the camera.

        Raises:
            SettingsError: there is one, and the focal length is unknown.
        """
        offset = optics.lamp_offset_m
        if offset is None or not any(offset):
            return None
        x, y = ray_slopes(optics, pixels)
        right, down, forward = offset
        along = (right * x + down * y + forward) / np.sqrt(1.0 + x * x + y * y)
        return cls(0.5 * along.ravel(), 0.5 * float(np.linalg.norm(offset)))

    def range_m(self, half_way_m: Float, pixels: slice, /) -> Float:
        """Return the ranges of a stretch of pixels, (n,), from half the ways of their light; 0 where that is too short."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges = (half_way_m * half_way_m - self.distance_m**2) / (half_way_m - self.along_m[pixels])
        return np.where(half_way_m <= self.distance_m, 0.0, ranges)
