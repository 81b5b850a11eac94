"""What the patches hand to the pixels: a linear model of the tail, and how sure it is, one plane each of (rows, columns)."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32
from cadtof_cli.quantiles import median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.condition import Conditioned, conditioned
from cadtof_cli.resolver.diffuse.leaning import Leaning
from cadtof_cli.resolver.diffuse.noise import Entry
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import MEAN, WITHIN_PATCH
from cadtof_cli.resolver.diffuse.tail import phase_data, residuals, wrapped
from cadtof_cli.resolver.diffuse.walls import over_neighbours

BESIDE_MORE = 0.3
"""By how much the light of surfaces beside the view exceeds what its continued border sends, as a share of that, where a patch
faces nothing that is known, and in proportion to that: rooms go on beyond the pieces that are continued. Two harmonics cannot
tell; with more of them the fit sees most of it itself, and what is missing falls with the square of their number."""

UNSEEN_MORE = 0.14
"""By how much the lag of unseen light exceeds what two harmonics make of it, as a share of that, at the most: where .8 of what a
patch faces is unknown, and in proportion to (that share)⁴·(what is known). What it comes from goes on from what is seen, nearer
than the start that is fitted, and two harmonics hardly tell such early light from none. Three tell it."""

MOST_EARLY = 5.0**5 / 4.0**4
"""Makes the largest o⁴·(1 − o) one."""

GUESSED_SHARE = 0.18
"""The share of the light of guessed walls that is counted with two harmonics, for the same reason: a view of one wall shows
nothing that could go on."""

SLOWER_EARLY = 3.0
"""With which power of slowness `UNSEEN_MORE` and `GUESSED_SHARE` fall: with slow modulation, the fit alone has too much light."""

LATE_START_PER_NS = (0.0, 0.012)
"""Share of the lag that is too much for every ns that a room's unseen light starts later than in most, with two harmonics and
with more: the third puts down to a late start what is a tail of another shape. Two hardly see it."""

FACING_MORE, FACING_MIDDLE = (0.0, 0.05), 0.7
"""Share of the lag that is missed where a surface is seen straight on, and is too much where it is seen at a grazing angle, per
cosine from the middle: with two harmonics, where it is not to be told among other errors, and with more."""

GUESSED_ERROR = (0.35, 0.5)
"""Standard deviation of the light of guessed walls, as a share of it: with two harmonics, and with more."""

PATCH_SHARE = (0.0, 0.1)
"""Variance that a patch leaves to all its pixels, over its posterior variance."""

SURPRISE = (2.5, 0.1)
"""How much the share of `PATCH_SHARE` grows per unit of χ². With more harmonics, each patch has its own. With two, a small misfit
says much, since so many unknowns hardly miss two data; but the errors of a frame's patches have common causes, so it says this
of all of them, and the mean over the frame counts."""

LARGEST_SURPRISE = 1.0
"""With two harmonics, the largest χ² that a patch brings into this mean: that its data are missed is known then, and by how much
they are says nothing of the lag."""

STANDING_OUT, LARGEST_LOCAL = 3.0, 20.0
"""Mean χ² of a patch and its neighbours from which they show something that the rest of the room does not, such as a net close to
its wall; and from which it counts no more, so that no patch alone makes its neighbours stand out."""

STANDING_OUT_OF_MANY = 4.0
"""Mean χ², over the median of the frame, from which patches stand out: where all patches are missed, none does."""

UNEXPECTED = 12.0
"""How much the variance of patches that stand out grows per unit of χ² beyond these limits, over their posterior variance."""

LAG_ERROR = (0.0, 0.05)
"""Standard deviation of the lag, as a share of it, that all patches have in common."""

BESIDE_ERROR = (0.0, 0.5)
"""Standard deviation of the lag by light from beside the view, as a share of it."""

SLOWER_ERROR = (0.0, 0.25)
"""With which power of slowness these errors and that of guessed walls grow, with two harmonics and with more. Chosen with 42
rooms at periods of 50 to 100 ns."""


@dataclass(frozen=True, eq=False)
class Beside:
    """How much of arg H_1, (n,), is put down to surfaces in the view, to its continued border and to unseen light, and would be
    to walls guessed beside it; the share of what a patch faces that is unknown; the cosine at which it is seen.
    """

    seen_rad: Float
    continued_rad: Float
    unseen_rad: Float
    guessed_rad: Float
    open_share: Float
    cosine: Float


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

    def less_sure(self, variance: Float32, /) -> "CoarsePlanes":
        """Return these planes with more of the variance of arg H_1 that a patch leaves to all its pixels, (rows, columns)."""
        planes = self.planes.copy()
        planes[-2] += variance
        return replace(self, planes=planes)

    def if_likely(self, probability: float, /) -> "CoarsePlanes":
        """Return what is expected where a tail is there with that probability, and else nothing is behind the direct light.

        Means and covariances of the tail go with the probability p. That the tail is there or not is the same for all pixels,
        with a variance of p·(1 − p) times the square of its lag.
        """
        if probability == 1.0:
            return self
        planes = self.planes * np.float32(probability)
        planes[-2] += np.float32(probability * (1.0 - probability)) * self.planes[self.data + 1] ** 2
        planes[-1] = self.planes[-1] / np.float32(probability)
        return replace(self, planes=planes)


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


def coarse_planes(
    fit: PatchFit, posterior: Conditioned, beside: Beside, valid: Bool, leaning: Leaning | None, /, *, slowness: float
) -> CoarsePlanes:
    """Gather what pixels need from n valid patches, (rows, columns); the others get the mean of these.

    `leaning` is what two harmonics miss in such views, None with more of them; `slowness` is that of `DiffuseSettings`.
    """
    values, count = fit.posterior.copy(), len(fit.posterior)
    entries, phases = needed_entries(count - 2), phase_data(count - 2)
    # a turn more of one patch would be a phase of another direction half the way to the next
    values[phases] = wrapped(values[phases])
    following = (count - 2) // 2
    more = min(following, 2) - 1
    lag = values[-1].copy()
    values[-1] += BESIDE_MORE * beside.open_share * beside.continued_rad / following**2
    if leaning is not None:
        early = MOST_EARLY * beside.open_share**4 * (1.0 - beside.open_share)
        missed = UNSEEN_MORE * early * beside.unseen_rad + GUESSED_SHARE * beside.guessed_rad
        values[-1] += slowness**-SLOWER_EARLY * missed
        values[-1] += leaning.share * lag
    values[-1] -= LATE_START_PER_NS[more] * (fit.room[-1] - MEAN[-1]) * lag
    values[-1] += FACING_MORE[more] * (beside.cosine - FACING_MIDDLE) * lag
    spread = np.einsum("jan,j,jbn->abn", fit.jacobian, WITHIN_PATCH[more] ** 2, fit.jacobian)
    kept = PATCH_SHARE[more] + SURPRISE[more] * _surprise(posterior, common=leaning is not None)
    left = {key: kept * value for key, value in posterior.covariance.items()}
    grown = slowness ** SLOWER_ERROR[more]
    shared = (
        grown * LAG_ERROR[more] * lag,
        grown * BESIDE_ERROR[more] * beside.continued_rad,
        grown * GUESSED_ERROR[more] * beside.guessed_rad,
        0.0 if leaning is None else leaning.left_rad,
    )
    left[1, 1] = left[1, 1] + sum(part**2 for part in shared)
    if leaning is not None:
        left[1, 1] = left[1, 1] + UNEXPECTED * _standing_out(posterior.chi_squared, valid) * posterior.covariance[1, 1]
    rows = [*values, *(spread[entry] for entry in entries), left[1, 1], _mpi_variance(values, spread, left)]
    held = np.array(rows)
    planes = np.empty((len(held), valid.size), np.float32)
    planes[:], planes[:, np.flatnonzero(valid)] = held.mean(axis=1)[:, None], held
    return CoarsePlanes(planes.reshape(-1, *valid.shape), count, entries)


def _surprise(posterior: Conditioned, *, common: bool) -> Float:
    """Return χ² of every patch, (n,), or what all have in `common`: what makes their mean of χ² times the variance of the lag."""
    if not common:
        return np.asarray(posterior.chi_squared, np.float64)
    variance = posterior.covariance[1, 1]
    mean: Float = np.mean(variance * np.minimum(posterior.chi_squared, LARGEST_SURPRISE)) / variance
    return mean


def _standing_out(chi_squared: Float, valid: Bool) -> Float:
    """Return by how much χ² of n valid patches, (rows, columns), and their neighbours is more than rooms have, (n,)."""
    local = np.zeros(valid.shape)
    local[valid] = np.minimum(chi_squared, LARGEST_LOCAL)
    total, count = over_neighbours(np.array([local, valid]))[:, valid]
    usual = max(STANDING_OUT, STANDING_OUT_OF_MANY * float(median(chi_squared)))
    more: Float = np.maximum(total / count - usual, 0.0)
    return more


def _mpi_variance(values: Float, spread: Float, left: dict[Entry, Float]) -> Float:
    """Return the variance of the phase of the MPI light A·e^if·(H_1 − 1), which is p_1·(1 − 1/H_1)."""
    lever = 1.0 / (np.exp(values[-2] + 1j * values[-1]) - 1.0)
    variance: Float = (
        lever.imag**2 * (left[0, 0] + spread[-2, -2])
        + 2.0 * lever.imag * lever.real * (left[1, 0] + spread[-1, -2])
        + lever.real**2 * (left[1, 1] + spread[-1, -1])
    )
    return variance
