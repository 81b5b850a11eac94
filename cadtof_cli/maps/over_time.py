"""Mean and standard deviation of a sequence of maps, pixel by pixel, in the memory of one map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32


@dataclass(frozen=True, eq=False)
class OverTime:
    """What a sequence says of each pixel, float32 (Y, X): NaN where there is nothing to say.

    Attributes:
        mean: of the maps that have an answer there.
        std: standard deviation over them, with n − 1; from two answers on.
        sigma: root mean square of the standard deviations that were predicted.
        frames: how many maps have an answer.
    """

    mean: Float32
    std: Float32
    sigma: Float32
    frames: Float32


class SequenceTally:
    """Gathers maps of one size one after the other, by Welford's updates, which lose no digits."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._count: Float = np.zeros(shape)
        self._mean: Float = np.zeros(shape)
        self._squares: Float = np.zeros(shape)
        self._variances: Float = np.zeros(shape)

    def add(self, values: NDArray[np.floating], sigma: NDArray[np.floating] | None, /) -> None:
        """Add a map, (Y, X), and the standard deviations that were predicted for it; NaN where there is no answer."""
        known = np.isfinite(values)
        self._count += known
        step = np.where(known, values.astype(np.float64) - self._mean, 0.0)
        self._mean += step / np.maximum(self._count, 1.0)
        self._squares += np.where(known, step * (values.astype(np.float64) - self._mean), 0.0)
        self._variances += np.where(known, np.nan if sigma is None else np.square(sigma.astype(np.float64)), 0.0)

    def summary(self) -> OverTime:
        """Return what the maps so far say."""
        count = np.where(self._count > 0, self._count, np.nan)
        free = np.where(self._count > 1, self._count - 1.0, np.nan)
        mean, std = self._mean + 0.0 * count, np.sqrt(self._squares / free)
        planes = (mean, std, np.sqrt(self._variances / count), self._count)
        return OverTime(*(plane.astype(np.float32) for plane in planes))
