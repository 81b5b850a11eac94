"""Planes of a frame that are not what they are read as: height and width swapped, no light, the same plane twice, another order.

Height and width swapped, as in a wrong shape given for a raw dump: neighbours in a column should hold nearly the same
values, and then they do not.

No light: a scene makes every plane differ more over the frame than between neighbours. Without light there is noise alone.

The same plane twice: planes of one scene differ by far more than noise. If two pairs of planes do not, each is probably one
plane, as in a stack that holds all frames of a plane before those of the next plane.

Another order: light of one path with the phase x has the phases x, 2x, … at the harmonics 1, 2, …, and the same amplitude at
all of them. Several paths shift phases and amplitudes, but hardly ever in nearly all pixels of a frame. Another order does.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from itertools import combinations, permutations

import numpy as np

from cadtof_cli.arrays import Bool, Float, Stored, median, plane_names, quantiles
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.doubts.pixels import FEWEST, LOOKED_AT, sound_phasors
from cadtof_cli.phasors.noise import MAD_PER_SIGMA
from cadtof_cli.phasors.voltages import sound_pixels, spread_over

_AS_NOISE, _AS_SCENE = 1.3, 3.0
"""Scatter of a plane over the frame, in units of the noise that its neighbours show. Up to the first number the plane
holds noise alone. Above the second number it shows a scene.

In 28 captures with light, the least of any plane is 2.3; noise has 1.0. A plane with a mean farther from 0 V than the
largest scatter of all planes is not doubted: a cosine near its peak is flat and far from 0, and its sine changes most
there."""

_USUAL = (0.02, 0.98)
"""Values of a plane beyond these quantiles are outliers."""

_UNEVEN, _UNEVEN_SHARE = 0.1, 0.15
"""Difference between the amplitudes of harmonics beyond noise, relative to the largest, and the least share of pixels with a
larger one, for a plane without light. Light of one phase has the same amplitude at all harmonics, even if a channel is 0."""

_SHEARED = 1.4
"""Threshold for height and width being swapped, on d(width)/d(height) divided by (longer side)/(shorter side). d(n) is
the mean difference between pixels that are n places apart in the file: pixels in one column, if lines have n pixels.

