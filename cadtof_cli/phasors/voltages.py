"""Stored values → phasors, a block of pixels at a time."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.response import ideal_response


@dataclass(frozen=True)
class PhasorScale:
    """How stored values become phasors: p_h = (stored − zero) · per_count[h], SC1 real and SC2 imaginary."""

    zero: float
    per_count: tuple[float, ...]
    saturated: tuple[float, float] | None
    amplitude_v: float


def phasor_scale(metadata: CaptureMetadata, dtype: np.dtype[np.generic], /) -> PhasorScale:
    """Return the scale for values stored as `dtype`: zero and gain, over the amplitude and G[h,1] of waveform and pulse.

    Raises:
        SettingsError: the values are integers and nothing says how many volts a count stands for.
    """
    modulation, voltage = metadata.modulation, metadata.voltage
    volts_per_count = voltage.volts_per_count
    if volts_per_count is None:
        if dtype.kind != "f":
            raise SettingsError(
                f"frames hold whole numbers ({dtype}), and nothing says how many volts a count is: "
                "set volts_per_count under [voltage] in capture.toml, or --volts-per-count"
            )
        volts_per_count = 1.0
    per_count = tuple(
        volts_per_count / modulation.amplitude_v / response.main.real for response in ideal_response(metadata)
    )
    return PhasorScale(voltage.zero_counts, per_count, voltage.saturated_counts, modulation.amplitude_v)


def phasors_from_voltages(stored: Stored, /, *, scale: PhasorScale) -> Complex:
    """Return normalised phasors, complex128 (H, n), from stored values (H, 2, n); NaN stays NaN.

    A phasor of 1 is the full modulation amplitude arriving at one instant: the paper's p_h of Eq. (5).
    """
    phasors = np.empty((stored.shape[0], stored.shape[2]), np.complex128)
    for phasor, channels, per_count in zip(phasors, stored, scale.per_count, strict=True):
        offset = -scale.zero * per_count
        for part, channel in zip((phasor.real, phasor.imag), channels, strict=True):
            part[:] = channel.astype(np.float64) * per_count + offset
    return phasors


def saturated_pixels(stored: Stored, /, *, scale: PhasorScale) -> Bool:
    """Return where any value of a pixel, (H, 2, n) → (n,), lies at or beyond the limits; NaN does not."""
    if scale.saturated is None:
        return np.zeros(stored.shape[2], np.bool_)
    low, high = scale.saturated
    planes = stored.reshape(-1, stored.shape[2])
    beyond = np.asarray((planes <= low).any(axis=0), np.bool_)
    beyond |= (planes >= high).any(axis=0)
    return beyond


def not_finite_pixels(phasors: Complex, /) -> Bool:
    """Return where any phasor of a pixel, (H, n) → (n,), is NaN or infinite."""
    return np.asarray(~np.isfinite(phasors).all(axis=0), np.bool_)
