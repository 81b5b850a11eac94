"""Errors of the camera that a frame shows: rows, columns or halves with offsets of their own, harmonics of unequal amplitude,
and a converter that cuts values off or one bit of which is stuck.

Nothing of this shows in a pixel alone. Offsets and amplitudes look like a second path, with a sigma that is far too small.
"""

import math
from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Float, Float32, Stored, median, plane_names, quantiles
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.doubts.pixels import (
    FEWEST,
    LOOKED_AT,
    left_by_one_path,
    scatters,
    sound_phasors,
    sound_values,
    tells_scene,
)
from cadtof_cli.phasors.noise import MAD_PER_SIGMA
from cadtof_cli.phasors.voltages import (
    ideal_phasor_map,
    phasors_from_stored,
    sound_pixels,
    spread_over,
    volts_from_stored,
    volts_per_count,
)

_STRIPED, _STRIPED_LEFT = 1.0, 0.7
"""Rows or columns are doubted if their offsets scatter by more than so many standard deviations of a pixel, and by more than the
second number if depth and brightness are left out: not all of an offset is left then."""

_RIPPLED = 0.005
"""Share of the light up to which offsets may be ripples of the scene, such as those of a corrugated sheet."""

_SECOND, _THIRD = math.sqrt(1.0 + 4.0 + 1.0), math.sqrt(1.0 + 9.0 + 9.0 + 1.0)
"""Standard deviations of second and third differences of independent numbers. Surfaces hardly have third differences."""

_LINES, _LEAST_LINES, _LEAST_ALONG = 96, 48, 24
"""Rows or columns that are looked at, fewest of them, as a part lies at edges of the scene, and fewest pixels along one."""

_QUARTER_OF_NORMAL = 0.3186
"""First quartile of the magnitude of a normal distribution, in units of its standard deviation. Edges of the scene, such as
posts and shelves, leave it nearly as it is while a quarter of the lines is free of them."""

_STEP_SIGMAS, _STEP_ALIKE, _STEP = 8.0, 0.25, 0.004
"""A step between the halves of a frame is an offset if it is more than so many of its standard deviations, the same in all
planes up to this share, and more than this share of the modulation amplitude. Edges of a scene are other steps in each plane: no
row or column of 270 sound frames looks like an offset."""

_UNEQUAL = 0.03
"""Least relative difference of the amplitudes of two harmonics that is doubted: it moves depths by centimetres."""

_ALIKE, _ALIKE_SHARE, _ALIKE_TURN = 0.5, 0.9, 0.2
"""The difference belongs to the camera, not to MPI, if 90 % of the brighter pixels have it up to a half, and if the phase
of that harmonic differs by a fifth of it at most. In 22 captures without that fault, rooms among them, 75 % at most have it
in the second harmonic, or it comes with phases three tenths of it and more."""

_ONE_DEPTH = 0.95
"""Length of the mean of unit phasors above which the scene has one depth: MPI may then be the same in all pixels."""

_BIT_LOOKED_AT, _BIT_MATTERS = 1024, 0.004
"""Pixels whose bits are looked at, at least, and the least bit, as a share of the modulation amplitude: it moves depths by
millimetres."""

_GAPS, _GAP_RANGE = 2, 1.25
"""Fewest gaps that a stuck bit leaves between the values, and how many times the bit the largest of them may be. Values of
distinct surfaces have other gaps. In 1270 sound frames nothing is told."""

_CLEAR_OFFSET, _CLEAR_STEPS, _CLEAR_SHARE = 7.0, 3.0, 0.05
"""Standard errors and steps of whole numbers that a difference of offsets must exceed, and the least share of such ones."""

_SAME_OFFSETS, _OTHER_OFFSETS = 0.3, 8.0
"""A frame has other offsets if its own differences are at most this share of them, and less by so many standard errors. Of
13,500 sound frames, two are told: nine rows with offsets of their own look like the edges of a scene."""

_PILED_UP = 8
"""Values are likely cut off if the outermost value occurs more than this many times as often as the next value."""

_NOISE_STEPS = 0.5
"""Whole numbers are not judged for being cut off if the median difference between neighbours is at most this many steps
in every plane: the noise then does not spread values, and many pixels hold the same value for that reason."""


