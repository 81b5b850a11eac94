"""Robust fits, in which outliers have no weight: Gauss–Newton with Tukey's biweight, and the residuals in blocks of the
array.

Medians of blocks keep the shapes of a scene and the paths that it adds, and little of noise and of pixels' own phases.
They show whether a target was the flat wall that the calibration expects. Their limits are lengths, not multiples of
the noise: a mean of many frames makes small errors of a sound camera visible, and these errors are no reason to refuse
it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import MAD_PER_SIGMA

BIWEIGHT_LIMIT = 4.685
"""Residual, in units of the scale, above which an observation has no weight. With this limit the biweight is 95 % as
efficient as least squares on Gaussian noise."""

BIWEIGHT_EFFICIENCY = 0.95
"""Efficiency of the biweight with this limit; the covariance of least squares is divided by it."""

MOST_STEPS = 60
"""Largest number of Gauss–Newton steps. Which observations are outliers mostly does not change any more after a few steps."""

CONVERGED = 1e-4
"""The fit ends if no parameter changes by more than this many standard errors."""

BLOCKS = 12
"""Number of blocks along the shorter side of the array, if the side has enough pixels."""

LEAST_IN_BLOCK = 4
"""Least number of values in a block that counts."""

MEDIAN_VARIANCE = 0.5 * np.pi
"""Variance of a median over the variance of a mean, for Gaussian values."""

HIGHEST_CONDITION = 1e13
"""Condition of the normal matrix above which the observations do not determine the parameters: rounding leaves no digits."""

SURE = 3.0
"""Standard deviations by which a shape or a lean must exceed what scatter explains."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """A fit of p parameters to n observations.

    Attributes:
        parameters: (p,).
        covariance: (p, p), scaled by the robust variance of the residuals.
        stderr: (p,), standard errors of the parameters.
        residual: (n,), in units of the observations' standard deviations.
        weights: (n,), from 0, for outliers, to 1.
        scale: robust standard deviation of `residual`; 1 if the observations' standard deviations are right.
        condition: condition number of the normal matrix with unit diagonal.
    """

    parameters: Float
    covariance: Float
    stderr: Float
    residual: Float
    weights: Float
    scale: float
    condition: float


def robust_fit(
    model: Callable[[Float], tuple[Float, Float]], start: Float, /, *, given: Float | None = None
) -> RobustFit:
    """Fit parameters, (p,), from a start that need not be close if the model is nearly linear.

    `model` returns, for given parameters, the residuals, (n,), and the derivatives of the modelled values by all
    parameters, (n, p), both in units of the observations' standard deviations. `given`, (p,), holds the values of known
    parameters, which have no variance, and NaN for those that are fitted (None: all).

    Raises:
        SettingsError: the observations do not determine the parameters.
    """
    given = np.full(start.size, np.nan) if given is None else given
    free, covariance = np.isnan(given), np.zeros((start.size, start.size))
    parameters = np.where(free, start, given)
    for _ in range(MOST_STEPS):
        residual, every = model(parameters)
        scale, weights = _weighted(residual)
        slopes = every[:, free]
        normal = (slopes * weights[:, np.newaxis]).T @ slopes
        inverse, _ = _inverse(normal)
        change = inverse @ (slopes.T @ (weights * residual))
        parameters[free] += change
        if np.all(np.abs(change) <= CONVERGED * scale * np.sqrt(np.diag(inverse))):
            break
    residual, every = model(parameters)
    scale, weights = _weighted(residual)
    slopes, kept = every[:, free], weights > 0.0
    inverse, condition = _inverse(slopes[kept].T @ slopes[kept])
    covariance[np.ix_(free, free)] = inverse * scale**2 / BIWEIGHT_EFFICIENCY
    return RobustFit(parameters, covariance, np.sqrt(np.diag(covariance)), residual, weights, scale, condition)


def centre_and_spread(values: Float, /) -> tuple[float, float]:
    """Return the median of values of any shape, and their standard deviation by the median absolute deviation; NaN is
    left out."""
    centre = float(np.nanmedian(values))
    return centre, float(np.nanmedian(np.abs(values - centre))) / MAD_PER_SIGMA


def _weighted(residual: Float) -> tuple[float, Float]:
    """Return the robust standard deviation of residuals, and the weights that follow from it."""
    scale = max(float(np.median(np.abs(residual))) / MAD_PER_SIGMA, float(np.finfo(np.float64).eps))
    share = np.minimum((residual / scale / BIWEIGHT_LIMIT) ** 2, 1.0)
    return scale, np.asarray((1.0 - share) ** 2)


def _inverse(normal: Float) -> tuple[Float, float]:
    """Return the inverse and the condition number of a normal matrix, as `scaled_inverse` does; raise SettingsError if
    it has none."""
    if not (np.diag(normal) > 0.0).all():
        raise SettingsError("the observations do not determine all parameters: a wall or distance has no usable pixels")
    inverse, condition = scaled_inverse(normal, most=HIGHEST_CONDITION)
    if inverse is None:
        raise SettingsError(
            f"the observations do not determine all parameters (condition {condition:.1e}): "
            "add captures at other distances, or give what is known"
        )
    return inverse, condition


def scaled_inverse(normal: Float, /, *, most: float) -> tuple[Float | None, float]:
    """Return the inverse of a normal matrix, and its condition number after scaling its diagonal to 1.

    The inverse is None if the condition number exceeds `most`.
    """
    norm = 1.0 / np.sqrt(np.diag(normal))
    scale = np.outer(norm, norm)
    condition = float(np.linalg.cond(normal * scale))
    return np.linalg.inv(normal * scale) * scale if condition <= most else None, condition


def blocks(where: Bool, /) -> list[Index]:
    """Return, for each square block of the array with enough values, the indices of its values.

    The values belong to the pixels that `where`, (Y, X), marks, row by row.
    """
    size = max(2, -(-min(where.shape) // BLOCKS))
    rows, columns = np.nonzero(where)
    block = (rows // size) * where.shape[1] + columns // size
    order = np.argsort(block, kind="stable")
    _, starts = np.unique(block[order], return_index=True)
    return [places for places in np.split(order, starts[1:]) if places.size >= LEAST_IN_BLOCK]


def shape_rms(values: Float, where: Bool, /) -> float:
    """Return the root mean square of the blocks' medians, without the part that the scatter within blocks explains; at
    least 0.

    The values, (m,), belong to the pixels that `where` marks, as in `blocks`.
    """
    groups = [values[places] for places in blocks(where)]
    if not groups:
        return 0.0
    square = float(np.mean([np.median(group) ** 2 for group in groups]))
    chance = MEDIAN_VARIANCE * float(np.mean([np.var(group, ddof=1) / group.size for group in groups]))
    return float(np.sqrt(max(0.0, square - (1.0 + SURE * np.sqrt(2.0 / len(groups))) * chance)))
