"""What the patches hand to the pixels: a linear model of the tail, and how sure it is, one plane each of (rows, columns)."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.resolver.diffuse.condition import Conditioned, conditioned
from cadtof_cli.resolver.diffuse.noise import Entry
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import WITHIN_PATCH
from cadtof_cli.resolver.diffuse.tail import residuals

BESIDE_MORE = 0.22
"""By how much the light of surfaces beside the view exceeds what its continued border sends, as a share of that: rooms go on
beyond the pieces that are continued. Two harmonics cannot tell; with more of them the fit sees most of it itself, and
what is missing falls with the square of their number."""

GUESSED_SHARE = 0.15
"""The share of the light of guessed walls that is counted with two harmonics: such early light they hardly tell from none.
Three tell it."""

GUESSED_ERROR = (0.35, 0.5)
"""Standard deviation of that share: with two harmonics, and with more."""

PATCH_SHARE = (0.3, 0.1)
"""Variance that a patch leaves to all its pixels, over its posterior variance."""

SURPRISE = (6.0, 0.1)
"""How that share grows with χ² of the patch: two data are hardly missed by so many unknowns, so that a small misfit says much."""

LAG_ERROR = (0.0, 0.05)
"""Standard deviation of the lag, as a share of it, that all patches have in common."""

BESIDE_ERROR = (0.0, 0.5)
"""The same of the lag by light from beside the view, as a share of that."""


@dataclass(frozen=True, eq=False)
class Beside:
    """How much of arg H_1, (n,), is put down to the continued border of the view, and would be to walls guessed beside it."""

    continued_rad: Float
    guessed_rad: Float


@dataclass(frozen=True, eq=False)
class CoarsePlanes:
    """Planes over the patches, float32 (plane, rows, columns), in the order `names`.

    `value` planes are the means of the data and of ln|H_1|, arg H_1; `entry` planes the lower triangle of their covariance
    within a patch, as far as pixels need it; then the variance of arg H_1 that a patch leaves to all its pixels, and that of
    the MPI light's phase.
    """

    planes: Float32
    values: int
    entries: tuple[Entry, ...]

    @property
    def data(self) -> int:
        """How many of the values are data."""
        return self.values - 2


def needed_entries(data: int, /) -> tuple[Entry, ...]:
    """Return the covariances that a pixel needs: all of its data with all, of the targets with the data, and arg H_1's own."""
    among_data = [(i, j) for i in range(data) for j in range(i + 1)]
    of_targets = [(target, j) for target in (data, data + 1) for j in range(data)]
    return (*among_data, *of_targets, (data + 1, data + 1))


def patch_posterior(data: Float, error: Float, fit: PatchFit, /) -> Conditioned:
    """Return what a patch's data (data, n) say of its ln|H_1| and arg H_1; `error` as in `fitted_patches`."""
    count = len(data)
    covariance = fit.covariance + error
    size = count + 2
    lower = {(i, j): covariance[i, j] for i in range(size) for j in range(i + 1)}
    return conditioned(list(residuals(data, fit.expected[:count])), lower, targets=2)


def coarse_planes(fit: PatchFit, posterior: Conditioned, beside: Beside, valid: Bool, /) -> CoarsePlanes:
    """Gather what pixels need from n valid patches, (rows, columns); the others get the mean of these."""
    values, count = fit.posterior.copy(), len(fit.posterior)
    entries = needed_entries(count - 2)
    further = (count - 2) // 2
    lag = values[-1].copy()
    values[-1] += BESIDE_MORE * beside.continued_rad / further**2
    if further == 1:
        values[-1] += GUESSED_SHARE * beside.guessed_rad
    spread = np.einsum("jan,j,jbn->abn", fit.jacobian, WITHIN_PATCH**2, fit.jacobian)
    more = min(further, 2) - 1
    kept = PATCH_SHARE[more] + SURPRISE[more] * posterior.chi_squared
    left = {key: kept * value for key, value in posterior.covariance.items()}
    shared = (
        LAG_ERROR[more] * lag,
        BESIDE_ERROR[more] * beside.continued_rad,
        GUESSED_ERROR[more] * beside.guessed_rad,
    )
    left[1, 1] = left[1, 1] + sum(part**2 for part in shared)
    rows = [*values, *(spread[entry] for entry in entries), left[1, 1], _mpi_variance(values, spread, left)]
    held = np.array(rows)
    planes = np.empty((len(held), *valid.shape), np.float32)
    planes[:], planes[:, valid] = held.mean(axis=1)[:, None, None], held
    return CoarsePlanes(planes, count, entries)


def _mpi_variance(values: Float, spread: Float, left: dict[Entry, Float]) -> Float:
    """Return the variance of the phase of the MPI light A·e^if·(H_1 − 1), which is p_1·(1 − 1/H_1)."""
    lever = 1.0 / (np.exp(values[-2] + 1j * values[-1]) - 1.0)
    variance: Float = (
        lever.imag**2 * (left[0, 0] + spread[-2, -2])
        + 2.0 * lever.imag * lever.real * (left[1, 0] + spread[-1, -2])
        + lever.real**2 * (left[1, 1] + spread[-1, -1])
    )
    return variance
