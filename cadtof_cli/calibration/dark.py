"""Dark calibration: what each pixel shows without light, and the pixels that cannot be trusted."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Float, Float32, sealed
from cadtof_cli.calibration.fit.robust import centre_and_spread
from cadtof_cli.calibration.parts import Maps, Origin, PartKind, Tables, named_planes, stacked
from cadtof_cli.errors import SettingsError
from cadtof_cli.files.frames import CHANNELS
from cadtof_cli.phasors.frame_mean import FrameMean, median_variance_ratio

OFFSET_LIMIT = 8.0
"""Robust standard deviations beyond which an offset is an outlier: Gaussian offsets reach 5.5 in a megapixel."""

ROUNDING = 8.0 * float(np.finfo(np.float32).eps)
"""Where there is no noise: share of the median offset that rounding may move an offset by."""

ROUNDING_V = 1e-12
"""The same in volts, for a median offset near 0."""

NOISE_FALSE_ALARM = 1e-9
"""Probability that a sound pixel's noise is taken for an outlier by chance; it must also differ by `NOISE_RATIO`."""

MOST_ALIKE = 0.1
"""Sound channels of a whole array that may hold the same count in all frames by chance, where those that do are called dead."""

NOISE_RATIO = 2.0
"""Least ratio of the noise of an outlier to that of the other pixels, or the other way round."""


class Defect(IntFlag):
    """What is wrong with a pixel."""

    OFFSET = 1
    NOISE = 2
    DEAD = 4
    NOT_FINITE = 8


DEFECT_MEANING: dict[Defect, str] = {
    Defect.OFFSET: "an offset far from the other pixels'",
    Defect.NOISE: "noise far above the other pixels'",
    Defect.DEAD: "a value that hardly changes",
    Defect.NOT_FINITE: "saturated or not finite in a dark frame",
}


@dataclass(frozen=True, eq=False)
class DarkCalibration:
    """Offsets that are there whatever the light, in V, and noise of a single dark frame, float32 (H, 2, Y, X) each.

    `defects`, uint32 (Y, X), holds bits of `Defect`; `figures` is what `quality` said when the part was made, without it they
    follow from the maps. An offset is what electronics and stray charge add, and the mean of the
    sampled wave, which all light adds alike because the average of Eq. (1) is one over photons of every origin.
    """

    kind: ClassVar[PartKind] = "dark"

    origin: Origin
    offset_v: Float32
    noise_v: Float32
    defects: NDArray[np.uint32]
    figures: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = (len(self.origin.harmonics), CHANNELS, *self.origin.pixels)
        for name, expected in (("offset_v", shape), ("noise_v", shape), ("defects", self.origin.pixels)):
            values = getattr(self, name)
            if values.shape != expected:
                raise ValueError(f"{name}: found shape {values.shape}, expected {expected}")
            object.__setattr__(self, name, sealed(values.view()))

    @property
    def hot(self) -> Bool:
        """Pixels that `resolve` gives no answer for, (Y, X)."""
        return np.asarray(self.defects != 0)

    def defect_counts(self) -> dict[str, int]:
        """Return how many pixels have which defect."""
        return {str(bit.name).lower(): int(np.count_nonzero(self.defects & bit)) for bit in Defect}

    def quality(self) -> dict[str, float]:
        """Return figures of the fit in V: spread of the offsets, typical noise of a frame, and what is left of it."""
        if self.figures:
            return dict(self.figures)
        sound, frames = ~self.hot, self.origin.frames
        noise = float(np.median(self.noise_v[:, :, sound])) if sound.any() else float("nan")
        noise /= math.sqrt(median_variance_ratio(frames)) if frames > 1 else 1.0
        offsets = self.offset_v[:, :, sound].astype(np.float64)
        return {
            "offset_mean_v": float(offsets.mean()) if sound.any() else float("nan"),
            "offset_std_v": float(offsets.std()) if sound.any() else float("nan"),
            "noise_v": noise,
            "offset_stderr_v": noise / math.sqrt(frames),
        }

    def tables(self) -> dict[str, dict[str, Any]]:
        """Return fit quality and counts of defects."""
        return {"quality": self.quality(), "defects": self.defect_counts()}

    def maps(self) -> dict[str, NDArray[Any]]:
        """Return offsets and noise per channel, and the defects."""
        harmonics, maps = self.origin.harmonics, {"defects": self.defects}
        maps |= named_planes("offset", self.offset_v, harmonics, CHANNELS)
        return maps | named_planes("noise", self.noise_v, harmonics, CHANNELS)

    @classmethod
    def from_stored(cls, origin: Origin, tables: Tables, maps: Maps) -> Self:
        """Build the calibration from its maps, with the figures of its tables."""
        shape = (len(origin.harmonics), CHANNELS, *origin.pixels)
        offset, noise = (stacked(maps, what, origin.harmonics, CHANNELS).reshape(shape) for what in ("offset", "noise"))
        return cls(origin, offset, noise, np.asarray(maps["defects"], np.uint32), dict(tables["quality"]))


def fit_dark(mean: FrameMean, /, *, origin: Origin) -> DarkCalibration:
    """Return the dark calibration from the mean, in V, of covered-lens frames.

    A pixel is an outlier where its offset lies `OFFSET_LIMIT` robust standard deviations from the median of its plane, or
    its noise is outside what χ² allows around the plane's median variance. With one frame there is no noise to judge by, and with
    few frames of counts none is too small: they may hold the same by chance.

    Raises:
        SettingsError: no pixel is sound in every frame.
    """
    if not mean.sound.any():
        raise SettingsError(
            "dark frames: found no pixel that is finite and not saturated in all of them, expected most pixels"
        )
    variances = np.zeros_like(mean.stored) if mean.variance is None else mean.variance
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
    """Return whether there are so many frames that a sound pixel does not hold the same value in all of them by chance.

    Of n Gaussian values that are rounded to steps of s, all are the same with a probability of (s/(σ·√(2π)))^(n − 1)/√n, where s
    is no larger than σ.
    """
    if not mean.step:
        return True
    sigma = max(float(mean.frame_noise().min()), mean.step)
    alike = (mean.step / (sigma * math.sqrt(2.0 * math.pi))) ** (mean.frames - 1) / math.sqrt(mean.frames)
    return alike * mean.stored.size <= MOST_ALIKE


def _planes(values: Float) -> Float:
    return values.reshape(-1, *values.shape[-2:])


def _variance_limits(frames: int) -> tuple[float, float]:
    """Return the least and the largest sample variance of a sound pixel over the true one, from so many frames."""
    from scipy.stats import chi2

    freedom = frames - 1
    low, high = chi2.ppf([NOISE_FALSE_ALARM, 1.0 - NOISE_FALSE_ALARM], freedom) / freedom
    return min(float(low), NOISE_RATIO**-2), max(float(high), NOISE_RATIO**2)
