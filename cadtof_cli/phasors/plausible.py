"""Whether what a frame holds can be a recording of the capture that its metadata describe: its values, and its planes.

No light gives a phasor longer than the modulation amplitude: SC1² + SC2² ≤ amplitude_v², but for noise and offsets. Counts taken
for volts, a zero or a unit that is missing, or values that a program has scaled, are beyond that by far.

No two recordings are the same, and none holds one value while others scatter: noise sees to that.
"""

import math
from itertools import combinations

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.causes import LONGEST, all_saturated, likely_cause, range_of
from cadtof_cli.phasors.noise import NoiseModel, ambient_noise_v
from cadtof_cli.phasors.voltages import sound_pixels, volts_per_count

LOOKED_AT = 4096
"""Pixels that a frame is judged by, spread evenly over it."""

FEWEST_ALIKE = 16
"""Pixels from which on their holding the same is no accident."""

FEWEST = 64
"""Pixels from which on planes say something about a frame."""

TOO_MANY = 0.25
"""Share of sound pixels with a phasor that is too long which is not the doing of a few bad ones."""

SCATTER_STEPS = 2.0
"""Median difference of neighbours, in steps of whole numbers, from which on no plane of a frame can hold one value."""

_FEW_VALUES = 8
"""Values in a plane, such as that of saturated pixels, up to which another may hold the same in the same places."""

_HEAD = 16
"""Pixels that tell of nearly all planes that they are recordings."""


def implausible(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return why stored values, (H, 2, …), cannot be the voltages that the metadata make of them; None where they can.

    A plane that cannot have been recorded is among the reasons. NaN and saturated pixels are left out.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    some = spread_over(stored, LOOKED_AT)
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
        return all_saturated(stored.reshape(*stored.shape[:2], -1), metadata, kind)
    values = some[:, :, sound].astype(np.float64)
    volts = (values - voltage.zero) * volts_per_count(voltage, kind)
    amplitude = metadata.modulation.amplitude_v
    beyond = np.hypot(volts[:, 0], volts[:, 1]) > longest
    if beyond.mean(axis=1).max() <= TOO_MANY:
        return None
    found = range_of(values, kind)
    largest = float(np.quantile(np.abs(volts), 0.99))
    return (
        f"{found}, which would be voltages up to {largest:.4g} V, beyond modulation.amplitude_v = {amplitude:g} V: "
        f"{likely_cause(found, voltage, amplitude)}"
    )


def require_plausible(stored: Stored, metadata: CaptureMetadata, /, *, of: object) -> None:
    """Raise FrameError, which names the frame that stored values are `of`, where these cannot be voltages."""
    if wrong := implausible(stored, metadata):
        raise FrameError(f"{of}: {wrong}")


def no_recording(planes: Stored, harmonics: tuple[int, ...], /) -> str | None:
    """Return which plane of a frame's pixels, (H, 2, n), cannot have been recorded; None where all can."""
    rows = planes.reshape(-1, planes.shape[2])
    heads = [row.tobytes() for row in rows[:, :_HEAD]]
    one_value = [head == head[: rows.itemsize] * _HEAD for head in heads]
    # of nearly all frames, this tells
    if rows.shape[1] < FEWEST or (len(set(heads)) == len(heads) and not any(one_value)):
        return None
    names = plane_names(harmonics)
    constant = [bool((row == row[0]).all()) for row in rows]
    for name, other in combinations(range(len(rows)), 2):
        if np.array_equal(rows[name], rows[other]) and np.unique(rows[name]).size > _FEW_VALUES:
            return (
                f"{names[other]} holds the same values as {names[name]} in every pixel, as no two recordings do: it was "
                "written twice, or its buffer was not filled"
            )
    if any(constant) and scatters(rows, SCATTER_STEPS):
        place = constant.index(True)
        return f"{names[place]} holds {rows[place, 0]:g} in every pixel, and other planes scatter: it was not recorded"
    return None


def spread_over(stored: Stored, count: int, /) -> Stored:
    """Return about so many pixels of a frame, (H, 2, …), spread evenly over it, (H, 2, n); all where it has no more."""
    planes = stored.reshape(*stored.shape[:2], -1)
    return planes[:, :, :: max(1, planes.shape[2] // count)]


def plane_names(harmonics: tuple[int, ...], /) -> list[str]:
    """Return what the planes of a frame are called, in the order in which they are stored."""
    return [f"H{harmonic}.SC{channel}" for harmonic in harmonics for channel in (1, 2)]


def scatters(rows: Stored, steps_of_whole_numbers: float, /) -> bool:
    """Return whether neighbours in some plane, (planes, n), differ in the middle by more than so many steps, if there are any."""
    least = steps_of_whole_numbers if rows.dtype.kind in "iu" else 0.0
    with np.errstate(invalid="ignore"):
        steps = np.abs(np.diff(rows.astype(np.float64), axis=1))
    known = (row[np.isfinite(row)] for row in steps)
    return any(float(np.median(row)) > least for row in known if row.size)


def is_without_noise(stored: Stored, noise: NoiseModel, /) -> bool:
    """Return whether all pixels, (H, 2, n), hold the same values, where noise makes that impossible.

    It does so wherever it is more than half a step of the stored values. A few pixels may agree.
    """
    count = stored.shape[2]
    # of nearly all frames, two values tell
    if count < FEWEST_ALIKE or stored[0, 0, 0] != stored[0, 0, 1] or not (stored == stored[:, :, :1]).all():
        return False
    # a step is √12 of its rounding error, whose variance is the floor: light alone has three times that, or more
    return all(one.dark_variance > 4.0 * one.floor for one in noise.each)


def _limits(metadata: CaptureMetadata, dtype: np.dtype[np.generic]) -> tuple[float, float, float]:
    """Return the longest phasor that there can be, in V, and the two stored values between which none is longer or saturated."""
    n_av, voltage = metadata.pixel.integration_length, metadata.voltage
    # with five standard deviations of the noise
    noise_v = 0.0 if n_av is None else ambient_noise_v(metadata, integration_length=n_av)
    longest = LONGEST * metadata.modulation.amplitude_v + 5.0 * noise_v
    most = longest / math.sqrt(2.0) / abs(volts_per_count(voltage, dtype))
    low, high = voltage.saturated_counts or (-math.inf, math.inf)
    return longest, max(voltage.zero - most, low), min(voltage.zero + most, high)
