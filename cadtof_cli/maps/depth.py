"""Paths → depth maps."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.maps.layers import (
    CHI_SQUARED,
    CONFIDENCE,
    DIRECT_AMPLITUDE,
    DIRECT_DEPTH,
    DIRECT_SIGMA,
    EFFECTIVE_PIXELS,
    MPI_AMPLITUDE,
    MPI_DEPTH,
    MPI_SIGMA,
    DepthMaps,
)
from cadtof_cli.resolver.paths import ResolvedPaths


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


def write_paths(
    paths: ResolvedPaths, /, *, scale: DepthScale, maps: DepthMaps, start: int, samples: Float | None = None
) -> None:
    """Fill the maps' pixels from flat index `start` on with the paths of a block, converting to m and V.

    A depth is c·phase·T1/(4π): the range to where the light turned back, or its z with `planar_per_range`. `samples`, (n,),
    is what the layer of effective pixels gets; None: 1.
    """
    count = paths.confidence.size
    block = slice(start, start + count)
    metres: float | Float = scale.metres_per_radian
    if scale.planar_per_range is not None:
        metres = scale.metres_per_radian * scale.planar_per_range[block]
    volts = scale.amplitude_v
    offset = scale.phase_offset_rad(block)
    layers = {
        DIRECT_DEPTH: (_without(paths.direct.phase_rad, offset), metres),
        MPI_DEPTH: (_without(paths.mpi.phase_rad, offset), metres),
        DIRECT_AMPLITUDE: (paths.direct.amplitude, volts),
        MPI_AMPLITUDE: (paths.mpi.amplitude, volts),
        DIRECT_SIGMA: (paths.direct.sigma_rad, metres),
        MPI_SIGMA: (paths.mpi.sigma_rad, metres),
        CONFIDENCE: (paths.confidence, volts),
        CHI_SQUARED: (paths.chi_squared, 1.0),
        EFFECTIVE_PIXELS: (1.0 if samples is None else samples, 1.0),
    }
    for number, path in enumerate(paths.others, start=3):
        layers |= {
            f"path{number}.depth": (_without(path.phase_rad, offset), metres),
            f"path{number}.amplitude": (path.amplitude, volts),
            f"path{number}.sigma": (path.sigma_rad, metres),
        }
    for name in maps.names:
        values, unit = layers[name]
        if values is None:
            raise ValueError(f"the resolver gave no {name}")
        layer = np.asarray(values * unit).astype(np.float32)
        maps.layer(name).reshape(-1)[block] = np.where(np.isnan(layer), np.float32(np.nan), layer)
    maps.status.reshape(-1)[block] = paths.status


def _without(phase_rad: Float, offset_rad: Float | None) -> Float:
    """Return phases less an offset; what falls below 0 comes from the end of the unambiguous range."""
    if offset_rad is None:
        return phase_rad
    corrected = phase_rad - offset_rad
    return np.where(corrected < 0.0, corrected + 2.0 * np.pi, corrected)
