"""Recorded frames of a scene that stands still → their mean, which has less noise; in V, also their scatter about it."""

from collections.abc import Iterable

import numpy as np

from cadtof_cli.arrays import Bool, Float, Stored
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.errors import SettingsError, require_memory_for_scipy
from cadtof_cli.phasors.noise import repeated_rounding
from cadtof_cli.phasors.voltages import sound_pixels, volts_from_stored, volts_per_count
from cadtof_cli.records import dataclass


@dataclass(frozen=True, eq=False)
class FrameMean:
    """The mean of frames, which is resolved in place of one frame.

    Attributes:
        stored: the mean of the stored values, (H, 2, Y, X).
        samples: number of frames that each pixel is a mean of, float64 (Y, X).
        dtype: of the values as they were recorded.
    """

    stored: Stored
    samples: Float
    dtype: np.dtype[np.generic]


@dataclass(frozen=True, eq=False)
class MeanVolts:
    """The mean of frames in V, which a calibration is measured from.

    Attributes:
        volts: the mean, float64 (H, 2, Y, X); NaN in pixels that were not sound in every frame.
        variance: sample variance of one frame about the mean, in V², float64 (H, 2, Y, X); 0 if there is one frame.
        frames: how many frames there were.
        step: between neighbouring values that a frame can hold, in V; 0 for floating-point values.
    """

    volts: Float
    variance: Float
    frames: int
    step: float = 0.0

    @property
    def pixels(self) -> tuple[int, int]:
        """Size of the array, (Y, X)."""
        height, width = self.volts.shape[2:]
        return height, width

    @property
    def sound(self) -> Bool:
        """The pixels with a finite mean at every harmonic and channel, (Y, X)."""
        return np.asarray(np.isfinite(self.volts).all(axis=(0, 1)))

    def frame_noise(self) -> Float:
        """Return the typical standard deviation of one frame's values at each harmonic, (H,): 0 if there is one frame.

        It is at least that of rounding to steps, which frames do not show if their noise is smaller than a step.
        """
        if self.frames < 2:
            return np.zeros(self.volts.shape[0])
        typical = np.median(self.variance[:, :, self.sound], axis=(1, 2)) / median_variance_ratio(self.frames)
        return np.asarray(np.sqrt(np.maximum(typical, self.rounding)))

    def mean_noise(self) -> Float:
        """Return the typical standard deviation of the mean's values at each harmonic, (H,): 0 if there is one frame.

        The rounding errors that all frames have in common stay in their mean (`repeated_rounding`).
        """
        noise = self.frame_noise()
        alone = noise / np.sqrt(self.frames)
        if not (self.rounding and noise.all()):
            return np.asarray(alone)
        common = [repeated_rounding(one**2 / self.rounding - 1.0) * self.rounding / one**2 for one in noise]
        return np.asarray(alone * np.sqrt(1.0 + (self.frames - 1) * np.array(common)))

    @property
    def rounding(self) -> float:
        """Variance of the errors by rounding to steps."""
        return self.step**2 / 12.0


def median_variance_ratio(frames: int, /) -> float:
    """Return the median of the sample variance from so many frames (2 or more) over the true variance, for Gaussian noise."""
    return variance_ratio(frames, 0.5)


def variance_ratio(frames: int, share: float, /) -> float:
    """Return the ratio of the sample variance from so many frames (2 or more) to the true variance that this share of all
    ratios lies below, for Gaussian noise."""
    require_memory_for_scipy()
    # a quantile of chi² as in `scipy.stats`, which takes half a second and 70 MB more to import
    from scipy.special import gammaincinv

    freedom = frames - 1
    return 2.0 * float(gammaincinv(freedom / 2, share)) / freedom


def frame_mean(frames: Iterable[Stored], /, *, saturated_counts: tuple[float, float] | None) -> FrameMean:
    """Return the mean of one or more frames of stored values, (H, 2, Y, X) each.

    The mean of a pixel is over the frames in which it is sound. A pixel that is sound in no frame keeps its values of
    the first frame, and counts as one sample.
    """
    for number, stored in enumerate(frames):
        if number == 0:
            first, total, count = stored, np.zeros(stored.shape), np.zeros(stored.shape[2:])
        sound = sound_pixels(stored, saturated_counts)
        total += np.where(sound, stored, 0)
        count += sound
    samples = np.maximum(count, 1.0)
    return FrameMean(np.where(count > 0.0, total / samples, first), samples, first.dtype)


def mean_volts(frames: Iterable[Stored], /, *, voltage: Voltage) -> MeanVolts:
    """Return the mean of one or more frames of stored values, (H, 2, Y, X) each.

    Welford's update loses no digits to a large offset.

    Raises:
        SettingsError: sizes of frames differ, or nothing says how many volts one count stands for.
    """
    for count, stored in enumerate(frames, start=1):
        volts = volts_from_stored(stored, voltage)
        if count == 1:
            step = volts_per_count(voltage, stored.dtype) if stored.dtype.kind in "iu" else 0.0
            mean, squares, sound = np.zeros(volts.shape), np.zeros(volts.shape), np.ones(volts.shape[2:], np.bool_)
        if volts.shape != mean.shape:
            raise SettingsError(f"found a frame of shape {volts.shape} (H C Y X), expected {mean.shape}")
        sound &= sound_pixels(stored, voltage.saturated_counts)
        # an infinite value makes NaN here, without harm: its pixel is not sound
        with np.errstate(over="ignore", invalid="ignore"):
            change = volts - mean
            mean += change / count
            squares += change * (volts - mean)
    variance = squares / max(count - 1, 1)
    return MeanVolts(np.where(sound, mean, np.nan), variance, count, step)
