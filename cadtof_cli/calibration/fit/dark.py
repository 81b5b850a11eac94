"""Frames of a covered lens → each pixel's offset and noise, and the defective pixels."""

import math

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.calibration.dark import DarkCalibration, Defect
from cadtof_cli.calibration.fit.robust import centre_and_spread
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.frame_mean import FrameMean, median_variance_ratio

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


def fit_dark(mean: FrameMean, /, *, origin: Origin, predicted_noise_v: float) -> DarkCalibration:
    """Return the dark calibration from the mean, in V, of frames of a covered lens.

    `predicted_noise_v` is the noise of a channel of one frame. It is used if there is only one frame, which does not
    show its own noise.

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
    measured = mean.variance if mean.frames > 1 else None
    variances = np.full_like(mean.stored, predicted_noise_v**2) if measured is None else measured
    defects, dead_are_told = np.zeros(mean.pixels, np.uint32), tells_dead(mean)
    defects[~mean.sound] |= np.uint32(Defect.NOT_FINITE)
    for offset, variance in zip(_planes(mean.stored), _planes(variances), strict=True):
        centre, spread = centre_and_spread(offset)
        most = max(OFFSET_LIMIT * spread, ROUNDING * abs(centre), ROUNDING_V)
        defects[np.abs(offset - centre) > most] |= np.uint32(Defect.OFFSET)
        if mean.frames > 1:
            low, high = _variance_limits(mean.frames)
            typical = float(np.nanmedian(variance)) / median_variance_ratio(mean.frames)
            if typical > 0.0:
                defects[variance > high * typical] |= np.uint32(Defect.NOISE)
                if dead_are_told:
                    defects[variance < low * typical] |= np.uint32(Defect.DEAD)
    noise = np.sqrt(np.nan_to_num(variances)).astype(np.float32)
    return DarkCalibration(origin, np.nan_to_num(mean.stored).astype(np.float32), noise, defects)


def tells_dead(mean: FrameMean, /) -> bool:
    """Return whether there are enough frames to tell dead pixels: no sound pixel then holds the same value in all of
    them by chance.

    n Gaussian values that are rounded to steps of s are all the same with a probability of (s/(σ·√(2π)))^(n − 1)/√n, if
    s is no larger than σ.
    """
    if not mean.step:
        return True
    sigma = max(float(mean.frame_noise().min()), mean.step)
    alike = (mean.step / (sigma * math.sqrt(2.0 * math.pi))) ** (mean.frames - 1) / math.sqrt(mean.frames)
    return alike * mean.stored.size <= MOST_ALIKE


def _planes(values: Float) -> Float:
    return values.reshape(-1, *values.shape[-2:])


def _variance_limits(frames: int) -> tuple[float, float]:
    """Return the least and the largest sample variance that a sound pixel may have in so many frames, over its true
    variance."""
    from scipy.stats import chi2

    freedom = frames - 1
    low, high = chi2.ppf([NOISE_FALSE_ALARM, 1.0 - NOISE_FALSE_ALARM], freedom) / freedom
    return min(float(low), NOISE_RATIO**-2), max(float(high), NOISE_RATIO**2)
