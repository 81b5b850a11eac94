"""Whether stored values can be voltages of the capture that its metadata describe, and what is likely wrong where they cannot.

No light gives a phasor longer than the modulation amplitude: SC1² + SC2² ≤ amplitude_v², but for noise and offsets. Counts taken
for volts, a zero or a unit that is missing, or values that a program has scaled, are beyond that by far.
"""

import math
from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.recorded_planes import no_recording
from cadtof_cli.phasors.voltages import sound_pixels, volts_per_count
from cadtof_cli.records import dataclass

LONGEST = 1.35
"""Length of a phasor, over the modulation amplitude, that offsets of its channels may bring about; noise comes on top."""

TOO_MANY = 0.25
"""Share of sound pixels beyond that which is not the doing of a few bad ones."""

FEWEST = 16
"""Pixels from which on their holding the same is no accident."""

LOOKED_AT = 4096
"""Pixels that a frame is judged by, spread evenly over it."""

_MILLIVOLTS = (50.0, 1500.0)
"""Largest value over the modulation amplitude, where a unit of a thousandth is likely."""

_FULL_SCALE, _BYTE = 65535.0, 255.0


@dataclass(frozen=True)
class _Range:
    """Stored values of the pixels that were looked at: type, least, middle and largest, without the outermost percent,
    and whether all are whole numbers."""

    dtype: np.dtype[np.generic]
    low: float
    middle: float
    high: float
    whole: bool

    @property
    def largest(self) -> float:
        """Largest magnitude."""
        return max(-self.low, self.high)

    def __str__(self) -> str:
        return f"stored values ({self.dtype}) lie between {self.low:.6g} and {self.high:.6g}"


