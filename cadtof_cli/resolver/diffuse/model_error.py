"""Errors of the model in the values of a patch, whatever the noise: surfaces are neither flat nor matt, and rooms are
no patches.

The errors of a patch's values have common causes. Light that comes earlier than the model has it hardly changes the
ratios of the harmonics, but it changes the lag of the fundamental. So the difference of the data from the model tells
something about the error of the lag.
"""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Complex, Float, median, sealed

RATIO_ERROR = (0.023, 0.02)
"""Standard deviation of ln|p_h/p_1|: for h = 2, and for the harmonics after it."""

PHASE_ERROR = (0.028, 0.021)
"""Standard deviation of arg p_h − h·arg p_1, rad, for the same harmonics."""

LAG_WITH_DATA = {1: (-0.5, -0.2), 2: (0.25, -0.45, -0.7, 0.1)}
"""Covariance of the error of arg H_1 with the errors of the data, in the data's order and in `UNIT`; by the number of
harmonics after the first."""

UNIT = 0.02**2
"""The square of a usual error."""

FULL_MPI = 0.06
"""|q_2 − 1| of a patch, or in the median of a frame, from which errors are as large as given above. With less MPI, less
of it can be wrong. Nine of ten rendered rooms have more in the median."""

LEAST_SHARE = 0.02
"""Least share of these errors: no lens is without stray light."""


def model_error(ratios: Complex, /) -> Float:
    """Return the covariance of the errors of patches' values, (2·following + 2, 2·following + 2, n).

    The order is that of `tail.free_of_direct`. `ratios`, (following, n), are the q_h of all patches of a frame. Errors
    are in proportion to the MPI of the frame, or to that of the patch if it has more: a frame with little MPI may show
    dim surfaces that get most of their light from others. The error of arg H_1 follows from the errors of the data.
    """
    shares = np.clip(np.abs(ratios[0] - 1.0) / FULL_MPI, mpi_share(ratios), 1.0)
    error: Float = full_error(len(ratios))[..., None] * shares**2
    return error


def mpi_share(ratios: Complex, /) -> float:
    """Return which share of the usual errors a frame has, from the q_h, (following, n), of its patches."""
    return min(max(float(median(np.abs(ratios[0] - 1.0))) / FULL_MPI, LEAST_SHARE), 1.0)


@lru_cache(maxsize=8)
def full_error(following: int, /) -> Float:
    """Return the covariance of `model_error` for full MPI and so many harmonics after the first."""
    error = np.zeros((2 * following + 2, 2 * following + 2))
    for kind, spread in enumerate((RATIO_ERROR, PHASE_ERROR)):
        for i in range(following):
            error[kind * following + i, kind * following + i] = spread[min(i, 1)] ** 2
    known = min(following, max(LAG_WITH_DATA))
    ties = np.zeros(2 * following)
    for kind in range(2):
        ties[kind * following : kind * following + known] = LAG_WITH_DATA[known][kind * known : (kind + 1) * known]
    ties *= UNIT
    error[-1, :-2] = error[:-2, -1] = ties
    error[-1, -1] = ties @ np.linalg.solve(error[:-2, :-2], ties)
    return sealed(error)
