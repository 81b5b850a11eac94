"""Errors of depth maps against truth, gathered over any number of frames in constant memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float

BIN_CM = 0.001
"""Width of the bins in which |error| is counted, and so the resolution of its quantiles."""

BINS = 1_000_000


@dataclass(frozen=True)
class DepthErrors:
    """Summary of depth errors in cm; `valid` is the share of pixels with truth that have an answer, the rest is of those."""

    median_cm: float | None
    p90_cm: float | None
    rmse_cm: float | None
    bias_cm: float | None
    valid: float


class ErrorTally:
    """Counts errors frame by frame: |error| in bins for the quantiles, sums for mean and mean square."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(BINS + 1, np.int64)
        self._sum_cm = 0.0
        self._sum_of_squares = 0.0
        self._with_truth = 0

    def add(self, depth_m: NDArray[np.floating], truth_m: NDArray[np.floating], /) -> None:
        """Add a frame's depths against its truth, (Y, X) each in m; pixels without truth do not count."""
        known = np.isfinite(truth_m)
        self._with_truth += int(np.count_nonzero(known))
        error: Float = 100.0 * (depth_m.astype(np.float64) - truth_m)[known]
        error = error[np.isfinite(error)]
        self._sum_cm += float(error.sum())
        self._sum_of_squares += float(np.square(error).sum())
        bins = np.minimum(np.abs(error) / BIN_CM, BINS).astype(np.int64)
        self._counts += np.bincount(bins, minlength=BINS + 1)

    def summary(self) -> DepthErrors:
        """Return the errors so far; None for every figure where no pixel has both truth and an answer."""
        total = int(self._counts.sum())
        valid = total / self._with_truth if self._with_truth else 0.0
        if not total:
            return DepthErrors(None, None, None, None, valid)
        return DepthErrors(
            self._quantile(0.5),
            self._quantile(0.9),
            float(np.sqrt(self._sum_of_squares / total)),
            self._sum_cm / total,
            valid,
        )

    def _quantile(self, share: float) -> float:
        """Return the middle of the bin in which the quantile lies."""
        below = np.cumsum(self._counts)
        return float((np.searchsorted(below, share * below[-1]) + 0.5) * BIN_CM)
