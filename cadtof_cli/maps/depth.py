"""Paths → depth maps in metres and volts; a pixel whose amplitude exceeds the modulation amplitude gets no answer."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import CONFIDENCE, EFFECTIVE_PIXELS, Layer, LayerSource
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.status import StatusBit

if TYPE_CHECKING:
    from cadtof_cli.optics import LampBeside
    from cadtof_cli.resolver.paths import ResolvedPaths


SIGMAS = 5.0
"""By how much noise may let amplitudes exceed the modulation amplitude, in units of the sum of the harmonics' standard
deviations in the dark. Noise reaches far less when all light is the laser's (`tests/maps/test_impossible.py`)."""

UNKNOWN_SHARE = 0.01
"""Relative error that the stated modulation amplitude of a camera may have: it is given with a few digits."""

_BLOCK_PIXELS = 2**18
"""Pixels in a block of sums of amplitudes: sums over a whole frame of many megapixels would take as much memory as its
maps."""

_KEPT = np.uint32(StatusBit.CALIBRATED | StatusBit.POOLED)
"""Bits that say nothing about a pixel's answer."""


@dataclass(frozen=True, eq=False)
class DepthScale:
    """How paths become metres and volts.

    `metres_per_radian` is c·T1/(4π). `planar_per_range`, float64 (Y·X,), is the factor from range to z depth (None:
    depth is range). `range_offset_m`, float64 (Y·X,), is the length that the lens adds to every range (None: 0). `lamp`
    is the lamp beside the camera (None: it is at the camera).
    """

    metres_per_radian: float
    amplitude_v: float
    planar_per_range: Float | None = None
    range_offset_m: Float | None = None
    lamp: "LampBeside | None" = None

    def metres(self, block: slice, /) -> float | Float:
        """Return the metres of depth that a radian stands for: one number for all pixels, or one for each pixel of a
        block, (n,)."""
        if self.planar_per_range is None:
            return self.metres_per_radian
        return self.metres_per_radian * self.planar_per_range[block]

    def phase_offset_rad(self, block: slice, /) -> Float | None:
        """Return the phase that the lens adds in every pixel of a block, (n,); None: 0."""
        return None if self.range_offset_m is None else self.range_offset_m[block] / self.metres_per_radian

    def from_camera(self, depth: Float | Float32, block: slice, /) -> Float:
        """Return depths from the camera, (n,), from those that half the ways of the light stand for.

        `block` holds the flat indices of the pixels in the frame.
        """
        if self.lamp is None:
            return depth.astype(np.float64)
        return np.asarray(self.lamp.range_m(self._half_way_m(depth, self.lamp, block), block) * self._planar(block))

    def sigma_from_camera(self, sigma: Float | Float32, depth: Float | Float32, block: slice, /) -> Float:
        """Return standard deviations of depths from the camera, (n,), from those of `depth`.

        `depth`, (n,), is what half the ways of the light stand for. `block` holds the flat indices of the pixels in the frame.
        """
        if self.lamp is None:
            return sigma.astype(np.float64)
        return sigma * self.lamp.range_per_half_way(self._half_way_m(depth, self.lamp, block), block)

    def _half_way_m(self, depth: Float | Float32, lamp: "LampBeside", block: slice) -> Float:
        """Return half the ways of the light, (n,), for which depths stand.

        No light goes a shorter way than from the lamp straight to the camera. What seems to do so comes from beyond the
        unambiguous range.
        """
        half_way, span = depth.astype(np.float64) / self._planar(block), 2.0 * np.pi * self.metres_per_radian
        turns = np.floor((lamp.distance_m - half_way) / span) + 1.0
        return np.where(half_way <= lamp.distance_m, half_way + turns * span, half_way)

    def _planar(self, block: slice) -> Float | float:
        return 1.0 if self.planar_per_range is None else self.planar_per_range[block]

    def source(self, resolved: "ResolvedPaths", block: slice, /, *, samples: Float | None) -> LayerSource:
        """Return the source of all layers of a block of the frame's pixels."""
        averaged = 1.0 if samples is None else samples
        return LayerSource(resolved, averaged, self.metres(block), self.amplitude_v, self.phase_offset_rad(block))


def write_block(maps: DepthMaps, block: slice, source: LayerSource, /, *, layers: tuple[Layer, ...]) -> None:
    """Fill the maps' pixels of a block of flat indices: every layer by its own rule, and the status."""
    with np.errstate(over="ignore", invalid="ignore"):
        for plane, layer in zip(maps.values.reshape(len(layers), -1), layers, strict=True):
            values = plane[block]
            np.multiply(*layer.value(source), out=values, casting="same_kind")
            # the sign bit of a computed NaN depends on the processor
            values[np.isnan(values)] = np.nan
    maps.status.reshape(-1)[block] = source.resolved.status


def most_volts(noise: NoiseModel, amplitude_v: float, /) -> tuple[float, float]:
    """Return the largest possible sum of a pixel's amplitudes, in V, and the noise of one recorded pixel that comes on top.

    If no pixel is a mean over several, the first number contains the noise already, the second is 0, and the sum is
    rounded to float32 as amplitudes are when they are written.
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
    """Return the pixels, (n,), in which the sum of the K amplitudes, (n,) each, or the first phasor, (n,), exceeds its limit.

    The limit is the modulation amplitude with an allowance for noise. `longest` is the length of the longest first
    phasor that a path of amplitude 1 gives: 1.23 at the peaks of a triangle.
    """
    most_v, noise_v = most_volts(noise, amplitude_v)
    most: Float | float = most_v if noise.samples is None else most_v + noise_v / np.sqrt(noise.samples)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.fmax(amplitudes[0], np.float32(0.0))
        for values in amplitudes[1:]:
            total = np.fmax(values, np.float32(0.0)) + total
        beyond: Bool = (total > most) | (confidence > most * longest)
    return beyond


def clear_impossible(maps: DepthMaps, /, *, noise: NoiseModel, amplitude_v: float, longest: float) -> None:
    """Set `IMPOSSIBLE`, and NaN in every layer that follows from the phasors, in pixels whose amplitudes exceed the
    modulation amplitude.

    Amplitudes of paths are shares of all light, so their sum is at most the modulation amplitude, and the confidence is
    at most `longest` times that (see `beyond_light`). A phasor of 1e50 has no paths in floating point, so a pixel
    without an answer and without a status bit that explains it is impossible, too. Every pixel is judged alone, by the
    values that are written, so the decision does not depend on the code that resolved the pixel.
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
    """Set `IMPOSSIBLE`, and NaN in every layer that follows from the phasors, in the pixels that `impossible`, (n,),
    names."""
    for name in maps.names:
        if name != EFFECTIVE_PIXELS:
            np.copyto(maps.layer(name).reshape(-1), np.nan, where=impossible)
    status = maps.status.reshape(-1)
    np.copyto(status, (status & _KEPT) | np.uint32(StatusBit.IMPOSSIBLE), where=impossible)
