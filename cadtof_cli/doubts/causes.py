"""The likely cause if stored values cannot be the voltages of a capture, and the options that mend it."""

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.phasors.voltages import sound_pixels
from cadtof_cli.records import dataclass
from cadtof_cli.units import counted

LONGEST = 1.35
"""Largest length of a phasor, in units of the modulation amplitude. Offsets of its channels may make it longer than 1;
noise comes on top."""

_MILLIVOLTS = (50.0, 1500.0)
"""Values are likely millivolts if the largest of them, divided by the modulation amplitude in V, lies between these
numbers."""

_FULL_SCALE, _BYTE = 65535.0, 255.0
"""Largest value of 16 bits, and of 8 bits."""

FULL_SCALES = (_FULL_SCALE, 16383.0, 4095.0, 1023.0)
"""Numbers by which a program may have divided counts: the largest value of 16, 14, 12 and 10 bits. A multiple of 1/255 is
one of 1/65535 also."""

_SCALED_VALUES = "or give --zero-counts and --volts-per-count of the scaled values"

SCALED_TO_ONE = f"scaled to 0 … 1, as ImageMagick writes floats: export whole numbers, {_SCALED_VALUES}"


_HALVES = {2.0 ** (bits - 1): bits for bits in (8, 10, 12, 14, 16)}
"""Stored value in the middle of a converter's range, and its bits. Most cameras have 0 V there."""


@dataclass(frozen=True)
class StoredRange:
    """A summary of the stored values of the pixels that were looked at.

    `low`, `middle` and `high` are their quantiles at 1 %, 50 % and 99 %; `whole` says whether all of them are whole
    numbers. All integers are multiples of 2 to the power of `shift`.
    """

    dtype: np.dtype[np.generic]
    low: float
    middle: float
    high: float
    whole: bool
    shift: int = 0

    @property
    def largest(self) -> float:
        """Largest magnitude."""
        return max(-self.low, self.high)

    def __str__(self) -> str:
        form = ".0f" if self.whole else ".6g"
        return f"stored values ({self.dtype}) lie between {self.low:{form}} and {self.high:{form}}"


def range_of(stored: Stored, /) -> StoredRange:
    """Return the summary of stored values of any shape, all of them finite."""
    values = stored.astype(np.float64)
    low, middle, high = (float(value) for value in np.quantile(values, (0.01, 0.5, 0.99)))
    bits = int(np.bitwise_or.reduce(stored, axis=None)) if stored.dtype.kind in "iu" else 0
    shift = max((bits & -bits).bit_length() - 1, 0)
    return StoredRange(stored.dtype, low, middle, high, whole=bool((values == np.rint(values)).all()), shift=shift)


def all_saturated(planes: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message if all pixels, (H, 2, n), are saturated; None if one is not, or if no value is finite."""
    voltage = metadata.voltage
    finite = planes[np.isfinite(planes)]
    if voltage.saturated_counts is None or not finite.size or sound_pixels(planes, voltage.saturated_counts).any():
        return None
    found, (low, high) = range_of(finite), voltage.saturated_counts
    # a real pixel stops at the limit: values beyond it show that these numbers are no counts of this camera
    beyond = found.low < low or found.high > high
    cause = _shifted_or_scaled(found, voltage, metadata.modulation.amplitude_v) if beyond else None
    return f"every pixel is saturated: {found}, expected values inside saturated_counts = [{low:g}, {high:g}]" + (
        f": {cause}" if cause else ""
    )


def likely_cause(found: StoredRange, voltage: Voltage, amplitude_v: float, /) -> str:
    """Return the probable cause in words, and the options that mend it."""
    if voltage.volts_per_count is None:
        low, high = _MILLIVOLTS
        if found.whole:
            return f"they look like counts: give --volts-per-count and --zero-counts ({_probable_zero(found.middle)})"
        if low < found.largest / amplitude_v < high:
            return "they look like millivolts: give --volts-per-count 0.001"
        return "give --volts-per-count (the volts of a stored step of 1) and --zero-counts, or correct --amplitude-v"
    return (
        _shifted_or_scaled(found, voltage, amplitude_v) or "correct --volts-per-count, --zero-counts or --amplitude-v"
    )


def _shifted_or_scaled(found: StoredRange, voltage: Voltage, amplitude_v: float) -> str | None:
    """Return how a program has probably shifted or scaled the values; None if they lie around `zero_counts`."""
    zero, step = voltage.zero, abs(voltage.volts_per_count or 1.0)

    def around_zero(middle: float) -> bool:
        return abs(middle - zero) * step < amplitude_v

    if around_zero(found.middle) or found.low <= zero <= found.high:
        return None
    if zero == 0.0:
        return f"zero_counts is 0 or not given: give --zero-counts ({_probable_zero(found.middle)})"
    is_scaled = found.dtype.kind == "f" and found.low >= 0.0 and found.high <= 1.0
    is_scaled = is_scaled and any(around_zero(found.middle * full) for full in (*FULL_SCALES, _BYTE))
    if found.dtype.kind == "f" and found.largest <= LONGEST * amplitude_v:
        likely = "like volts already: leave out zero_counts, volts_per_count and saturated_counts"
        likely += f"; or {SCALED_TO_ONE}" if is_scaled else ""
    elif is_scaled:
        likely = SCALED_TO_ONE
    elif found.dtype == np.uint8 or (found.largest <= _BYTE and around_zero(found.middle * _FULL_SCALE / _BYTE)):
        likely = f"scaled to 8 bits, as ImageMagick does with -depth 8: export 16 bits, {_SCALED_VALUES}"
    elif found.dtype.kind != "u" and found.largest * step <= LONGEST * amplitude_v:
        likely = "like counts from which the zero was subtracted: give --zero-counts 0, and saturated_counts to match"
    elif found.shift and around_zero(found.middle / 2**found.shift):
        likely = (
            f"shifted by {counted(found.shift, 'bit')}: multiply zero_counts and saturated_counts by {2**found.shift}, and "
            f"divide volts_per_count by {2**found.shift}"
        )
    else:
        return f"zero_counts = {zero:g} is far from these values: give --zero-counts ({_probable_zero(found.middle)})"
    return f"zero_counts = {zero:g} is far from these values; they look {likely}"


def _probable_zero(middle: float) -> str:
    """Return in words which stored value is probably 0 V if values lie around `middle`."""
    near = [half for half in _HALVES if 0.5 * half < middle < 1.5 * half]
    if not near:
        return f"0 V is somewhere around their middle, {middle:.6g}"
    return f"probably {near[0]:g}, half of {_HALVES[near[0]]} bits; their middle, {middle:.6g}, is only near it"
