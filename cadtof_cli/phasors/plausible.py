"""Whether what a frame holds can be a recording of the capture that its metadata describe: values, planes, and their order.

No light gives a phasor longer than the modulation amplitude: SC1² + SC2² ≤ amplitude_v², but for noise and offsets. Counts taken
for volts, a zero or a unit that is missing, or values that a program has scaled, are beyond that by far.

No two recordings are the same, and none holds one value while others scatter: noise sees to that. And light of one path at the
phase x has the phases x, 2x, … at the harmonics 1, 2, …, and one amplitude. Paths that mix shift both, but hardly ever in nearly
all pixels of a frame; planes that were written in another order do that.

Noise spreads the outermost values as it does all others: where many pixels hold the very same one, a converter has cut them off.
And a scene makes all planes differ more over the frame than from pixel to pixel; a channel that is not connected, or a harmonic
that is not modulated, holds noise alone.
"""

import math
from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.causes import LONGEST, all_saturated, likely_cause, range_of
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.voltages import sound_pixels, volts_from_stored, volts_per_count

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

_NEAR_RAD = 0.45
"""How far the phase of a harmonic may be from what the fundamental promises, where most of the light is of one path."""

_NEAR_RATIO = 1.6
"""How far its amplitude may be from that of the fundamental."""

_LEAST_SHARE = 0.3
"""Share of pixels that look like one path, from which on another order of the planes is likely, …"""

_LEAST_ODDS = 8.0
"""… where the odds p/(1 − p) of its share p are so many times the odds of the share in the order that they are read in. In 82
captures that are read right this is 2 at the most; scenes of few depths that are read in a wrong order have 18 and more."""

_SURE = 0.98
"""Largest share whose odds count: a few pixels have no light of one path for other reasons."""

_PILED_UP = 8
"""How many times as often as the next one the outermost value is there, where values are cut off at it, …"""

_NOISE_STEPS = 0.5
"""… unless neighbours differ by no more steps of whole numbers than that in the middle, and the noise spreads no values."""

_AS_NOISE, _AS_SCENE = 1.3, 3.0
"""Scatter over the frame, over that of neighbours, up to which a plane holds noise alone, and from which on one shows a scene.
Of 28 captures with light, the plane with least has 2.3; noise has 1.0."""

_ORDERS: Mapping[str, Callable[[Stored], Stored]] = {
    "with SC1 and SC2 swapped": lambda frame: frame[:, ::-1],
    "with the harmonics in the opposite order": lambda frame: frame[::-1],
    "with SC1 of all harmonics before SC2": lambda frame: frame.reshape(2, len(frame), -1).swapaxes(0, 1),
    "interleaved line by line": lambda frame: np.moveaxis(frame.reshape(frame.shape[2], -1, frame.shape[3]), 1, 0),
    "interleaved pixel by pixel": lambda frame: frame.reshape(-1, 2 * len(frame)).T,
}
"""What else the values of a frame, (H, 2, Y, X), may be, in words, and how planes of H.SC1 and H.SC2 in turn are made of them."""


