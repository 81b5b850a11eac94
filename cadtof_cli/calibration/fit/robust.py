"""Least squares in which outliers have no weight: Gauss–Newton with Tukey's biweight."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.noise import MAD_PER_SIGMA

BIWEIGHT_LIMIT = 4.685
"""Residual over scale from which on an observation has no weight; 95 % as efficient as least squares on Gaussian noise."""

BIWEIGHT_EFFICIENCY = 0.95

MOST_STEPS = 60

CONVERGED = 1e-4
"""Largest change in standard errors at which the fit ends."""


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


def _weighted(residual: Float) -> tuple[float, Float]:
    """Return the robust standard deviation of residuals, and their weights by it."""
    scale = max(float(np.median(np.abs(residual))) / MAD_PER_SIGMA, float(np.finfo(np.float64).eps))
    share = np.minimum((residual / scale / BIWEIGHT_LIMIT) ** 2, 1.0)
    return scale, np.asarray((1.0 - share) ** 2)


def _inverse(normal: Float) -> tuple[Float, float]:
    """Return what `scaled_inverse` does of a normal matrix that determines the parameters."""
    if not (np.diag(normal) > 0.0).all():
        raise SettingsError("the observations do not determine all parameters: a wall or distance has no usable pixels")
    inverse, condition = scaled_inverse(normal, most=1e13)
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