def other_offsets(
    stored: Stored, metadata: CaptureMetadata, offset_v: Float32, stderr_v: Sequence[float], /
) -> str | None:
    """Return a message if neighbours in a frame, (H, 2, Y, X), do not differ as their calibrated offsets do; else None.

    `offset_v`, (H, 2, Y, X), are known to `stderr_v`, (H,); 0: not known how well. NaN and saturated pixels are left out.
    """
    # an odd number: the upper row is even and odd in turn, so the slope of a scene cancels if even rows have another offset
    each = 2 * (stored.shape[2] * stored.shape[3] // (2 * LOOKED_AT)) + 1
    upper, lower = slice(0, -1, each), slice(1, None, each)
    above, below = (_sound_volts(stored[:, :, rows], metadata) for rows in (upper, lower))
    seen, known = above - below, (offset_v[:, :, upper] - offset_v[:, :, lower]).astype(np.float64)
    step_v = abs(volts_per_count(metadata.voltage, stored.dtype)) if stored.dtype.kind in "iu" else 0.0
    least = np.maximum(_CLEAR_OFFSET * np.reshape(stderr_v, (-1, 1, 1, 1)), _CLEAR_STEPS * step_v)
    finite, least = np.isfinite(seen + known), np.maximum(least, _STEP * metadata.modulation.amplitude_v)
    clear = finite & (np.abs(known) > least)
    if np.count_nonzero(clear) < max(FEWEST, _CLEAR_SHARE * np.count_nonzero(finite)) or not all(stderr_v):
        return None
    along, size = (seen * np.sign(known))[clear], median(np.abs(known[clear]))
    share = median(along) / size
    error = 1.25 * median(np.abs(along - median(along))) / MAD_PER_SIGMA / math.sqrt(along.size) / size
    if share > _SAME_OFFSETS or share > 1.0 - _OTHER_OFFSETS * error:
        return None
    return (
        "its pixels do not have the offsets of the calibration, which makes depths worse: is it the calibration of another "
        "camera, were the frames mirrored or turned, or have the offsets drifted? Repeat calibrate dark"
    )


def _sound_volts(some: Stored, metadata: CaptureMetadata) -> Float:
    """Return some pixels in V, (H, 2, …); NaN at each harmonic in those that are saturated or not finite."""
    is_sound = sound_pixels(some, metadata.voltage.saturated_counts)
    return np.where(is_sound, volts_from_stored(some, metadata.voltage), np.nan)


def striped(stored: Stored, metadata: CaptureMetadata, lines: str, /) -> str | None:
    """Return a message if the rows, or the columns, of a frame have offsets of their own, larger than noise; else None.

    The third differences across the lines are compared: their medians along the lines with those of single pixels. Then a scene
    of stripes is ruled out, if the modulation allows it.
    """
    planes = stored if lines == "rows" else stored.swapaxes(2, 3)
    begin = max(0, (planes.shape[2] - _LINES) // 2)
    planes = planes[:, :, begin : begin + _LINES, :: max(1, planes.shape[3] * _LINES // LOOKED_AT)]
    count, along = planes.shape[2:]
    if count < _LEAST_LINES or along < _LEAST_ALONG:
        return None
    volts = _sound_volts(planes, metadata)
    bent = np.diff(volts, n=3, axis=2).reshape(2 * len(planes), count - 3, along)
    bent = bent[:, :, np.isfinite(bent).all(axis=(0, 1))]
    if bent.shape[2] < _LEAST_ALONG:
        return None
    of_line = median(bent)
    noise = median(np.abs(bent - of_line[..., np.newaxis]).reshape(len(bent), -1)) / (MAD_PER_SIGMA * _THIRD)
    offsets = quantiles(np.abs(of_line), (0.25,))[0] / (_QUARTER_OF_NORMAL * _THIRD)
    # a median of n normal numbers has π/2 of the variance of their mean
    excess = np.sqrt(np.maximum(offsets**2 - 0.5 * math.pi / bent.shape[2] * noise**2, 0.0))
    light = float(median(np.sqrt(np.nansum(volts * volts, axis=(0, 1)) / len(volts)).ravel()))
    if not (worst := float(np.max(excess))) > max(_STRIPED * float(np.max(noise)), _RIPPLED * light):
        return None
    if tells_scene(metadata):
        phasors = phasors_from_stored(planes.reshape(*planes.shape[:2], -1), ideal_phasor_map(metadata, stored.dtype))
        phasors[:, np.isnan(volts[0, 0]).ravel()] = np.nan
        left = metadata.modulation.amplitude_v * left_by_one_path(phasors, metadata.modulation.harmonics)
        if not _differ_in_lines(np.concatenate([left.real, left.imag]).reshape(-1, count, along), _RIPPLED * light):
            return None
    return (
        f"{lines} have offsets of their own, {1000.0 * worst:.2g} mV from one to the next: depths are wrong by more than sigma "
        "says. If they are the same in all frames, run calibrate dark; if not, something disturbs the read-out. Only a scene of "
        "fine stripes, such as a fence, looks like that, too"
    )


def _differ_in_lines(left: Float, least: float) -> bool:
    """Return whether what one path leaves over differs more from line to line than along the lines, (planes, lines, n), and by
    more than `least`: offsets of lines do. True if too few pixels tell."""
    quarters = []
    for axis in (1, 2):
        bent = np.abs(np.diff(left, n=2, axis=axis)).reshape(len(left), -1)
        bent = bent[:, np.isfinite(bent).all(axis=0)]
        if bent.shape[1] < _LEAST_LINES:
            return True
        quarters.append(quantiles(bent, (0.25,))[0])
    seen, noise = np.square(np.array(quarters) / (_QUARTER_OF_NORMAL * _SECOND))
    return bool(np.any(seen - noise > np.maximum(_STRIPED_LEFT**2 * noise, least**2)))


def stepped(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message if a half or a quarter of a frame, (H, 2, Y, X), has an offset of its own; else None."""
    for planes, side in ((stored, "left and right"), (stored.swapaxes(2, 3), "upper and lower")):
        begin, lines = planes.shape[3] // 2 - 3, planes.shape[2]
        if begin < 0 or lines < 2 * _LEAST_ALONG:
            continue
        volts = _sound_volts(planes[:, :, :, begin : begin + 6], metadata).reshape(-1, lines, 6)
        # the step in the middle that the slopes on both sides do not explain
        steps = (volts[..., 3] - volts[..., 2]) - 0.25 * (volts[..., 5] - volts[..., 3] + volts[..., 2] - volts[..., 0])
        for part in (steps[:, : lines // 2], steps[:, lines // 2 :]):
            known = part[:, np.isfinite(part).all(axis=0)]
            if known.shape[1] < _LEAST_ALONG:
                continue
            middle = median(known)
            scatter = float(median(np.abs(known - middle[:, np.newaxis])).max()) / MAD_PER_SIGMA
            sigma, step = scatter * math.sqrt(0.5 * math.pi / known.shape[1]), float(middle.mean())
            least = max(_STEP_SIGMAS * sigma, _STEP * metadata.modulation.amplitude_v)
            if abs(step) > least and np.abs(middle - step).max() < _STEP_ALIKE * abs(step):
                return (
                    f"the {side} halves differ by {1000.0 * step:.2g} mV in all planes where they meet: parts of the "
                    "sensor have offsets of their own, which look like light. Depths of such a part are wrong by centimetres to "
                    "metres, and sigma does not say so: run calibrate dark"
                )
    return None


def unequal_harmonics(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message if a harmonic has another amplitude than the first, by the same factor at all depths; else None."""
    modulation = metadata.modulation
    if modulation.waveform != "sine":
        return None
    phasors = sound_phasors(spread_over(stored, LOOKED_AT), metadata)
    if phasors.shape[1] < 2 * FEWEST:
        return None
    length = np.abs(phasors[0])
    first, *others = phasors[:, (length >= median(length)) & (length > 0.0)]
    if not first.size or abs(np.mean(first / np.abs(first))) > _ONE_DEPTH:
        return None
    for h, other in zip(modulation.harmonics[1:], others, strict=True):
        # as a share of the first harmonic, turned back by the phase of one path
        ratio = other * (np.conj(first) / np.abs(first)) ** h / np.abs(first)
        middle, turn = float(median(ratio.real)), float(median(ratio.imag))
        differs = abs(middle - 1.0)
        alike = np.abs(ratio - middle) < _ALIKE * differs
        if differs >= _UNEQUAL and abs(turn) <= _ALIKE_TURN * differs and alike.mean() >= _ALIKE_SHARE:
            return (
                f"harmonic {h} is {middle:.3g} times as strong as the first at all depths, which looks like a second path in "
                "every pixel: run calibrate response, or correct fwhm_ns. Until then, --order 1 gives better depths where MPI "
                "is weak"
            )
    return None


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
    groups = (*rows, rows)
    for place in reversed(range(len(groups))):
        for bit in range(max(1, math.ceil(math.log2(least))), changing[place].bit_length()):
            # nearly all frames have no such bit
            if not changing[place] >> bit & 1 and changing[place] & ((1 << bit) - 1) and _has_gaps(groups[place], bit):
                names = [*plane_names(metadata.modulation.harmonics), "all planes"]
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


def cut_off(stored: Stored, metadata: CaptureMetadata, /) -> str | None:
    """Return a message that names the stored value at which the values of a frame, (H, 2, Y, X), are likely cut off, if
    the limits of the metadata do not say so already; else None."""
    some = spread_over(stored, 4 * LOOKED_AT)
    values = sound_values(some, metadata)
    if not values.size:
        return None
    for name, outermost, limits in (("smallest", np.min, "{:g},HIGH"), ("largest", np.max, "LOW,{:g}")):
        there = values == outermost(values)
        # nearly all frames end here
        if np.count_nonzero(there) < FEWEST:
            continue
        pixels = np.count_nonzero(there.any(axis=(0, 1)))
        if pixels >= FEWEST and not there.all() and scatters(values.reshape(-1, values.shape[2]), _NOISE_STEPS):
            following = outermost(values[~there])
            if np.count_nonzero(there) > _PILED_UP * np.count_nonzero(values == following):
                return (
                    f"{pixels / values.shape[2]:.1%} of the pixels hold {outermost(values):g}, the {name} stored value; if the "
                    "camera or a program cuts values off there, these pixels are saturated: set saturated_counts under "
                    f"[voltage] in capture.toml, or --saturated-counts {limits.format(outermost(values))}"
                )
    return None
