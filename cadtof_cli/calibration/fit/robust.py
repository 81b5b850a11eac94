"""What outliers have no say in: least squares, Gauss–Newton with Tukey's biweight, and what is left over the array, in blocks.

Medians of blocks keep what a scene has, shapes and the paths that it adds, and little of noise and of pixels' own phases: they
tell whether a target was the flat wall that a calibration took it for. They are held against lengths, not against noise: many
frames make a sound camera's small errors visible, and those are no reason to refuse it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import MAD_PER_SIGMA

BIWEIGHT_LIMIT = 4.685
"""Residual over scale from which on an observation has no weight; 95 % as efficient as least squares on Gaussian noise."""

BIWEIGHT_EFFICIENCY = 0.95
"""Efficiency of the biweight with this limit, by which its covariance is larger than that of least squares."""

MOST_STEPS = 60
"""Gauss–Newton steps at the most; which observations are outliers is settled after a few of them, mostly."""

CONVERGED = 1e-4
"""Largest change in standard errors at which the fit ends."""

BLOCKS = 12
"""Blocks that the shorter side of the array has, as far as it has pixels enough."""

LEAST_IN_BLOCK = 4
"""Values from which on a block's median counts."""

MEDIAN_VARIANCE = 0.5 * np.pi
"""Variance of a median over that of a mean, for Gaussian values."""

HIGHEST_CONDITION = 1e13
"""Condition of the normal matrix above which the observations do not determine the parameters: rounding leaves no digits."""

SURE = 3.0
"""Standard deviations by which blocks must depart more than the scatter within them explains."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """A fit of p parameters to n observations.

    Attributes:
        parameters: (p,).
        covariance: (p, p), scaled by the residuals' own spread.
        residual: (n,), over the observations' standard deviations.
        weights: (n,), between 0, for outliers, and 1.
        scale: robust standard deviation of the residuals: 1 where they are as predicted.
        condition: of the normal matrix with unit diagonal.
    """

    parameters: Float
    covariance: Float
    residual: Float
    weights: Float
    scale: float
    condition: float


def robust_fit(
    model: Callable[[Float], tuple[Float, Float]], start: Float, /, *, free: Bool | None = None
) -> RobustFit:
    """Fit parameters, from a start (p,) that need not be close where the model is nearly linear.

    The model gives residuals (n,) over their standard deviations, and the derivatives of the modelled values over the same by
    the parameters that are `free`, (p,): all of them where it is None. The others stay, and have no variance.

    Raises:
        SettingsError: the observations do not determine the parameters.
    """
    parameters, covariance = start.astype(np.float64), np.zeros((start.size, start.size))
    free = np.ones(start.size, np.bool_) if free is None else free
    for _ in range(MOST_STEPS):
        residual, slopes = model(parameters)
        scale, weights = _weighted(residual)
        normal = (slopes * weights[:, np.newaxis]).T @ slopes
        inverse, condition = _inverse(normal)
        change = inverse @ (slopes.T @ (weights * residual))
        parameters[free] += change
        if np.all(np.abs(change) <= CONVERGED * scale * np.sqrt(np.diag(inverse))):
            break
    residual, slopes = model(parameters)
    scale, kept = _weighted(residual)
    inverse, condition = _inverse(slopes[kept > 0.0].T @ slopes[kept > 0.0])
    covariance[np.ix_(free, free)] = inverse * scale**2 / BIWEIGHT_EFFICIENCY
    return RobustFit(parameters, covariance, residual, kept, scale, condition)


def centre_and_spread(values: Float, /) -> tuple[float, float]:
    """Return the median of values of any shape, and their standard deviation by the median distance from it; NaN do not count."""
    centre = float(np.nanmedian(values))
    return centre, float(np.nanmedian(np.abs(values - centre))) / MAD_PER_SIGMA


def _weighted(residual: Float) -> tuple[float, Float]:
    """Return the robust standard deviation of residuals, and their weights by it."""
    scale = max(float(np.median(np.abs(residual))) / MAD_PER_SIGMA, float(np.finfo(np.float64).eps))
    share = np.minimum((residual / scale / BIWEIGHT_LIMIT) ** 2, 1.0)
    return scale, np.asarray((1.0 - share) ** 2)


def _inverse(normal: Float) -> tuple[Float, float]:
    """Return the inverse and the condition number of a normal matrix, see `scaled_inverse`, if it determines the parameters."""
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
    """Return the inverse and the condition number of a normal matrix, after its diagonal has been scaled to 1.

    There is no inverse where the condition number is not below `most`.
    """
    norm = 1.0 / np.sqrt(np.diag(normal))
    scale = np.outer(norm, norm)
    condition = float(np.linalg.cond(normal * scale))
    return np.linalg.inv(normal * scale) * scale if condition <= most else None, condition


def blocks(where: Bool, /) -> list[Index]:
    """Return which values lie in each square block of the array, of those blocks that have enough of them.

    The values are those of the pixels that `where`, (Y, X), names, row by row.
    """
    size = max(2, -(-min(where.shape) // BLOCKS))
    rows, columns = np.nonzero(where)
    block = (rows // size) * (where.shape[1] // size + 1) + columns // size
    order = np.argsort(block, kind="stable")
    _, starts = np.unique(block[order], return_index=True)
    return [places for places in np.split(order, starts[1:]) if places.size >= LEAST_IN_BLOCK]


def shape_rms(values: Float, where: Bool, /) -> float:
    """Return the root mean square of the blocks' medians, less what the scatter within blocks makes of them; 0 at least.

    The values, (m,), are those that `blocks` counts.
    """
    groups = [values[places] for places in blocks(where)]
    if not groups:
        return 0.0
    square = float(np.mean([np.median(group) ** 2 for group in groups]))
    chance = MEDIAN_VARIANCE * float(np.mean([np.var(group, ddof=1) / group.size for group in groups]))
    return float(np.sqrt(max(0.0, square - (1.0 + SURE * np.sqrt(2.0 / len(groups))) * chance)))