def implausible(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return why stored values, (H, 2, …), cannot be the voltages that the metadata make of them; None where they can.

    A plane that cannot have been recorded is among the reasons. NaN and saturated pixels are left out.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    planes = stored.reshape(*stored.shape[:2], -1)
    some = planes[:, :, :: max(1, planes.shape[2] // LOOKED_AT)]
    kind, voltage, together = stored.dtype, metadata.voltage, np.ascontiguousarray(some)
    if missing := no_recording(together, metadata.modulation.harmonics):
        return missing
    longest, least, largest = _limits(metadata, kind)
    # the usual case, told at a glance; a comparison with NaN is false
    if (
        least < float(np.minimum.reduce(together, axis=None))
        and float(np.maximum.reduce(together, axis=None)) < largest
    ):
        return None
    sound = sound_pixels(some, voltage.saturated_counts)
    if not sound.any():
        return _all_saturated(planes, metadata, kind)
    values = some[:, :, sound].astype(np.float64)
    volts = (values - voltage.zero) * volts_per_count(voltage, kind)
    amplitude = metadata.modulation.amplitude_v
    beyond = np.hypot(volts[:, 0], volts[:, 1]) > longest
    if beyond.mean(axis=1).max() <= TOO_MANY:
        return None
    found = _range_of(values, kind)
    largest = float(np.quantile(np.abs(volts), 0.99))
    return (
        f"{found}, which would be voltages up to {largest:.4g} V, beyond modulation.amplitude_v = {amplitude:g} V: "
        f"{_likely_cause(found, voltage, amplitude)}"
    )


def require_plausible(stored: Stored, metadata: CaptureMetadata, /, *, of: object) -> None:
    """Raise FrameError, which names the frame that stored values are `of`, where these cannot be voltages."""
    if wrong := implausible(stored, metadata):
        raise FrameError(f"{of}: {wrong}")


def is_without_noise(stored: Stored, noise: NoiseModel, /) -> bool:
    """Return whether all pixels, (H, 2, n), hold the same values, where noise makes that impossible.

    It does so wherever it is more than half a step of the stored values. A few pixels may agree.
    """
    count = stored.shape[2]
    # of nearly all frames, two values tell
    if count < FEWEST or stored[0, 0, 0] != stored[0, 0, 1] or not (stored == stored[:, :, :1]).all():
        return False
    # a step is √12 of its rounding error, whose variance is the floor: light alone has three times that, or more
    return all(one.dark_variance > 4.0 * one.floor for one in noise.each)


@lru_cache(maxsize=4)
def _limits(metadata: CaptureMetadata, dtype: np.dtype[np.generic]) -> tuple[float, float, float]:
    """Return the longest phasor that there can be, in V, and the two stored values between which none is longer or saturated."""
    n_av, voltage = metadata.pixel.integration_length, metadata.voltage
    # with five standard deviations of the noise
    longest = LONGEST + (0.0 if n_av is None else 5.0 * math.sqrt(0.5 / (2.0 * n_av - 1.0)))
    longest *= metadata.modulation.amplitude_v
    most = longest / math.sqrt(2.0) / abs(volts_per_count(voltage, dtype))
    low, high = voltage.saturated_counts or (-math.inf, math.inf)
    return longest, max(voltage.zero - most, low), min(voltage.zero + most, high)


def _range_of(values: Float, dtype: np.dtype[np.generic]) -> _Range:
    low, middle, high = (float(value) for value in np.quantile(values, (0.01, 0.5, 0.99)))
    return _Range(dtype, low, middle, high, whole=bool((values == np.rint(values)).all()))


def _all_saturated(planes: Stored, metadata: CaptureMetadata, dtype: np.dtype[np.generic]) -> str | None:
    voltage = metadata.voltage
    finite = planes[np.isfinite(planes)].astype(np.float64)
    if voltage.saturated_counts is None or not finite.size or sound_pixels(planes, voltage.saturated_counts).any():
        return None
    found, (low, high) = _range_of(finite, dtype), voltage.saturated_counts
    # a pixel that has had too much light, or none, stops at a limit; what lies beyond it was never such a count
    beyond = found.low < low or found.high > high
    cause = _shifted_or_scaled(found, voltage, metadata.modulation.amplitude_v) if beyond else None
    return f"every pixel is saturated: {found}, and saturated_counts = [{low:g}, {high:g}]" + (
        f": {cause}" if cause else ""
    )


def _likely_cause(found: _Range, voltage: Voltage, amplitude_v: float) -> str:
    """Return what has probably happened, and the options that mend it."""
    if voltage.volts_per_count is None:
        low, high = _MILLIVOLTS
        if found.whole:
            return (
                f"they look like counts: give --volts-per-count, and --zero-counts (their middle is {found.middle:.6g})"
            )
        if low < found.largest / amplitude_v < high:
            return "they look like millivolts: give --volts-per-count 0.001"
        return "give --volts-per-count, how many volts a stored step of 1 is, and --zero-counts; or mend --amplitude-v"
    return _shifted_or_scaled(found, voltage, amplitude_v) or "mend --volts-per-count, --zero-counts or --amplitude-v"


def _shifted_or_scaled(found: _Range, voltage: Voltage, amplitude_v: float) -> str | None:
    """Return what a program did to values that do not lie around `zero_counts`; None where they do, whatever a step is."""
    zero, step = voltage.zero, abs(voltage.volts_per_count or 1.0)

    def around_zero(middle: float) -> bool:
        return abs(middle - zero) * step < amplitude_v

    if around_zero(found.middle) or found.low <= zero <= found.high:
        return None
    if zero == 0.0:
        return f"nothing says which stored value is 0 V: give --zero-counts (their middle is {found.middle:.6g})"
    what_now = "or give --zero-counts and --volts-per-count for what they are now"
    scaled = f"scaled to 0 … 1, as ImageMagick writes floats: keep whole numbers, {what_now}"
    if found.dtype.kind == "f" and found.largest <= LONGEST * amplitude_v:
        likely = "like volts already: leave out zero_counts, volts_per_count and saturated_counts"
        if found.low >= 0.0 and around_zero(found.middle * _FULL_SCALE):
            likely += f"; or {scaled}"
    elif found.dtype.kind == "f" and found.low >= 0.0 and around_zero(found.middle * _FULL_SCALE):
        likely = scaled
    elif found.largest <= _BYTE and around_zero(found.middle * _FULL_SCALE / _BYTE):
        likely = f"scaled to 8 bits, as ImageMagick does with -depth 8: keep 16 bits, {what_now}"
    elif found.largest * step <= LONGEST * amplitude_v:
        likely = "like counts with the zero taken out: give --zero-counts 0, and saturated_counts to match"
    else:
        return f"zero_counts = {zero:g} is far from them: give --zero-counts (their middle is {found.middle:.6g})"
    return f"zero_counts = {zero:g} is far from them; they look {likely}"