In 332 captures of 4 to 3, d(width)/d(height) is .5 at most, and 2 and more with height and width swapped. Noise has 1."""

_SLENDER = 2
"""Largest ratio of the two sides of a frame at which it is checked for being swapped: with longer lines, most pixels
have the same neighbours either way."""

_NEAR_RAD = 0.45
"""Largest difference, in rad, between the phase of the second harmonic and the phase that follows from the fundamental,
for a pixel with most of its light on one path."""

_NEAR_RATIO = 1.6
"""Largest ratio of the amplitudes of the two harmonics without the pulse, either way round, for such a pixel."""

_LEAST_SHARE = 0.3
"""Another order of the planes is likely only if more than this share of the pixels looks like one path in that order.
See also `_LEAST_ODDS`."""

_LEAST_ODDS = 8.0
"""Another order of the planes is likely only if the odds p/(1 − p) of its share p are more than this many times the
odds in the order that was read. In 82 captures that are read correctly the ratio is 2 at most. Scenes with few depths
that are read in a wrong order have 18 and more."""

_SURE = 0.98
"""Largest share that counts in the odds: a few pixels never look like one path."""

_ONE_DEPTH, _CERTAIN = 0.95, 0.9
"""Strong MPI may be the cause, too, if the mean of unit phasors is longer than the first number, because it may then be the same
in all pixels of one depth; or if fewer pixels than the second share fit the other order."""


def sheared(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message if height and width of a frame, (H, 2, Y, X), are likely swapped; else None."""
    height, width = stored.shape[2:]
    short, long = sorted((height, width))
    stop = height * width - long
    if short == long or long > _SLENDER * short or stop < FEWEST:
        return None
    planes, limits = stored.reshape(*stored.shape[:2], -1), metadata.voltage.saturated_counts
    every = max(1, planes.shape[2] // LOOKED_AT)
    here = planes[:, :, :stop:every]
    sound, differences = sound_pixels(here, limits), []
    for line in (width, height):
        there = planes[:, :, line : stop + line : every]
        both = sound & sound_pixels(there, limits)
        if np.count_nonzero(both) < FEWEST:
            return None
        differences.append(float(np.abs(there[..., both].astype(np.float64) - here[..., both]).sum(axis=(0, 1)).mean()))
    if not differences[0] > _SHEARED * long / short * differences[1]:
        return None
    return (
        f"neighbours in a column differ far more than they would if each row had {height} pixels instead of {width}: are "
        "height and width swapped, for example in --raw-shape?"
    )


def wrong_planes(stored: Stored, metadata: CaptureMetadata, /, *, count: int = LOOKED_AT) -> str | None:
    """Return a message that names planes of a frame, (H, 2, Y, X), that hold noise alone while others show a scene, or two
    planes that show the same scene; else None. About `count` pixels are looked at.

    NaN and saturated pixels are left out.
    """
    every = max(1, math.isqrt(math.prod(stored.shape[2:]) // count))
    rows = stored[:, :, ::every]
    sound = sound_pixels(rows, metadata.voltage.saturated_counts)
    sound = sound[:, :-1:every] & sound[:, 1::every]
    if np.count_nonzero(sound) < FEWEST:
        return None
    # a mask leaves the values of each pixel side by side in memory; sums over a plane need the plane's values side by side
    here, beside = (
        np.ascontiguousarray(values[..., sound].reshape(2 * len(stored), -1), np.float64)
        for values in (rows[..., :-1:every], rows[..., 1::every])
    )
    here, change = here - metadata.voltage.zero, beside - here
    # the median leaves out edges of the scene, between which neighbours differ by more than noise
    noise = median(np.abs(change)) / (MAD_PER_SIGMA * math.sqrt(2.0))
    names = plane_names(metadata.modulation.harmonics)
    half_step = 0.5 if stored.dtype.kind in "iu" else 0.0
    if (dark := _without_light(here, change, noise, half_step)).any():
        found = ", ".join(name for name, is_dark in zip(names, dark, strict=True) if is_dark)
        return (
            f"{found}: found only noise, but other planes show a scene; was the modulation on when this was recorded?"
        )
    if (same := _same_planes(here, noise)) is not None:
        first, second = (names[place] for place in same)
        return (
            f"{second} shows the same as {first}, apart from noise: are both recordings of one plane, as in a "
            "stack that holds all frames of one plane before those of the next?"
        )
    return None


def _without_light(here: Float, change: Float, noise: Float, least: float) -> Bool:
    """Return which planes hold noise alone while others show a scene, (planes,): all False if light of one phase explains it.

    Args:
        here: values of pixels about 0 V, (planes, n).
        change: from each pixel to its neighbour, (planes, n).
        noise: standard deviation of the noise of each plane, (planes,).
        least: noise of at least this standard deviation is not doubted to be noise.
    """
    neighbours, scatter = change.std(axis=1) / math.sqrt(2.0), here.std(axis=1)
    dark = (scatter <= _AS_NOISE * neighbours) & (np.abs(here.mean(axis=1)) < scatter.max())
    if dark.any() and len(here) > 2:
        amplitudes = np.hypot(here[::2], here[1::2])
        differ = amplitudes.min(axis=0) < (1.0 - _UNEVEN) * amplitudes.max(axis=0) - 3.0 * noise.max()
        dark &= differ.mean() >= _UNEVEN_SHARE
    if dark.any():
        # in a fine mesh, some neighbours differ as much as pixels far apart, but most differ by noise
        dark &= _usual_scatter(here) <= _AS_NOISE * np.maximum(noise, least)
    return np.asarray(dark & (scatter > _AS_SCENE * neighbours).any())


def _usual_scatter(here: Float) -> Float:
    """Return the standard deviation of planes, (planes, n), without outliers, such as hot pixels."""
    low, high = quantiles(here, _USUAL)
    return np.asarray(np.clip(here, low[:, np.newaxis], high[:, np.newaxis]).std(axis=1))


def _same_planes(here: Float, noise: Float) -> tuple[int, int] | None:
    """Return two planes of values, (planes, n), that show the same scene and differ by noise, (planes,), alone; else None.

    Light of one phase may make one such pair: SC1 and SC2 are the same at 45°. Two pairs of one harmonic or of one channel
    need another cause.
    """
    same = [
        (one, other)
        for one, other in combinations(np.flatnonzero(here.std(axis=1) > _AS_SCENE * noise).tolist(), 2)
        if (one // 2 == other // 2 or one % 2 == other % 2)
        and np.sqrt(np.mean((here[other] - here[one]) ** 2)) <= _AS_NOISE * math.hypot(noise[one], noise[other])
    ]
    if len(same) < 2:
        return None
    # hot pixels are the same in all planes, and make planes of little light scatter
    shown = _usual_scatter(here) > _AS_SCENE * noise
    same = [(one, other) for one, other in same if shown[one] and shown[other]]
    return same[0] if len(same) > 1 else None


def _planes(frame: Stored) -> Stored:
    return frame


def _lines(frame: Stored) -> Stored:
    return np.moveaxis(frame.reshape(frame.shape[2], -1, frame.shape[3]), 1, 0)


def _pixels(frame: Stored) -> Stored:
    return frame.reshape(*frame.shape[2:], -1).transpose(2, 0, 1)


def _channels_first(planes: Callable[[Stored], Stored]) -> Callable[[Stored], Stored]:
    """Return the function that finds planes as `planes` does, and takes all of SC1 to come before all of SC2."""
    return lambda frame: planes(frame).reshape(2, len(frame), *frame.shape[2:]).swapaxes(0, 1)


_ORDERS: Mapping[str, Callable[[Stored], Stored]] = {
    "with SC1 and SC2 swapped": lambda frame: frame[:, ::-1],
    "with the harmonics in the opposite order": lambda frame: frame[::-1],
    "with SC1 of all harmonics before SC2": _channels_first(_planes),
    "interleaved line by line": _lines,
    "interleaved line by line, with SC1 of all harmonics before SC2": _channels_first(_lines),
    "interleaved pixel by pixel": _pixels,
    "interleaved pixel by pixel, with SC1 of all harmonics before SC2": _channels_first(_pixels),
}
"""Other orders in which the values of a frame, (H, 2, Y, X), may have been stored: the order in words, and the function
that returns views of planes, SC1 and SC2 of one harmonic after the other."""


def _orders(harmonics: tuple[int, ...]) -> dict[str, Callable[[Stored], Stored]]:
    """Return `_ORDERS` and, for three harmonics or more, also those with two other harmonics as the first two."""
    found, count = dict(_ORDERS), len(harmonics)
    for pair in permutations(range(count), 2):
        if pair not in {(0, 1), (count - 1, count - 2)}:
            one, two = (harmonics[place] for place in pair)
            order = [*pair, *(place for place in range(count) if place not in pair)]
            words = f"with the planes of H{one} and H{two} as those of H1 and H{harmonics[1]}"
            found[words] = partial(np.take, indices=order, axis=0)
    return found


def mistaken_order(stored: Stored, metadata: CaptureMetadata, /, *, count: int = LOOKED_AT) -> str | None:
    """Return a message that names the order in which the planes of a frame, (H, 2, Y, X), are likely stored, if it is
    another than the order that was read; else None. `count` pixels are looked at, or some more.

    NaN and saturated pixels are left out. A camera that adds a phase to a harmonic, which only a calibration takes out,
    looks like such a mistake too.

    Raises:
        SettingsError: see `volts_per_count`.
    """
    some = spread_over(stored, count)
    as_read = share_of_one_path(some, metadata)
    share = min(as_read, _SURE)
    odds = _LEAST_ODDS * share / (1.0 - share)
    # the share with these odds
    least = max(_LEAST_SHARE, odds / (1.0 + odds))
    if least >= _SURE:
        return None
    shares = {
        words: share_of_one_path(_spread_over_views(order(stored).reshape(stored.shape), count), metadata)
        for words, order in _orders(metadata.modulation.harmonics).items()
    }
    shares["with the opposite sign"] = share_of_one_path(some, metadata, sign=-1.0)
    likely = max(shares, key=lambda words: shares[words])
    if shares[likely] <= least:
        return None
    planes, first = ", ".join(plane_names(metadata.modulation.harmonics)), sound_phasors(some, metadata)[0]
    unsure = shares[likely] < _CERTAIN or abs(np.exp(1j * np.angle(first)).mean()) > _ONE_DEPTH
    or_mpi = " (strong MPI everywhere, or offsets without a calibration, look like that, too)" if unsure else ""
    return (
        f"the phases of the harmonics fit each other in only {as_read:.0%} of the pixels; {likely}, they would in "
        f"{shares[likely]:.0%}{or_mpi}: are the planes in the order {planes}, and are their signs right?"
    )


def share_of_one_path(some: Stored, metadata: CaptureMetadata, /, *, sign: float = 1.0) -> float:
    """Return the share of the sound ones of some pixels, (H, 2, n), that look like one path; 0 if too few are sound.

    Only the first two harmonics are compared: several paths shift higher ones more. A single harmonic always looks like one path.
    """
    if len(some) < 2:
        return 1.0
    first, second = sign * sound_phasors(some, metadata)[:2]
    if first.size < FEWEST:
        return 0.0
    length, other = np.abs(first), np.abs(second)
    alike = (length < _NEAR_RATIO * other) & (other < _NEAR_RATIO * length)
    alike &= np.abs(np.angle(second * np.conj(first) ** metadata.modulation.harmonics[1])) < _NEAR_RAD
    return float(alike.mean())


def _spread_over_views(planes: Stored, count: int) -> Stored:
    """Return what `spread_over` does, without a copy of planes, (H, 2, Y, X), whose pixels are not side by side in memory."""
    height, width = planes.shape[2:]
    rows, columns = np.divmod(np.arange(0, height * width, max(1, height * width // count)), width)
    return np.ascontiguousarray(planes[:, :, rows, columns])
