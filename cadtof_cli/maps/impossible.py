"""Answers that no light gives: amplitudes beyond what the modulation can record."""

import math

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

_KEPT = np.uint32(StatusBit.CALIBRATED | StatusBit.POOLED)


def most_light(noise: NoiseModel, /) -> Float | float:
    """Return the most that paths can add up to, in units of the modulation amplitude; (n,) for means of several samples."""
    sigma = SIGMAS * float(sum(math.sqrt(one.dark_variance) for one in noise.each))
    return 1.0 + UNKNOWN_SHARE + (sigma if noise.samples is None else sigma / np.sqrt(noise.samples))


def beyond_light(
    amplitudes: Float | Float32, confidence: Float | Float32, /, *, noise: NoiseModel, scale: float = 1.0
) -> Bool:
    """Return where paths, (K, n), or the first phasor, (n,), hold more light than there can be; `scale` is an amplitude of 1."""
    most = scale * most_light(noise)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.nan_to_num(amplitudes, nan=0.0, posinf=np.inf).sum(axis=0)
        beyond: Bool = (total > most) | (confidence > most)
    return beyond


def clear_impossible(maps: DepthMaps, /, *, noise: NoiseModel, amplitude_v: float) -> None:
    """Set `IMPOSSIBLE`, and NaN in every layer that follows from the phasors, where the paths hold more light than there can be.

    The paths' amplitudes are shares of all light, so their sum is at most the modulation's amplitude, and so is the confidence.
    Every pixel is looked at alone, in the values that are written, so that whatever resolved it decides the same.
    """
    amplitudes = [maps.layer(name).reshape(-1) for name in maps.names if name.endswith(".amplitude")]
    confidence = maps.layer(CONFIDENCE).reshape(-1)
    with np.errstate(invalid="ignore", over="ignore"):
        largest = [float(np.fmax.reduce(values, initial=0.0)) for values in (*amplitudes, confidence)]
    if max(sum(largest[:-1]), largest[-1]) <= amplitude_v * np.min(most_light(noise), initial=math.inf):
        return
    impossible = beyond_light(np.stack(amplitudes), confidence, noise=noise, scale=amplitude_v)
    for name in maps.names:
        if name != "effective_pixels":
            np.copyto(maps.layer(name).reshape(-1), np.nan, where=impossible)
    status = maps.status.reshape(-1)
    np.copyto(status, (status & _KEPT) | np.uint32(StatusBit.IMPOSSIBLE), where=impossible)
