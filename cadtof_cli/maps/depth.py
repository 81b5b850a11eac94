"""Paths → depth maps."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.maps.layers import DepthMaps
from cadtof_cli.resolver.resolve import ResolvedPaths


@dataclass(frozen=True)
class DepthScale:
    """How paths become metres and volts.

    `metres_per_radian` is c·T1/(4π); `planar_per_range`, float64 (Y·X,), turns range into z depth (None: range is kept);
    `range_offset_m`, float64 (Y·X,), is what the lens adds to every range (None: nothing).
    """

    metres_per_radian: float
    amplitude_v: float
    planar_per_range: Float | None = None
    range_offset_m: Float | None = None

    def phase_offset_rad(self, block: slice) -> Float | None:
        """Return the phase that stands for the block's range offset, (n,)."""
        return None if self.range_offset_m is None else self.range_offset_m[block] / self.metres_per_radian


def write_paths(paths: ResolvedPaths, /, *, scale: DepthScale, maps: DepthMaps, start: int) -> None:
    """Fill the maps' pixels from flat index `start` on with the paths of a block, converting to m and V.

    A depth is c·phase·T1/(4π): the range to where the light turned back, or its z with `planar_per_range`.
    """
    count = paths.confidence.size
    block = slice(start, start + count)
    metres: float | Float = scale.metres_per_radian
    if scale.planar_per_range is not None:
        metres = scale.metres_per_radian * scale.planar_per_range[block]
    planes = maps.values.reshape(len(maps.names), -1)[:, block]
    offset = scale.phase_offset_rad(block)
    layers = (
        (_without(paths.direct.phase_rad, offset), metres),
        (_without(paths.mpi.phase_rad, offset), metres),
        (paths.direct.amplitude, scale.amplitude_v),
        (paths.mpi.amplitude, scale.amplitude_v),
        (paths.direct.sigma_rad, metres),
        (paths.mpi.sigma_rad, metres),
        (paths.confidence, scale.amplitude_v),
    )
    for plane, (values, unit) in zip(planes, layers, strict=True):
        np.multiply(values, unit, out=plane, casting="same_kind")
    maps.status.reshape(-1)[block] = paths.status


def _without(phase_rad: Float, offset_rad: Float | None) -> Float:
    """Return phases less an offset; what falls below 0 comes from the end of the unambiguous range."""
    if offset_rad is None:
        return phase_rad
    corrected = phase_rad - offset_rad
    corrected += np.where(corrected < 0.0, 2.0 * np.pi, 0.0)
    return corrected
