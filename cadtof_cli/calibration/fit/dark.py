"""Frames of a covered lens → each pixel's offset and noise, and the defective pixels."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.calibration.dark import DarkCalibration, Defect
from cadtof_cli.calibration.fit.robust import centre_and_spread
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.errors import SettingsError, require_memory_for_scipy
from cadtof_cli.phasors.frame_mean import MeanVolts, median_variance_ratio, variance_ratio

OFFSET_LIMIT = 8.0
"""An offset is an outlier beyond this many robust standard deviations. Gaussian offsets reach 5.5 in a megapixel."""

ROUNDING = 8.0 * float(np.finfo(np.float32).eps)
"""Share of the median offset by which rounding may move an offset; this is the limit for outliers if there is no noise."""

ROUNDING_V = 1e-12
"""Volts by which rounding may move an offset; this is the limit for outliers if there is no noise and the median offset
is near 0."""

NOISE_FALSE_ALARM = 1e-9
"""Probability that a sound pixel's noise is an outlier by chance. Its noise must also differ by `NOISE_RATIO`."""

MOST_ALIKE = 0.1
"""Largest expected number of sound channels, in the whole array, that hold the same count in all frames by chance. If
more are expected, no pixel is called dead."""

NOISE_RATIO = 2.0
"""Least ratio of an outlier's noise to the noise of the other pixels, or of theirs to its."""


def fit_dark(mean: MeanVolts, /, *, origin: Origin, predicted_noise_v: Float) -> DarkCalibration:
    """Return the dark calibration from the mean, in V, of frames of a covered lens.

    `predicted_noise_v`, (H,), is the noise of a channel of one frame at each harmonic. It is used if there is only one
    frame, which does not show its own noise.

    A pixel is an outlier if its offset is more than `OFFSET_LIMIT` robust standard deviations from the median of its
    plane, or if its variance is outside the limits of χ² around the plane's median variance. With one frame, noise is
    not judged. With few frames of counts, no noise counts as too small, because sound pixels may hold the same count by
    chance.

    Raises:
        SettingsError: no pixel is sound in every frame.
    """
    if not mean.sound.any():
        raise SettingsError(
            "dark frames: found no pixel that is finite and not saturated in all of them, expected most pixels"
        )
    predicted = np.empty_like(mean.volts)
    predicted[:] = np.maximum(predicted_noise_v**2, mean.rounding)[:, np.newaxis, np.newaxis, np.newaxis]
    variances = mean.variance if mean.frames > 1 else predicted
    defects, dead_are_told = np.zeros(mean.pixels, np.uint32), tells_dead(mean)
    defects[~mean.sound] |= np.uint32(Defect.NOT_FINITE)
    for offset, variance in zip(_planes(mean.volts), _planes(variances), strict=True):
        centre, spread = centre_and_spread(offset)
        most = max(OFFSET_LIMIT * spread, ROUNDING * abs(centre), ROUNDING_V)
        defects[np.abs(offset - centre) > most] |= np.uint32(Defect.OFFSET)
        if mean.frames > 1:
            low, high = _variance_limits(mean.frames)
            typical = float(np.nanmedian(variance)) / median_variance_ratio(mean.frames)
            if typical > 0.0:
                # at the edge between two counts, the least noise makes a pixel change by a count
                defects[variance > high * max(typical, mean.rounding)] |= np.uint32(Defect.NOISE)
                if dead_are_told:
                    defects[variance < low * typical] |= np.uint32(Defect.DEAD)
    noise = np.sqrt(np.nan_to_num(variances)).astype(np.float32)
    dark = DarkCalibration(origin, np.nan_to_num(mean.volts).astype(np.float32), noise, defects)
    return replace(dark, figures=_with_rounding(dark.quality(), mean)) if mean.step and mean.frames > 1 else dark


def _with_rounding(figures: Mapping[str, float], mean: MeanVolts) -> dict[str, float]:
    """Return the figures of a part from frames of counts: their noise includes rounding, and so do their offsets."""
    noise = max(figures["noise_v"], math.sqrt(mean.rounding))
    longer = float(np.max(mean.mean_noise() / mean.frame_noise()))
    return {**figures, "noise_v": noise, "offset_stderr_v": noise * longer}


def tells_dead(mean: MeanVolts, /) -> bool:
    """Return whether there are enough frames to tell dead pixels: no sound pixel then holds the same value in all of
    them by chance.

    A pixel whose level lies u steps from the middle of a count holds it in all of n frames with the probability
    (Φ((½ − u)/σ) − Φ((−½ − u)/σ))ⁿ, σ being the noise in steps. Levels lie anywhere, so this is integrated over u.
    """
    if not mean.step:
        return True
    require_memory_for_scipy()
    from scipy.special import ndtr

    variance = float((mean.frame_noise() ** 2).min()) - mean.rounding
    sigma = max(math.sqrt(max(variance, 0.0)) / abs(mean.step), 1e-3)
    level = np.linspace(-1.0, 1.0, 3001) * (0.5 + 6.0 * sigma)
    same = (ndtr((0.5 - level) / sigma) - ndtr((-0.5 - level) / sigma)) ** mean.frames
    return float(same.sum() * (level[1] - level[0])) * mean.volts.size <= MOST_ALIKE


def _planes(values: Float) -> Float:
    return values.reshape(-1, *values.shape[-2:])


def _variance_limits(frames: int) -> tuple[float, float]:
    """Return the least and the largest sample variance that a sound pixel may have in so many frames, over its true
    variance."""
    low, high = (variance_ratio(frames, share) for share in (NOISE_FALSE_ALARM, 1.0 - NOISE_FALSE_ALARM))
    return min(low, NOISE_RATIO**-2), max(high, NOISE_RATIO**2)
