"""What is likely wrong with a frame, though it may be a recording: height for width, order of planes, no light, values cut off.

Light of one path at the phase x has the phases x, 2x, … at the harmonics 1, 2, …, and one amplitude. Paths that mix shift both,
but hardly ever in nearly all pixels of a frame; planes that were written in another order do that.

A scene makes all planes differ more over the frame than from pixel to pixel; a channel that is not connected, or a harmonic that
is not modulated, holds noise alone.

Neighbours show nearly the same. Where height and width were taken for each other, as in the shape that was given for a raw dump,
pixels below each other do not.

Noise spreads the outermost values as it does all others: where many pixels hold the very same one, a converter has cut them off.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.plausible import FEWEST, LOOKED_AT, plane_names, scatters, spread_over
from cadtof_cli.phasors.voltages import sound_pixels, volts_from_stored

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
Of 28 captures with light, the plane with least has 2.3; noise has 1.0. A plane far from 0 V beside the largest scatter is left
out: a cosine is flat, and far from 0, where its sine says most."""

_SHEARED = 1.4
"""How many times as far pixels below each other differ as they would with height and width swapped, where these likely are, over
the larger of both by the smaller: a slope without noise has that. In 332 captures of 4 to 3 the former is .5 at the most, and
2 and more with both swapped; noise has 1."""

_SLENDER = 2
"""Width over height, or the reverse, up to which that is looked at: pixels of long lines are beside each other either way."""

_ORDERS: Mapping[str, Callable[[Stored], Stored]] = {
    "with SC1 and SC2 swapped": lambda frame: frame[:, ::-1],
    "with the harmonics in the opposite order": lambda frame: frame[::-1],
    "with SC1 of all harmonics before SC2": lambda frame: frame.reshape(2, len(frame), -1).swapaxes(0, 1),
    "interleaved line by line": lambda frame: np.moveaxis(frame.reshape(frame.shape[2], -1, frame.shape[3]), 1, 0),
    "interleaved pixel by pixel": lambda frame: frame.reshape(-1, 2 * len(frame)).T,
}
"""What else the values of a frame, (H, 2, Y, X), may be, in words, and how planes of H.SC1 and H.SC2 in turn are made of them."""


def doubts(
    stored: Stored, metadata: CaptureMetadata, /, *, has_light: bool = True, of_order: bool = True
) -> tuple[str, ...]:
    """Return in words what is likely wrong with a frame, (H, 2, Y, X): values that are cut off; if it has light, lines of the
    wrong length, planes that do not show it, or else, `of_order`, planes that are swapped.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    slanted = sheared(stored, metadata) if has_light else None
    dark = without_light(stored, metadata) if has_light else None
    mistaken = mistaken_order(stored, metadata) if has_light and of_order and not dark else None
    return tuple(doubt for doubt in (slanted, dark, mistaken, cut_off(stored, metadata)) if doubt)


def sheared(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return that height and width of a frame, (H, 2, Y, X), are likely swapped, with what each is; None where all is well.

    NaN and saturated pixels are left out.
    """
    height, width = stored.shape[2:]
    short, long = sorted((height, width))
    stop = height * width - long
    if short == long or long > _SLENDER * short or stop < FEWEST:
        return None
    planes, limits = stored.reshape(*stored.shape[:2], -1), metadata.voltage.saturated_counts
    every = max(1, planes.shape[2] // LOOKED_AT)
    here = planes[:, :, :stop:every]
    sound = sound_pixels(here, limits)

    def difference(line: int) -> float:
        there = planes[:, :, line : stop + line : every]
        both = sound & sound_pixels(there, limits)
        if np.count_nonzero(both) < FEWEST:
            return math.nan
        with np.errstate(invalid="ignore"):
            return float(np.abs(there.astype(np.float64) - here).sum(axis=(0, 1))[both].mean())

    if not difference(width) > _SHEARED * long / short * difference(height):
        return None
    return (
        f"pixels below each other differ far more than if lines were {height} pixels long, not {width}: are height and width, "
        "as in --raw-shape, swapped?"
    )


def without_light(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return which planes of a frame, (H, 2, Y, X), hold noise alone where others show a scene; None where none does.

    NaN and saturated pixels are left out.
    """
    every = max(1, math.isqrt(math.prod(stored.shape[2:]) // LOOKED_AT))
    rows = stored[:, :, ::every]
    sound = sound_pixels(rows, metadata.voltage.saturated_counts)
    sound = sound[:, :-1:every] & sound[:, 1::every]
    count = np.count_nonzero(sound)
    if count < FEWEST:
        return None
    # of values that are chosen by a mask, those of a pixel lie together
    here, beside = (
        np.ascontiguousarray(values[..., sound].reshape(-1, count), np.float64)
        for values in (rows[..., :-1:every], rows[..., 1::every])
    )
    noise, scatter = (beside - here).std(axis=1) / math.sqrt(2.0), here.std(axis=1)
    dark = (scatter <= _AS_NOISE * noise) & (np.abs(here.mean(axis=1) - metadata.voltage.zero) < scatter.max())
    if not dark.any() or not (scatter > _AS_SCENE * noise).any():
        return None
    names = [name for name, is_dark in zip(plane_names(metadata.modulation.harmonics), dark, strict=True) if is_dark]
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
        f"planes {', '.join(plane_names(metadata.modulation.harmonics))}, one after the other, and their signs right?"
    )


def cut_off(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return at which stored value those of a frame, (H, 2, Y, X), are likely cut off, though no limit of the metadata says so;
    None where they are not."""
    some = spread_over(stored, 4 * LOOKED_AT)
    values = some[:, :, sound_pixels(some, metadata.voltage.saturated_counts)]
    if values.shape[2] < FEWEST:
        return None
    for name, outermost in (("least", np.min), ("largest", np.max)):
        there = values == outermost(values)
        # of nearly all frames, this tells
        if np.count_nonzero(there) < FEWEST:
            continue
        pixels = np.count_nonzero(there.any(axis=(0, 1)))
        if pixels >= FEWEST and not there.all() and scatters(values.reshape(-1, values.shape[2]), _NOISE_STEPS):
            following = outermost(values[~there])
            if np.count_nonzero(there) > _PILED_UP * np.count_nonzero(values == following):
                return (
                    f"{pixels / values.shape[2]:.1%} of the pixels hold {outermost(values):g}, the {name} stored value: if the "
                    "camera or a program cuts values off there, they are saturated: set saturated_counts under [voltage] in "
                    "capture.toml, or --saturated-counts"
                )
    return None


def _share_of_one_path(stored: Stored, metadata: CaptureMetadata, *, sign: float = 1.0) -> float:
    """Return the share of the pixels of a frame, (H, 2, Y, X), that have about the phases and amplitudes of a single path.

    By the first two harmonics: on further ones paths that mix shift the phases more, and say less. 0 where too few are sound.
    """
    some = spread_over(stored, LOOKED_AT)
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
