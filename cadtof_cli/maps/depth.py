"""Paths → depth maps: metres and volts, and no answer where the amplitudes are beyond what the modulation can record."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import CONFIDENCE, DIRECT_DEPTH, EFFECTIVE_PIXELS, Layer, LayerSource
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.status import StatusBit

if TYPE_CHECKING:
    from cadtof_cli.optics import LampBeside
    from cadtof_cli.resolver.paths import ResolvedPaths


SIGMAS = 5.0
"""Noise that an amplitude may exceed the modulation by, in the sum of the harmonics' standard deviations in the dark: far more
than noise does where all light is the laser's (`tests/maps/test_impossible.py`)."""

UNKNOWN_SHARE = 0.01
"""Share that a camera's modulation amplitude may be off by as it is stated, with a few digits."""

_BLOCK_PIXELS = 2**18
"""Pixels whose amplitudes are added up at a time: sums over a frame of many megapixels would take as much as its maps."""

_KEPT = np.uint32(StatusBit.CALIBRATED | StatusBit.POOLED)
"""Bits that say nothing of a pixel's answer."""


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
        assert self.lamp is not None
        depth = maps.layer(DIRECT_DEPTH).reshape(-1)
        block = slice(first, first + depth.size)
        planar: Float | float = 1.0 if self.planar_per_range is None else self.planar_per_range[block]
        depth[:] = self.lamp.range_m(depth.astype(np.float64) / planar, block) * planar

    def source(self, resolved: "ResolvedPaths", block: slice, /, *, samples: Float | None) -> LayerSource:
        """Return what the layers of a block of the frame's pixels follow from."""
        averaged = 1.0 if samples is None else samples
        return LayerSource(resolved, averaged, self.metres(block), self.amplitude_v, self.phase_offset_rad(block))


def write_block(maps: DepthMaps, block: slice, source: LayerSource, /, *, layers: tuple[Layer, ...]) -> None:
    """Fill the maps' pixels of a block of flat indices: every layer by its own rule, and the status."""
    with np.errstate(over="ignore", invalid="ignore"):
        for plane, layer in zip(maps.values.reshape(len(layers), -1), layers, strict=True):
            values = plane[block]
            np.multiply(*layer.value(source), out=values, casting="same_kind")
            # processors disagree about the sign of a NaN that they make
            values[np.isnan(values)] = np.nan
    maps.status.reshape(-1)[block] = source.resolved.status


def most_volts(noise: NoiseModel, amplitude_v: float, /) -> tuple[float, float]:
    """Return what amplitudes may add up to, in V: this much, and the noise of one recorded pixel on top.

    Where every pixel is one recorded, both are in the first, rounded as amplitudes are that are written.
    """
    most = (1.0 + UNKNOWN_SHARE) * amplitude_v
    volts = float(sum(math.sqrt(one.dark_variance) for one in noise.each)) * SIGMAS * amplitude_v
    return (most, volts) if noise.samples is not None else (float(np.float32(most + volts)), 0.0)


def beyond_light(
    amplitudes: Sequence[Float | Float32] | Float,
    confidence: Float | Float32,
    /,
    *,
    noise: NoiseModel,
    amplitude_v: float = 1.0,
    longest: float = 1.0,
) -> Bool:
    """Return where paths, K of (n,), or the first phasor, (n,), hold more light than there can be.

    `longest` is the length of the longest first phasor that a path of amplitude 1 gives: 1.23 at the peaks of a triangle.
    """
    one, volts = most_volts(noise, amplitude_v)
    most: Float | float = one if noise.samples is None else one + volts / np.sqrt(noise.samples)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.fmax(amplitudes[0], np.float32(0.0))
        for values in amplitudes[1:]:
            total = np.fmax(values, np.float32(0.0)) + total
        beyond: Bool = (total > most) | (confidence > most * longest)
    return beyond


def clear_impossible(maps: DepthMaps, /, *, noise: NoiseModel, amplitude_v: float, longest: float = 1.0) -> None:
    """Set `IMPOSSIBLE`, and NaN in every layer that follows from the phasors, where the paths hold more light than there can be.

    The paths' amplitudes are shares of all light, so their sum is at most the modulation's amplitude, and the confidence at most
    `longest` times that (see `beyond_light`). A phasor of 1e50 has no paths in floating point: a pixel without an answer and
    without a reason is impossible, too.
    Every pixel is looked at alone, in the values that are written, so that whatever resolved it decides the same.
    """
    amplitudes = [maps.layer(name).reshape(-1) for name in maps.names if name.endswith(".amplitude")]
    confidence, status = maps.layer(CONFIDENCE).reshape(-1), maps.status.reshape(-1)
    impossible = np.empty(confidence.size, np.bool_)
    for start in range(0, confidence.size, _BLOCK_PIXELS):
        here = slice(start, min(start + _BLOCK_PIXELS, confidence.size))
        of_block = [values[here] for values in amplitudes]
        impossible[here] = beyond_light(
            of_block, confidence[here], noise=noise[here], amplitude_v=amplitude_v, longest=longest
        )
        impossible[here] |= np.isnan(amplitudes[0][here]) & ((status[here] & ~_KEPT) == 0)
    if impossible.any():
        clear_pixels(maps, impossible)


def clear_pixels(maps: DepthMaps, impossible: Bool, /) -> None:
    """Set `IMPOSSIBLE` in some pixels, (n,), and NaN in every layer that follows from their phasors."""
    for name in maps.names:
        if name != EFFECTIVE_PIXELS:
            np.copyto(maps.layer(name).reshape(-1), np.nan, where=impossible)
    status = maps.status.reshape(-1)
    np.copyto(status, (status & _KEPT) | np.uint32(StatusBit.IMPOSSIBLE), where=impossible)
