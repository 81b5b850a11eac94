"""Answers that no light gives: amplitudes beyond what the modulation can record."""

import math
from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import CONFIDENCE
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.status import StatusBit

SIGMAS = 5.0
"""Noise that an amplitude may exceed the modulation by, in the sum of the harmonics' standard deviations in the dark: far more
than noise does where all light is the laser's (`tests/maps/test_impossible.py`)."""

UNKNOWN_SHARE = 0.01
"""Share that a camera's modulation amplitude may be off by as it is stated, with a few digits."""

_BLOCK_PIXELS = 2**18

_KEPT = np.uint32(StatusBit.CALIBRATED | StatusBit.POOLED)


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
) -> Bool:
    """Return where paths, K of (n,), or the first phasor, (n,), hold more light than there can be."""
    one, volts = most_volts(noise, amplitude_v)
    most: Float | float = one if noise.samples is None else one + volts / np.sqrt(noise.samples)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.fmax(amplitudes[0], np.float32(0.0))
        for values in amplitudes[1:]:
            total = np.fmax(values, np.float32(0.0)) + total
        beyond: Bool = (total > most) | (confidence > most)
    return beyond


def clear_impossible(maps: DepthMaps, /, *, noise: NoiseModel, amplitude_v: float) -> None:
    """Set `IMPOSSIBLE`, and NaN in every layer that follows from the phasors, where the paths hold more light than there can be.

    The paths' amplitudes are shares of all light, so their sum is at most the modulation's amplitude, and so is the confidence.
    Every pixel is looked at alone, in the values that are written, so that whatever resolved it decides the same.
    """
    amplitudes = [maps.layer(name).reshape(-1) for name in maps.names if name.endswith(".amplitude")]
    confidence = maps.layer(CONFIDENCE).reshape(-1)
    impossible = np.empty(confidence.size, np.bool_)
    for start in range(0, confidence.size, _BLOCK_PIXELS):
        # sums over a whole frame of many megapixels would take as much as its maps
        here = slice(start, min(start + _BLOCK_PIXELS, confidence.size))
        of_block = [values[here] for values in amplitudes]
        impossible[here] = beyond_light(of_block, confidence[here], noise=noise[here], amplitude_v=amplitude_v)
    if impossible.any():
        clear_pixels(maps, impossible)


def clear_pixels(maps: DepthMaps, impossible: Bool, /) -> None:
    """Set `IMPOSSIBLE` in some pixels, (n,), and NaN in every layer that follows from their phasors."""
    for name in maps.names:
        if name != "effective_pixels":
            np.copyto(maps.layer(name).reshape(-1), np.nan, where=impossible)
    status = maps.status.reshape(-1)
    np.copyto(status, (status & _KEPT) | np.uint32(StatusBit.IMPOSSIBLE), where=impossible)
