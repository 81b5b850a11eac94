"""What has likely happened to stored values that cannot be the voltages of a capture, and which options mend it."""

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.phasors.voltages import sound_pixels
from cadtof_cli.records import dataclass

LONGEST = 1.35
"""Length of a phasor, over the modulation amplitude, that offsets of its channels may bring about; noise comes on top."""

_MILLIVOLTS = (50.0, 1500.0)
"""Largest value over the modulation amplitude, where a unit of a thousandth is likely."""

_FULL_SCALE, _BYTE = 65535.0, 255.0


@dataclass(frozen=True)
class StoredRange:
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
        form = ".0f" if self.whole else ".6g"
        return f"stored values ({self.dtype}) lie between {self.low:{form}} and {self.high:{form}}"


def range_of(values: Float, dtype: np.dtype[np.generic], /) -> StoredRange:
    """Return between which values those of any shape lie, which were stored as `dtype`."""
    low, middle, high = (float(value) for value in np.quantile(values, (0.01, 0.5, 0.99)))
    return StoredRange(dtype, low, middle, high, whole=bool((values == np.rint(values)).all()))


def all_saturated(planes: Stored, metadata: CaptureMetadata, dtype: np.dtype[np.generic], /) -> str | None:
    """Return what to say of pixels, (H, 2, n), that are all saturated; None where they are not, or hold nothing finite."""
    voltage = metadata.voltage
    finite = planes[np.isfinite(planes)].astype(np.float64)
    if voltage.saturated_counts is None or not finite.size or sound_pixels(planes, voltage.saturated_counts).any():
        return None
    found, (low, high) = range_of(finite, dtype), voltage.saturated_counts
    # a pixel that has had too much light, or none, stops at a limit; what lies beyond it was never such a count
    beyond = found.low < low or found.high > high
    cause = _shifted_or_scaled(found, voltage, metadata.modulation.amplitude_v) if beyond else None
    return f"every pixel is saturated: {found}, and saturated_counts = [{low:g}, {high:g}]" + (
        f": {cause}" if cause else ""
    )


def likely_cause(found: StoredRange, voltage: Voltage, amplitude_v: float, /) -> str:
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


def _shifted_or_scaled(found: StoredRange, voltage: Voltage, amplitude_v: float) -> str | None:
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
    elif found.dtype == np.uint8 or (found.largest <= _BYTE and around_zero(found.middle * _FULL_SCALE / _BYTE)):
        likely = f"scaled to 8 bits, as ImageMagick does with -depth 8: keep 16 bits, {what_now}"
    elif found.dtype.kind != "u" and found.largest * step <= LONGEST * amplitude_v:
        likely = "like counts with the zero taken out: give --zero-counts 0, and saturated_counts to match"
    else:
        return f"zero_counts = {zero:g} is far from them: give --zero-counts (their middle is {found.middle:.6g})"
    return f"zero_counts = {zero:g} is far from them; they look {likely}"