def implausible(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return why stored values, (H, 2, …), cannot be the voltages that the metadata make of them; None where they can.

    A plane that cannot have been recorded is among the reasons. NaN and saturated pixels are left out.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    some = _spread(stored, LOOKED_AT)
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
    names = _names(harmonics)
    constant = [bool((row == row[0]).all()) for row in rows]
    for name, other in combinations(range(len(rows)), 2):
        if np.array_equal(rows[name], rows[other]) and np.unique(rows[name]).size > _FEW_VALUES:
            return (
                f"{names[other]} holds the same values as {names[name]} in every pixel, as no two recordings do: it was "
                "written twice, or its buffer was not filled"
            )
    if any(constant) and _scatters(rows, SCATTER_STEPS):
        place = constant.index(True)
        return f"{names[place]} holds {rows[place, 0]:g} in every pixel, and other planes scatter: it was not recorded"
    return None


def doubts(
    stored: Stored, metadata: CaptureMetadata, /, *, has_light: bool = True, of_order: bool = True
) -> tuple[str, ...]:
    """Return in words what is likely wrong with a frame, (H, 2, Y, X): values that are cut off; if it has light, planes that do
    not show it, and, `of_order`, planes that are swapped.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    dark = without_light(stored, metadata) if has_light else None
    mistaken = mistaken_order(stored, metadata) if has_light and of_order else None
    return tuple(doubt for doubt in (dark, mistaken, cut_off(stored, metadata)) if doubt)


def without_light(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return which planes of a frame, (H, 2, Y, X), hold noise alone where others show a scene; None where none does.

    NaN and saturated pixels are left out.
    """
    every = max(1, math.isqrt(math.prod(stored.shape[2:]) // LOOKED_AT))
    pairs = np.stack([stored[..., ::every, :-1:every], stored[..., ::every, 1::every]], axis=2)
    sound = sound_pixels(pairs, metadata.voltage.saturated_counts).all(axis=0)
    if np.count_nonzero(sound) < FEWEST:
        return None
    here, beside = np.moveaxis(pairs[..., sound].astype(np.float64), 2, 0).reshape(2, -1, np.count_nonzero(sound))
    noise, scatter = (beside - here).std(axis=1) / math.sqrt(2.0), here.std(axis=1)
    dark = scatter <= _AS_NOISE * noise
    if not dark.any() or not (scatter > _AS_SCENE * noise).any():
        return None
    names = [name for name, is_dark in zip(_names(metadata.modulation.harmonics), dark, strict=True) if is_dark]
    return (
        f"only noise in {', '.join(names)}, where other planes show a scene: was that recorded, with its modulation on?"
    )


def mistaken_order(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return in which other order the planes of a frame, (H, 2, Y, X), are likely stored; None where all is well.

    NaN and saturated pixels are left out. Phases that a camera adds to a harmonic, and only a calibration takes out, look like
    such a mistake too.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    if len(stored) < 2:
        return None
    as_read = _share_of_one_path(stored, metadata)
    least = _LEAST_ODDS * _odds(as_read)
    if least >= _odds(1.0):
        return None
    shares = {
        words: _share_of_one_path(order(stored).reshape(stored.shape), metadata) for words, order in _ORDERS.items()
    }
    shares["with the opposite sign"] = _share_of_one_path(stored, metadata, sign=-1.0)
    likely = max(shares, key=lambda words: shares[words])
    if shares[likely] <= _LEAST_SHARE or _odds(shares[likely]) <= least:
        return None
    return (
        f"only {as_read:.0%} of the pixels have phases as light has them, and {shares[likely]:.0%} would {likely}: are the "
        f"planes {', '.join(_names(metadata.modulation.harmonics))}, one after the other, and their signs right?"
    )


def cut_off(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return at which stored value those of a frame, (H, 2, Y, X), are likely cut off, though no limit of the metadata says so;
    None where they are not."""
    some = _spread(stored, 4 * LOOKED_AT)
    values = some[:, :, sound_pixels(some, metadata.voltage.saturated_counts)]
    if values.shape[2] < FEWEST:
        return None
    for name, outermost in (("least", np.min), ("largest", np.max)):
        there = values == outermost(values)
        pixels = np.count_nonzero(there.any(axis=(0, 1)))
        if pixels >= FEWEST and not there.all() and _scatters(values.reshape(-1, values.shape[2]), _NOISE_STEPS):
            following = outermost(values[~there])
            if np.count_nonzero(there) > _PILED_UP * np.count_nonzero(values == following):
                return (
                    f"{pixels / values.shape[2]:.1%} of the pixels hold {outermost(values):g}, the {name} stored value: if the "
                    "camera or a program cuts values off there, they are saturated: set saturated_counts under [voltage] in "
                    "capture.toml, or --saturated-counts"
                )
    return None


def _spread(stored: Stored, count: int) -> Stored:
    """Return about so many pixels of a frame, (H, 2, …), spread evenly over it, (H, 2, n); all where it has no more."""
    planes = stored.reshape(*stored.shape[:2], -1)
    return planes[:, :, :: max(1, planes.shape[2] // count)]


def _share_of_one_path(stored: Stored, metadata: CaptureMetadata, *, sign: float = 1.0) -> float:
    """Return the share of the pixels of a frame, (H, 2, Y, X), that have about the phases and amplitudes of a single path.

    By the first two harmonics: on further ones paths that mix shift the phases more, and say less. 0 where too few are sound.
    """
    some = _spread(stored, LOOKED_AT)
    sound = some[:2, :, sound_pixels(some, metadata.voltage.saturated_counts)]
    if sound.shape[2] < FEWEST:
        return 0.0
    volts = sign * volts_from_stored(sound, metadata.voltage)
    first, second = volts[:, 0] + 1j * volts[:, 1]
    length, other = np.abs(first), np.abs(second)
    alike = (length < _NEAR_RATIO * other) & (other < _NEAR_RATIO * length)
    alike &= np.abs(np.angle(second * np.conj(first) ** metadata.modulation.harmonics[1])) < _NEAR_RAD
    return float(alike.mean())


def _odds(share: float) -> float:
    share = min(share, _SURE)
    return share / (1.0 - share)


def _names(harmonics: tuple[int, ...]) -> list[str]:
    return [f"H{harmonic}.SC{channel}" for harmonic in harmonics for channel in (1, 2)]


def _scatters(rows: Stored, steps_of_whole_numbers: float) -> bool:
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
    longest = LONGEST + (0.0 if n_av is None else 5.0 * math.sqrt(0.5 / (2.0 * n_av - 1.0)))
    longest *= metadata.modulation.amplitude_v
    most = longest / math.sqrt(2.0) / abs(volts_per_count(voltage, dtype))
    low, high = voltage.saturated_counts or (-math.inf, math.inf)
    return longest, max(voltage.zero - most, low), min(voltage.zero + most, high)
