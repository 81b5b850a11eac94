"""What the patches hand to the pixels: a linear model of the tail, and how sure it is, one plane each of (rows, columns)."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.resolver.diffuse.condition import Conditioned, conditioned
from cadtof_cli.resolver.diffuse.noise import Entry
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import WITHIN_PATCH
from cadtof_cli.resolver.diffuse.tail import residuals

OTHER_FIT = 0.28
"""Share of the difference between two exact fits of a patch's data, tail and two paths, that counts as the model's error; it
falls with the square of the number of further harmonics, which tell the two apart."""

LAG_SHARE = 0.1
"""Share of the tail's own lag that counts as the model's error: surfaces are not flat patches, nor matt, nor all in view."""

PATCH_SHARE = 0.5
"""Share of a patch's posterior variance that its pixels keep: the rest is already in their own."""


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


def patch_posterior(data: Float, noise: Float, fit: PatchFit, /) -> Conditioned:
    """Return what a patch's data (data, n) say of its ln|H_1| and arg H_1; noise (data, data, n)."""
    count = len(data)
    covariance = fit.covariance.copy()
    covariance[:count, :count] += noise
    size = count + 2
    lower = {(i, j): covariance[i, j] for i in range(size) for j in range(i + 1)}
    return conditioned(list(residuals(data, fit.expected[:count])), lower, targets=2)


def other_fit(gap_rad: Float, further: int, /) -> Float:
    """Return the model's error, rad (n,), from how far the tail's arg H_1 lies from that of two paths.

    `further` is how many harmonics there are besides the fundamental.
    """
    return OTHER_FIT / further**2 * gap_rad


def coarse_planes(fit: PatchFit, posterior: Conditioned, model_error_rad: Float, valid: Bool, /) -> CoarsePlanes:
    """Gather what pixels need from n valid patches, (rows, columns); the others get the mean of these.

    `model_error_rad`, (n,), is how much arg H_1 may be off besides what the fit says. Data that surprised (χ²) make it less sure.
    """
    values = len(fit.posterior)
    entries = needed_entries(values - 2)
    spread = np.einsum("jan,j,jbn->abn", fit.jacobian, WITHIN_PATCH**2, fit.jacobian)
    kept = PATCH_SHARE + posterior.chi_squared
    model = model_error_rad**2 + (LAG_SHARE * fit.posterior[-1]) ** 2
    left = {key: kept * value for key, value in posterior.covariance.items()}
    left[1, 1] = left[1, 1] + model
    rows = [
        *fit.posterior,
        *(spread[entry] for entry in entries),
        left[1, 1],
        _mpi_variance(fit.posterior, spread, left),
    ]
    planes = np.empty((len(rows), *valid.shape), np.float32)
    for plane, row in zip(planes, rows, strict=True):
        plane[valid], plane[~valid] = row, row.mean()
    return CoarsePlanes(planes, values, entries)


def _mpi_variance(values: Float, spread: Float, left: dict[Entry, Float]) -> Float:
    """Return the variance of the phase of the MPI light A·e^if·(H_1 − 1), which is p_1·(1 − 1/H_1)."""
    lever = 1.0 / (np.exp(values[-2] + 1j * values[-1]) - 1.0)
    variance: Float = (
        lever.imag**2 * (left[0, 0] + spread[-2, -2])
        + 2.0 * lever.imag * lever.real * (left[1, 0] + spread[-1, -2])
        + lever.real**2 * (left[1, 1] + spread[-1, -1])
    )
    return variance
