"""Errors of depth maps against truth, and the scatter of depth over time: gathered over any number of frames in
constant memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.maps.comparison import MagnitudeTally

ERROR_TITLES = ("median", "90 %", "RMSE", "bias", "valid", "in 1 σ", "in 2 σ")
"""Titles of the columns of a table of errors; the first two columns are of |error|."""

LARGEST_M = float(np.finfo(np.float32).max)
"""Depths and errors beyond this count as missing. Files of float32 hold infinity in place of such a number."""


@dataclass(frozen=True)
class DepthErrors:
    """Summary of depth errors in cm. `valid` is the share of pixels with truth that have an answer; all other figures
    are of these pixels with an answer.

    `within_1_sigma` and `within_2_sigma` are the shares of pixels with an error of at most once and twice the predicted
    standard deviation: .68 and .95 if the prediction is right and errors are Gaussian. None if no standard deviation is
    known.
    """

    median_cm: float | None
    p90_cm: float | None
    rmse_cm: float | None
    bias_cm: float | None
    valid: float
    within_1_sigma: float | None = None
    within_2_sigma: float | None = None

    @property
    def in_words(self) -> tuple[str, ...]:
        """The figures as texts for people, in the order of `ERROR_TITLES`."""
        figures = (self.median_cm, self.p90_cm, self.rmse_cm, self.bias_cm)
        shares = (self.valid, self.within_1_sigma, self.within_2_sigma)
        return (
            *("–" if figure is None else f"{figure:.2f}" for figure in figures),
            *("–" if share is None else f"{share:.1%}" for share in shares),
        )


class ErrorTally:
    """Counts errors frame by frame: magnitudes for the quantiles, sums for mean and mean square."""

    def __init__(self) -> None:
        self._magnitudes = MagnitudeTally()
        self._answered = 0
        self._sum_cm = 0.0
        self._sum_of_squares = 0.0
        self._with_truth = 0
        self._within = [0, 0]
        self._with_sigma = 0

    def add(
        self,
        depth_m: NDArray[np.floating],
        truth_m: NDArray[np.floating],
        /,
        *,
        sigma_m: NDArray[np.floating] | None = None,
    ) -> None:
        """Add a frame's depths against its truth, and their predicted standard deviations, (Y, X) each in m.

        Pixels without truth, or with a truth beyond `LARGEST_M`, do not count. Pixels without a standard deviation do not
        count in the shares within it.
        """
        known = np.abs(truth_m) <= LARGEST_M
        self._with_truth += int(np.count_nonzero(known))
        error: Float = 100.0 * (depth_m[known].astype(np.float64) - truth_m[known])
        answered = np.abs(error) <= 100.0 * LARGEST_M
        error = error[answered]
        if sigma_m is not None:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                # a standard deviation that is missing or 0 makes a ratio that is not finite, which is not counted
                ratio: Float = np.abs(error) / (100.0 * sigma_m.astype(np.float64)[known][answered])
            self._with_sigma += int(np.count_nonzero(np.isfinite(ratio)))
            self._within = [count + int(np.count_nonzero(ratio <= k)) for k, count in enumerate(self._within, start=1)]
        self._sum_cm += float(error.sum())
        self._sum_of_squares += float(np.square(error).sum())
        self._answered += error.size
        self._magnitudes.add(error)

    def summary(self) -> DepthErrors:
        """Return the errors so far; figures are None if no pixel has both truth and an answer."""
        total, magnitudes = self._answered, self._magnitudes.summary()
        valid = total / self._with_truth if self._with_truth else 0.0
        return DepthErrors(
            magnitudes.median_abs,
            magnitudes.p90_abs,
            float(np.sqrt(self._sum_of_squares / total)) if total else None,
            self._sum_cm / total if total else None,
            valid,
            *(count / self._with_sigma if self._with_sigma else None for count in self._within),
        )


@dataclass(frozen=True)
class Evaluation:
    """Errors of the direct depth, and of the depth by the first phasor alone if the recorded frames of all maps still
    exist."""

    frames: int
    direct: DepthErrors
    first_phasor: DepthErrors | None

    @property
    def in_words(self) -> dict[str, DepthErrors]:
        """The errors by what they are of, in words for people, in the order of a table."""
        first = {} if self.first_phasor is None else {"first phasor": self.first_phasor}
        return first | {"direct path": self.direct}


class EvaluationTally:
    """Counts the errors of maps, and the errors of the depth by the first phasor alone, map by map."""

    def __init__(self) -> None:
        self._direct, self._first = ErrorTally(), ErrorTally()
        self._frames = self._compared = 0

    def add(
        self, direct_m: Float, truth_m: Float, /, *, sigma_m: NDArray[np.floating] | None, first_phasor_m: Float | None
    ) -> None:
        """Add a map's direct depths (or those of another path), and the depths by the first phasor (None: unknown), with their
        truth.

        All are (Y, X) in m.
        """
        self._frames += 1
        self._direct.add(direct_m, truth_m, sigma_m=sigma_m)
        if first_phasor_m is not None:
            self._compared += 1
            self._first.add(first_phasor_m, truth_m)

    def summary(self) -> Evaluation:
        """Return the errors so far."""
        first = self._first.summary() if self._compared == self._frames else None
        return Evaluation(self._frames, self._direct.summary(), first)


@dataclass(frozen=True, eq=False)
class OverTime:
    """Statistics of each pixel over a sequence of maps, float32 (Y, X); NaN if the pixel has too few answers.

    Attributes:
        mean: mean over the maps that have an answer in this pixel.
        std: standard deviation over these maps, with n − 1; needs two answers.
        sigma: root mean square of the predicted standard deviations.
        frames: number of maps that have an answer.
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
        """Add a map, (Y, X), and its predicted standard deviations; NaN in pixels without an answer.

        A value beyond `LARGEST_M` counts as no answer.
        """
        known = np.abs(values) <= LARGEST_M
        self._count += known
        step = np.where(known, values - self._mean, 0.0)
        self._mean += step / np.maximum(self._count, 1.0)
        self._squares += step * np.where(known, values - self._mean, 0.0)
        with np.errstate(over="ignore"):
            variances = np.nan if sigma is None else np.square(sigma.astype(np.float64))
        self._variances += np.where(known, variances, 0.0)

    def summary(self) -> OverTime:
        """Return the statistics of the maps so far."""
        count = np.where(self._count > 0, self._count, np.nan)
        free = np.where(self._count > 1, self._count - 1.0, np.nan)
        mean, std = np.where(self._count > 0, self._mean, np.nan), np.sqrt(self._squares / free)
        planes = (mean, std, np.sqrt(self._variances / count), self._count)
        with np.errstate(over="ignore"):
            return OverTime(*(plane.astype(np.float32) for plane in planes))
