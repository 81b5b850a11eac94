"""Many frames of a scene that stands still → their mean and their noise, a frame at a time."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cadtof_cli.arrays import Bool, Float, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import SettingsError


@dataclass(frozen=True, eq=False)
class MeanFrame:
    """The mean of `frames` frames in V and the sample variance of one in V², float64 (H, 2, Y, X).

    `sound`, bool (Y, X), is false where any value of any frame was saturated or not finite; the mean is NaN there.
    """

    mean_v: Float
    variance_v2: Float
    sound: Bool
    frames: int

    @property
    def pixels(self) -> tuple[int, int]:
        """Size of the array, (Y, X)."""
        return self.mean_v.shape[2], self.mean_v.shape[3]

    def noise_v(self) -> Float:
        """Return the typical standard deviation of one frame's voltages at each harmonic, (H,): 0 where there is one frame."""
        if self.frames < 2:
            return np.zeros(self.mean_v.shape[0])
        typical = np.median(self.variance_v2[:, :, self.sound], axis=(1, 2)) / median_variance_ratio(self.frames)
        return np.asarray(np.sqrt(typical))


class FrameAverage:
    """A running mean and variance, by Welford's update, which loses no digits to a large offset."""

    def __init__(self, metadata: CaptureMetadata) -> None:
        self._voltage = metadata.voltage
        self._count = 0

    def add(self, stored: Stored, /) -> Self:
        """Take in one more frame of stored values, (H, 2, Y, X).

        Raises:
            SettingsError: its size differs from the first frame's, or nothing says how many volts a count stands for.
        """
        volts = self._volts(stored)
        if self._count == 0:
            self._mean, self._squares = np.zeros_like(volts), np.zeros_like(volts)
            self._sound = np.ones(volts.shape[2:], np.bool_)
        if volts.shape != self._mean.shape:
            raise SettingsError(f"found a frame of shape {volts.shape} (H C Y X), expected {self._mean.shape}")
        self._sound &= self._usable(stored, volts)
        self._count += 1
        change = volts - self._mean
        self._mean += change / self._count
        self._squares += change * (volts - self._mean)
        return self

    def result(self) -> MeanFrame:
        """Return what the frames so far give; there must have been one."""
        mean = np.where(self._sound, self._mean, np.nan)
        return MeanFrame(mean, self._squares / max(self._count - 1, 1), self._sound.copy(), self._count)

    def _volts(self, stored: Stored) -> Float:
        per_count = self._voltage.volts_per_count
        if per_count is None:
            if stored.dtype.kind != "f":
                raise SettingsError(
                    f"frames hold whole numbers ({stored.dtype}), and nothing says how many volts a count is: "
                    "set volts_per_count under [voltage] in capture.toml, or --volts-per-count"
                )
            per_count = 1.0
        return (stored.astype(np.float64) - self._voltage.zero_counts) * per_count

    def _usable(self, stored: Stored, volts: Float) -> Bool:
        usable = np.asarray(np.isfinite(volts).all(axis=(0, 1)), np.bool_)
        if self._voltage.saturated_counts is not None:
            low, high = self._voltage.saturated_counts
            usable &= np.asarray(((stored > low) & (stored < high)).all(axis=(0, 1)), np.bool_)
        return usable


def median_variance_ratio(frames: int, /) -> float:
    """Return the median of the sample variance from so many frames (2 or more) over the true variance, for Gaussian noise."""
    from scipy.stats import chi2

    return float(chi2.median(frames - 1)) / (frames - 1)
