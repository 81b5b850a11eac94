"""Whether the values and the planes of a frame can be a recording of the capture that its metadata describe.

Values: no light gives a phasor longer than the modulation amplitude, so SC1² + SC2² ≤ amplitude_v², apart from noise
and offsets. Counts taken for volts, a missing zero or unit, and values that a program has scaled exceed that limit by
far.

Planes: because of noise, no two recorded planes are the same, and none holds one value everywhere, alone or with all others.
"""

import math
from itertools import combinations

import numpy as np

from cadtof_cli.arrays import Stored, even_step, plane_names
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.causes import LONGEST, all_saturated, likely_cause, range_of, scaled_to_one
from cadtof_cli.phasors.noise import NoiseModel, ambient_noise_v, noise_model
from cadtof_cli.phasors.voltages import sound_pixels, spread_over, volts_from_stored, volts_per_count

LOOKED_AT = 4096
"""A larger frame is judged by at least this many pixels, spread evenly over it."""

FEWEST_ALIKE = 16
"""Least number of pixels in a frame that cannot all hold the same values by accident."""

FEWEST = 64
"""Least number of pixels from which a fault of the planes is concluded."""

TOO_MANY = 0.25
"""Largest share of the sound pixels that may have too long a phasor at one harmonic: a few pixels may be bad."""

SCATTER_STEPS = 2.0
"""Median difference between neighbours of a plane of whole numbers, in steps. If it is larger in any plane of a frame,
no other plane of that frame can hold one value everywhere."""

_FEW_VALUES = 8
"""Two recorded planes may be the same in every pixel only if they hold at most this many different values, as planes of
saturated pixels do."""

_BIT_LOOKED_AT, _BIT_MATTERS = 1024, 0.004
"""Pixels whose bits are looked at, at least, and the least bit, as a share of the modulation amplitude: it moves depths by
millimetres."""

_GAPS, _GAP_RANGE = 2, 1.25
"""Fewest gaps that a stuck bit leaves between the values, and how many times the bit the largest of them may be. Values of
distinct surfaces have other gaps. In 1270 sound frames nothing is told."""

_HEAD = 16
"""Number of pixels at the start of each plane that are compared first: they show nearly all frames to be recordings."""


