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
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.doubts.causes import FULL_SCALES, LONGEST, SCALED_TO_ONE, all_saturated, likely_cause, range_of
from cadtof_cli.doubts.pixels import FEWEST, LOOKED_AT, scatters
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.noise import ambient_noise_v, is_without_noise, noise_model
from cadtof_cli.phasors.voltages import sound_pixels, volts_from_stored, volts_per_count

TOO_MANY = 0.25
"""Largest share of the sound pixels that may have too long a phasor at one harmonic: a few pixels may be bad."""

SCATTER_STEPS = 2.0
"""Median difference between neighbours of a plane of whole numbers, in steps. If it is larger in any plane of a frame,
no other plane of that frame can hold one value everywhere."""

_FEW_VALUES = 8
"""Two recorded planes may be the same in every pixel only if they hold at most this many different values, as planes of
saturated pixels do."""

_HEAD = 16
"""Number of pixels at the start of each plane that are compared first: they show nearly all frames to be recordings."""

_ROUNDING = 5e-7
"""Counts that were divided and stored as float32 differ from multiples of the step by less than this share of their value.
A step of 1/65536, which volts may have, differs from 1/65535 by 30 times that."""

_FEW_MULTIPLES = 8
"""So few different values may be multiples of the same number by chance."""


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
    n_av, amplitude = metadata.pixel.mean_length, metadata.modulation.amplitude_v
    if wrong := no_recording(together, metadata.modulation.harmonics) or _scaled_to_one(together, voltage):
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


def require_plausible(stored: Stored, metadata: CaptureMetadata, /, *, of: object) -> None:
    """Raise FrameError, which names the frame that the stored values are `of`, if they are not plausible."""
    if wrong := implausible(stored, metadata):
        raise FrameError(f"{of}: {wrong}")


def _scaled_to_one(planes: Stored, voltage: Voltage) -> str | None:
    """Return a message if floats that pass for volts, (H, 2, n), are counts that a program divided by the largest value of
    16, 14, 12 or 10 bits; None if they are not.

    Such values are not negative, and all are multiples of the step: if the camera has fewer bits than that, they are within
    any amplitude.
    """
    if planes.dtype.kind != "f" or planes.dtype.itemsize < 4 or voltage.volts_per_count is not None:
        return None
    finite = planes[np.isfinite(planes)]
    if not finite.size or finite.min() < 0.0 or finite.max() > 1.0:
        return None
    values = np.unique(finite).astype(np.float64)
    scales = [
        full for full in FULL_SCALES if np.allclose(values, np.rint(values * full) / full, rtol=_ROUNDING, atol=0.0)
    ]
    if not scales or values.size <= _FEW_MULTIPLES:
        return None
    what = f"{range_of(finite)}, all of them multiples of 1/{scales[-1]:.0f}"
    return f"{what}: they look {SCALED_TO_ONE} (--volts-per-count 1 if they are volts)"


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
