"""Whether the planes of a frame are recordings, each of its own channel and harmonic.

No two recordings are the same, and none holds one value while others scatter: noise sees to that. And light of one path at the
phase x has the phases x, 2x, … at the harmonics 1, 2, …, and one amplitude. Paths that mix shift both, but hardly ever in nearly
all pixels of a frame; planes that were written in another order do that.
"""

from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.voltages import sound_pixels, volts_from_stored

FEWEST = 64
"""Pixels from which on they say something about a frame."""

SCATTER_STEPS = 2.0
"""By how many steps of whole numbers neighbours differ in the middle, where no plane of a frame can hold one value."""

_FEW_VALUES = 8
"""Values in a plane, such as that of saturated pixels, up to which another may hold the same in the same places."""

_HEAD = 16
"""Pixels that tell of nearly all planes that they are recordings."""

_LOOKED_AT = 4096
"""Pixels that the order of planes is judged by, spread evenly over a frame."""

_NEAR_RAD = 0.45
"""How far the phase of a harmonic may be from what the fundamental promises, where most of the light is of one path."""

_NEAR_RATIO = 1.6
"""How far its amplitude may be from that of the fundamental."""

_MOST = 0.4
"""Share of pixels that look like one path, from which on another order of the planes is likely, …"""

_MORE = 4.0
"""… where that is so many times the share that does as the planes are read."""

_ORDERS: Mapping[str, Callable[[Stored], Stored]] = {
    "with SC1 and SC2 swapped": lambda frame: frame[:, ::-1],
    "with the harmonics in the opposite order": lambda frame: frame[::-1],
    "with SC1 of all harmonics before SC2": lambda frame: frame.reshape(2, len(frame), -1).swapaxes(0, 1),
    "interleaved line by line": lambda frame: np.moveaxis(frame.reshape(frame.shape[2], -1, frame.shape[3]), 1, 0),
    "interleaved pixel by pixel": lambda frame: frame.reshape(-1, 2 * len(frame)).T,
}
"""What else the values of a frame, (H, 2, Y, X), may be, in words, and how planes of H.SC1 and H.SC2 in turn are made of them."""


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
    if any(constant) and _scatters(rows):
        place = constant.index(True)
        return f"{names[place]} holds {rows[place, 0]:g} in every pixel, and other planes scatter: it was not recorded"
    return None


def mistaken_order(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return what the planes of a frame, (H, 2, Y, X), likely are in place of what they are read as; None where all is well.

    NaN and saturated pixels are left out. Phases that a camera adds to a harmonic, and only a calibration takes out, look like
    such a mistake too.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    harmonics, voltage = metadata.modulation.harmonics, metadata.voltage
    if len(harmonics) < 2:
        return None

    def share(frame: Stored, sign: float = 1.0) -> float:
        planes = frame.reshape(*stored.shape[:2], -1)[:, :, :: max(1, stored[0, 0].size // _LOOKED_AT)]
        planes = planes[:, :, sound_pixels(planes, voltage.saturated_counts)]
        if planes.shape[2] < FEWEST:
            return 0.0
        volts = sign * volts_from_stored(planes, voltage)
        return float(_like_one_path(volts[:, 0] + 1j * volts[:, 1], harmonics).mean())

    as_read = share(stored)
    if _MORE * as_read >= 1.0:
        return None
    shares = {words: share(order(stored)) for words, order in _ORDERS.items()}
    shares["with the opposite sign"] = share(stored, -1.0)
    likely = max(shares, key=lambda words: shares[words])
    if shares[likely] <= max(_MOST, _MORE * as_read):
        return None
    return (
        f"only {as_read:.0%} of the pixels have phases as light has them, and {shares[likely]:.0%} would {likely}: are the "
        f"planes {', '.join(_names(harmonics))}, one after the other, and their signs right?"
    )


def _names(harmonics: tuple[int, ...]) -> list[str]:
    return [f"H{harmonic}.SC{channel}" for harmonic in harmonics for channel in (1, 2)]


def _scatters(rows: Stored) -> bool:
    """Return whether neighbours differ in some plane, (planes, n), by more than rounding hides."""
    steps = np.abs(np.diff(rows.astype(np.float64), axis=1))
    finite = steps[np.isfinite(steps).all(axis=1)]
    least = SCATTER_STEPS if rows.dtype.kind in "iu" else 0.0
    return bool(finite.size) and float(np.median(finite, axis=1).max()) > least


def _like_one_path(phasors: Complex, harmonics: tuple[int, ...]) -> Bool:
    """Return which pixels of phasors, (H, n), have about the phases and amplitudes of a single path, by the first two harmonics.

    On further ones paths that mix shift the phases more, and say less.
    """
    first, second = phasors[:2]
    length, other = np.abs(first), np.abs(second)
    alike: Bool = (length < _NEAR_RATIO * other) & (other < _NEAR_RATIO * length)
    alike &= np.abs(np.angle(second * np.conj(first) ** harmonics[1])) < _NEAR_RAD
    return alike