def implausible(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return why stored values, (H, 2, …), cannot be a recording with these metadata; None if they can be.

    Either a plane cannot have been recorded, or the voltages are too large. NaN and saturated pixels are left out.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    every = stored.reshape(*stored.shape[:2], -1)
    # not `spread_over`: a frame is refused here, so a few dead columns must not be all that is looked at
    some = every[:, :, :: even_step(every.shape[2], stored.shape[-1], count=LOOKED_AT)]
    voltage, together = metadata.voltage, np.ascontiguousarray(some)
    n_av, amplitude = metadata.pixel.integration_length, metadata.modulation.amplitude_v
    if wrong := no_recording(together, metadata.modulation.harmonics) or scaled_to_one(together, voltage):
        return wrong
    if _shows_no_noise(together, metadata):
        return "all pixels hold the same values, but noise makes pixels differ: the frame was not recorded"
    # five standard deviations of the noise come on top
    noise_v = 0.0 if n_av is None else ambient_noise_v(metadata, integration_length=n_av)
    longest = LONGEST * amplitude + 5.0 * noise_v
    most, zero = longest / math.sqrt(2.0) / abs(volts_per_count(voltage, stored.dtype)), voltage.zero
    low, high = voltage.saturated_counts or (-math.inf, math.inf)
    # a quick test that nearly all frames pass: no phasor is too long, and none is saturated; a comparison with NaN is false
    least, largest = (float(extreme.reduce(together, axis=None)) for extreme in (np.minimum, np.maximum))
    if max(zero - most, low) < least and largest < min(zero + most, high):
        return None
    sound = sound_pixels(some, voltage.saturated_counts)
    if not sound.any():
        return all_saturated(every, metadata)
    values = some[:, :, sound]
    volts = volts_from_stored(values, voltage)
    beyond = np.hypot(volts[:, 0], volts[:, 1]) > longest
    if beyond.mean(axis=1).max() <= TOO_MANY:
        return None
    found = range_of(values)
    largest = float(np.quantile(np.abs(volts), 0.99))
    return (
        f"{found}, which would be voltages up to {largest:.4g} V, beyond modulation.amplitude_v = {amplitude:g} V: "
        f"{likely_cause(found, voltage, amplitude)}"
    )


def stuck_bit(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message if a bit of whole numbers, (H, 2, Y, X), is the same in all pixels and leaves gaps; else None.

    Without the bit, values that rise steadily jump by twice its value, and the numbers between occur nowhere.
    """
    if stored.dtype.kind not in "iu":
        return None
    rows = spread_over(stored, _BIT_LOOKED_AT).reshape(2 * len(stored), -1)
    mask = (1 << 8 * stored.itemsize) - 1
    either, both = np.bitwise_or.reduce(rows, axis=1), np.bitwise_and.reduce(rows, axis=1)
    changing = [one & mask for one in (either ^ both).tolist()]
    changing.append(int(np.bitwise_or.reduce(either) ^ np.bitwise_and.reduce(both)) & mask)
    least = _BIT_MATTERS * metadata.modulation.amplitude_v / abs(volts_per_count(metadata.voltage, stored.dtype))
    names, groups = [*plane_names(metadata.modulation.harmonics), "all planes"], (*rows, rows)
    for place in reversed(range(len(groups))):
        for bit in range(max(1, math.ceil(math.log2(max(least, 1.0)))), changing[place].bit_length()):
            # nearly all frames have no such bit
            if not changing[place] >> bit & 1 and changing[place] & ((1 << bit) - 1) and _has_gaps(groups[place], bit):
                return (
                    f"bit {bit} ({1 << bit}) of {names[place]} is {int(groups[place].flat[0]) >> bit & 1} in every pixel, and "
                    "the values jump there: a line of the converter or of its cable is stuck. Depths are wrong by centimetres to "
                    "metres, and sigma does not say so"
                )
    return None


def _has_gaps(values: Stored, bit: int) -> bool:
    """Return whether whole numbers leave out the ranges that a stuck bit leaves out, and hardly more."""
    # `np.unique` would import numpy.ma
    there = np.sort(values, axis=None).astype(np.int64)
    gaps = np.diff(there)[np.diff(there >> bit) == 2]
    return int(np.count_nonzero(gaps <= _GAP_RANGE * (1 << bit))) >= _GAPS


class Copies:
    """Finds copies among the frames of a capture: a copy adds nothing to a mean, which would seem to have less noise than
    it has."""

    def __init__(self) -> None:
        self._originals: dict[str, str] = {}

    def original_of(self, stored: Stored, digest: str, name: object, /) -> str | None:
        """Return the name of the earlier frame with the same values, by their digest; None: there is none.

        Frames of one pixel, or of a few, may agree by chance: they are never taken for copies.
        """
        original = self._originals.get(digest)
        if original is None:
            self._originals[digest] = str(name)
        return original if stored.size >= FEWEST else None


def require_plausible(stored: Stored, metadata: CaptureMetadata, /, *, of: object) -> None:
    """Raise FrameError, which names the frame that the stored values are `of`, if they are not plausible."""
    if wrong := implausible(stored, metadata):
        raise FrameError(f"{of}: {wrong}")


def no_recording(planes: Stored, harmonics: tuple[int, ...], /) -> str | None:
    """Return a message that names a plane of a frame, (H, 2, n), that cannot have been recorded; None if there is no
    such plane."""
    rows = planes.reshape(-1, planes.shape[2])
    heads = [row.tobytes() for row in rows[:, :_HEAD]]
    one_value = [head == head[: rows.itemsize] * _HEAD for head in heads]
    # nearly all frames end here
    if rows.shape[1] < FEWEST or (len(set(heads)) == len(heads) and not any(one_value)):
        return None
    names = plane_names(harmonics)
    constant = [bool((row == row[0]).all()) for row in rows]
    for name, other in combinations(range(len(rows)), 2):
        if np.array_equal(rows[name], rows[other]) and np.unique(rows[name]).size > _FEW_VALUES:
            return (
                f"{names[other]} holds the same values as {names[name]} in every pixel, but noise makes "
                "two recordings differ: one plane was written twice, or the camera had not filled its buffer"
            )
    if any(constant) and scatters(rows, SCATTER_STEPS):
        place = constant.index(True)
        return (
            f"{names[place]} holds {rows[place, 0]:g} in every pixel, but the values of other planes differ: this plane "
            "was not recorded"
        )
    return None


def scatters(rows: Stored, steps_of_whole_numbers: float, /) -> bool:
    """Return whether the median difference between neighbours, in any of the planes (planes, n), exceeds so many steps
    of whole numbers; for floating-point values, whether it exceeds 0."""
    least = steps_of_whole_numbers if rows.dtype.kind in "iu" else 0.0
    with np.errstate(invalid="ignore"):
        steps = np.abs(np.diff(rows.astype(np.float64), axis=1))
    known = (row[np.isfinite(row)] for row in steps)
    return any(float(np.median(row)) > least for row in known if row.size)


def is_without_noise(stored: Stored, noise: NoiseModel, /) -> bool:
    """Return whether all pixels, (H, 2, n), hold the same values although noise makes that impossible.

    Noise makes it impossible if it is more than half a step of the stored values and the pixels are not just a few. If
    the noise is estimated from these pixels, it tells nothing, and they are taken for none that a camera recorded.
    """
    count = stored.shape[2]
    # two values are enough to tell for nearly all frames
    if count < FEWEST_ALIKE or stored[0, 0, 0] != stored[0, 0, 1] or not (stored == stored[:, :, :1]).all():
        return False
    # the floor is the variance of rounding to steps of s, s²/12: the rest is then more than 3·s²/12 = (s/2)²
    return noise.estimated or all(one.dark_variance > 4.0 * one.floor for one in noise.each)


def _shows_no_noise(planes: Stored, metadata: CaptureMetadata) -> bool:
    """Return whether all pixels, (H, 2, n), hold the same sound values although the capture's noise makes that impossible.

    If whole numbers may hide the noise and the integration length is unknown, nothing tells.
    """
    n_av, is_whole = metadata.pixel.integration_length, planes.dtype.kind in "iu"
    if planes.shape[2] < FEWEST or planes[0, 0, 0] != planes[0, 0, 1] or (is_whole and n_av is None):
        return False
    if not sound_pixels(planes[:, :, :1], metadata.voltage.saturated_counts).all():
        return False
    return is_without_noise(planes, noise_model(metadata, integration_length=n_av or 1.0, quantised=is_whole))
