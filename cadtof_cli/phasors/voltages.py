"""Stored values → volts and phasors; which pixels are sound; pixels spread evenly over a frame."""

from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, SomePixels, Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.records import dataclass


def volts_per_count(voltage: Voltage, dtype: np.dtype[np.generic], /) -> float:
    """Return the volts that one step of values stored as `dtype` stands for: 1 for floats, if the metadata say nothing else.

    Raises:
        SettingsError: the values are integers and the volts per count are unknown, or they are unsigned and the stored
            value of 0 V is unknown.
    """
    if voltage.volts_per_count is None and dtype.kind != "f":
        no_zero = voltage.zero_counts is None and dtype.kind == "u"
        raise SettingsError(
            f"frames hold whole numbers ({dtype}), and the volts per count are unknown: "
            f"set volts_per_count{' and zero_counts' * no_zero} under [voltage] in capture.toml, "
            f"or --volts-per-count{' and --zero-counts' * no_zero}"
        )
    if voltage.zero_counts is None and dtype.kind == "u":
        raise SettingsError(
            f"frames hold unsigned numbers ({dtype}), and the stored value of 0 V is unknown: "
            "set zero_counts under [voltage] in capture.toml, or --zero-counts"
        )
    return 1.0 if voltage.volts_per_count is None else voltage.volts_per_count


def volts_from_stored(stored: Stored, voltage: Voltage, /) -> Float:
    """Return stored values of any shape in V, float64; raises SettingsError as `volts_per_count` does."""
    return (stored.astype(np.float64) - voltage.zero) * volts_per_count(voltage, stored.dtype)


@dataclass(frozen=True, eq=False)
class PhasorMap:
    """The affine map from stored values to normalised phasors, for every harmonic and pixel; SC1 is real, SC2 imaginary.

    Re p = own[0]·SC1 + other[0]·SC2 + constant[0] and Im p = own[1]·SC2 + other[1]·SC1 + constant[1]. The arrays are float64
    (H, 2, n), with Re p and Im p along the second axis; n = 1 if all pixels have the same map. None stands for zeros.
    """

    own: Float
    other: Float | None = None
    constant: Float | None = None

    def __getitem__(self, pixels: SomePixels, /) -> "PhasorMap":
        """Return the maps of some of the pixels."""
        if self.own.shape[2] == 1:
            return self
        other = None if self.other is None else self.other[..., pixels]
        return PhasorMap(self.own[..., pixels], other, None if self.constant is None else self.constant[..., pixels])


def ideal_phasor_map(metadata: CaptureMetadata, dtype: np.dtype[np.generic], /) -> PhasorMap:
    """Return the map of a camera without defects: zero and volts per count, over the amplitude and G[h,1] of waveform
    and pulse.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    volts = volts_per_count(metadata.voltage, dtype)
    gains = [volts / metadata.modulation.amplitude_v / response.main.real for response in ideal_response(metadata)]
    own = np.broadcast_to(np.array(gains)[:, np.newaxis, np.newaxis], (len(gains), 2, 1))
    zero = metadata.voltage.zero
    return PhasorMap(own, constant=-zero * own if zero else None)


def pixel_phasor_map(
    responses: Sequence[HarmonicResponse],
    metadata: CaptureMetadata,
    dtype: np.dtype[np.generic],
    /,
    *,
    offset_v: Float | Float32 | None,
    phase_rad: Float | None,
    gain: Float | Float32 | None,
    pixels: int,
) -> PhasorMap:
    """Return the maps that take out offset, gain, imbalance and phase, in this order.

    Args:
        responses: one for every harmonic; the terms k = ±1 are inverted here, exactly.
        metadata: zero and volts per count of the stored values, and the modulation amplitude, which is the unit of phasors.
        dtype: of the stored values.
        offset_v: (H, 2, n) V, the voltage of the pixel without light; None: 0.
        phase_rad: (H, n), the phase that the pixel adds to every path at that harmonic; None: 0.
        gain: (H, n), the factor on the pixel's voltage; None: 1.
        pixels: n.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    volts = volts_per_count(metadata.voltage, dtype)
    own, other, constant = (np.empty((len(responses), 2, pixels)) for _ in range(3))
    for row, response in enumerate(responses):
        scale = np.ones(pixels, np.complex128) if phase_rad is None else np.exp(-1j * phase_rad[row])
        amplitude_v = metadata.modulation.amplitude_v
        scale = scale / (amplitude_v if gain is None else amplitude_v * gain[row].astype(np.float64))
        first, second = (scale * response.without_mirror(np.array(unit)) for unit in (1.0 + 0.0j, 1.0j))
        own[row], other[row] = (first.real, second.imag), (second.real, first.imag)
        shift = metadata.voltage.zero * volts
        shifts = (shift, shift) if offset_v is None else offset_v[row].astype(np.float64) + shift
        constant[row, 0] = -(first.real * shifts[0] + second.real * shifts[1])
        constant[row, 1] = -(first.imag * shifts[0] + second.imag * shifts[1])
    return PhasorMap(own * volts, other * volts, constant)


def phasors_from_stored(stored: Stored, phasor_map: PhasorMap, /) -> Complex:
    """Return normalised phasors, complex128 (H, n), from stored values (H, 2, n); NaN stays NaN.

    A phasor of 1 is the full modulation amplitude arriving at one instant: the paper's p_h of Eq. (5).
    """
    phasors = np.empty((stored.shape[0], stored.shape[2]), np.complex128)
    own, other, constant = phasor_map.own, phasor_map.other, phasor_map.constant
    # no warning about infinite values: the pixel's status tells of them
    with np.errstate(over="ignore", invalid="ignore"):
        for row, phasor in enumerate(phasors):
            channels = stored[row].astype(np.float64)
            for index, part in enumerate((phasor.real, phasor.imag)):
                value = channels[index] * own[row, index]
                if other is not None:
                    value += channels[1 - index] * other[row, index]
                if constant is not None:
                    value += constant[row, index]
                part[:] = value
    return phasors


def saturated_pixels(stored: Stored, saturated_counts: tuple[float, float] | None, /) -> Bool:
    """Return the pixels, (H, 2, …) → (…), with any value at or beyond the limits; NaN is within them."""
    planes = stored.reshape(-1, *stored.shape[2:])
    if saturated_counts is None:
        return np.zeros(planes.shape[1:], np.bool_)
    low, high = saturated_counts
    beyond: Bool = np.fmin.reduce(planes) <= low
    beyond |= np.fmax.reduce(planes) >= high
    return beyond


def sound_pixels(stored: Stored, saturated_counts: tuple[float, float] | None, /) -> Bool:
    """Return the pixels, (H, 2, …) → (…), with all values finite and inside the limits."""
    planes = np.isfinite(stored).reshape(-1, *stored.shape[2:])
    return np.asarray(planes.all(axis=0) & ~saturated_pixels(stored, saturated_counts))


def spread_over(stored: Stored, count: int, /) -> Stored:
    """Return pixels, (H, 2, n), spread evenly over a frame, (H, 2, …): at least `count`, and fewer than twice as many.

    If the frame has no more than `count` pixels, all of them are returned. With some widths, they are of a few columns only.
    """
    planes = stored.reshape(*stored.shape[:2], -1)
    return planes[:, :, :: max(1, planes.shape[2] // count)]
