"""Paths → depth maps."""

from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import DIRECT_DEPTH, Layer, LayerSource
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.optics.lamp import LampBeside
    from cadtof_cli.resolver.paths import ResolvedPaths


@dataclass(frozen=True, eq=False)
class DepthScale:
    """How paths become metres and volts.

    `metres_per_radian` is c·T1/(4π); `planar_per_range`, float64 (Y·X,), turns range into z depth (None: range is kept);
    `range_offset_m`, float64 (Y·X,), is what the lens adds to every range (None: nothing); `lamp` says where the light comes
    from (None: from the camera).
    """

    metres_per_radian: float
    amplitude_v: float
    planar_per_range: Float | None = None
    range_offset_m: Float | None = None
    lamp: "LampBeside | None" = None

    def metres(self, block: slice, /) -> float | Float:
        """Return the metres that a radian stands for, of all pixels or of each of a block, (n,)."""
        if self.planar_per_range is None:
            return self.metres_per_radian
        return self.metres_per_radian * self.planar_per_range[block]

    def phase_offset_rad(self, block: slice, /) -> Float | None:
        """Return what the lens adds to every phase of a block, (n,); None: nothing."""
        return None if self.range_offset_m is None else self.range_offset_m[block] / self.metres_per_radian

    def measure_from_camera(self, maps: DepthMaps, first: int, /) -> None:
        """Turn direct depths, of pixels from a flat index on, from half the way of the light to that from the camera."""
        if self.lamp is None:
            return
        depth = maps.layer(DIRECT_DEPTH).reshape(-1)
        block = slice(first, first + depth.size)
        planar: Float | float = 1.0 if self.planar_per_range is None else self.planar_per_range[block]
        depth[:] = self.lamp.range_m(depth.astype(np.float64) / planar, block) * planar

    def source(self, resolved: "ResolvedPaths", block: slice, /, *, samples: Float | None) -> LayerSource:
        """Return what the layers of a block of the frame's pixels follow from."""
        averaged = 1.0 if samples is None else samples
        return LayerSource(resolved, averaged, self.metres(block), self.amplitude_v, self.phase_offset_rad(block))


def empty_maps(height: int, width: int, /, *, layers: tuple[Layer, ...]) -> DepthMaps:
    """Return uninitialised maps of the given size, for the blocks of a frame to be written into."""
    names = tuple(layer.name for layer in layers)
    return DepthMaps(names, np.empty((len(names) + 1, height, width), np.float32), np.empty((height, width), np.uint32))


def write_block(maps: DepthMaps, block: slice, source: LayerSource, /, *, layers: tuple[Layer, ...]) -> None:
    """Fill the maps' pixels of a block of flat indices: every layer by its own rule, and the status."""
    for plane, layer in zip(maps.values.reshape(len(layers), -1), layers, strict=True):
        values = plane[block]
        with np.errstate(over="ignore", invalid="ignore"):
            np.multiply(*layer.value(source), out=values, casting="same_kind")
        # processors disagree about the sign of a NaN that they make
        values[np.isnan(values)] = np.nan
    maps.status.reshape(-1)[block] = source.resolved.status
