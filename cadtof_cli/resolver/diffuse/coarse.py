"""What the patches hand to the pixels: a linear model of the tail and its uncertainty, as planes (rows, columns)."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32, median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.bias import Bias
from cadtof_cli.resolver.diffuse.condition import Conditioned, conditioned
from cadtof_cli.resolver.diffuse.noise import Entry
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import MEAN, WITHIN_PATCH
from cadtof_cli.resolver.diffuse.tail import phase_data, wrapped
from cadtof_cli.resolver.diffuse.walls import over_neighbours

BESIDE_MORE = 0.3
"""Lag that is added for light from beside the view, as a share of the lag by the continued border. The value is for a
patch that faces nothing known; it is in proportion to the unknown share of what the patch faces. Rooms go on beyond the
pieces that are continued. Two harmonics do not show this light. With more, the fit sees most of it, and what is missing
falls with the square of the number of harmonics after the first."""

UNSEEN_MORE = 0.14
"""Lag that is added for unseen light with two harmonics, as a share of its fitted lag. Let o be the unknown share of what a
patch faces. The value is the maximum, at o = .8; it is in proportion to o⁴·(1 − o). Unseen light comes from surfaces that
continue the seen ones, nearer than the fitted start. Two harmonics hardly tell such early light from none; three tell it."""

MOST_EARLY = 5.0**5 / 4.0**4
"""Scales o⁴·(1 − o) so that its maximum is 1."""

GUESSED_SHARE = 0.18
"""Share of the light of guessed walls that is added with two harmonics, for the same reason: a view of one wall shows
nothing that could go on."""

SLOWER_EARLY = 3.0
"""Power of slowness by which `UNSEEN_MORE` and `GUESSED_SHARE` are divided: with slow modulation, the fit alone has too
much light."""

LATE_START_PER_NS = (0.0, 0.012)
"""Share of the lag that is taken back for every ns by which the room's unseen light starts later than in most rooms: with
two harmonics, and with more. The third harmonic takes a tail of another shape for a late start. Two harmonics hardly see it."""

FACING_MORE, FACING_MIDDLE = (0.0, 0.05), 0.7
"""Share of the lag that is added per unit of the cosine of incidence above a middle, and taken back below it; and that
middle. The fit has too little lag for surfaces that are seen straight on, and too much at a grazing angle. First with
two harmonics, where this is not told from other errors; then with more."""

GUESSED_ERROR = (0.35, 0.5)
"""Standard deviation of the light of guessed walls, as a share of it: with two harmonics, and with more."""

PATCH_SHARE = (0.0, 0.1)
"""Share of a patch's posterior variance that all its pixels have in common, apart from χ²: with two harmonics, and with
more."""

SHARE_PER_CHI_SQUARED = (2.5, 0.1)
"""How much the share `PATCH_SHARE` grows per unit of χ²: with two harmonics, and with more. With more harmonics, each
patch has its own χ². With two, so many unknowns hardly miss two data, so a small misfit says much. But the errors of a
frame's patches have common causes, so it says this of all patches, and the mean over the frame counts."""

LARGEST_CHI_SQUARED = 1.0
"""Largest χ² that a patch brings into this mean with two harmonics. Beyond it, the data are known to be missed, and by
how much says nothing of the lag."""

USUAL_CHI_SQUARED, LARGEST_LOCAL_CHI_SQUARED = 3.0, 20.0
"""Mean χ² of a patch and its neighbours above which they show something that the rest of the room does not show, such
as a net close to its wall; and the largest χ² that counts in this mean, so that a single patch does not make its
neighbours stand out."""

USUAL_OVER_MEDIAN = 4.0
"""The same limit in units of the median χ² of the frame; the larger limit counts. If all patches are missed, none
stands out."""

VARIANCE_PER_EXCESS = 12.0
"""Variance that patches which stand out get in addition, over their posterior variance, per unit of χ² above these limits."""

LAG_ERROR = (0.0, 0.05)
"""Standard deviation of the lag that all patches have in common, as a share of the lag: with two harmonics, and with more."""

BESIDE_ERROR = (0.0, 0.5)
"""Standard deviation of the lag by light from beside the view, as a share of it: with two harmonics, and with more."""

SLOWER_ERROR = (0.0, 0.25)
"""Power of slowness with which `LAG_ERROR`, `BESIDE_ERROR` and `GUESSED_ERROR` grow: with two harmonics, and with more.
Chosen with 42 rooms at periods of 50 to 100 ns."""


MIDDLE_RAD = -0.5 * np.pi
"""Middle of the turn in which the phases of patches lie. A tail makes them negative, and strong MPI brings them near −π. If the
turn ended there, blending two such patches would give the opposite direction halfway."""


@dataclass(frozen=True, eq=False)
class LagParts:
    """Which surfaces cause how much of the lag arg H_1 of n patches, (n,) each.

    Attributes:
        seen_rad: lag by surfaces in the view.
        continued_rad: lag by the continued border of the view.
        unseen_rad: lag by unseen light.
        guessed_rad: lag that walls guessed beside the view would cause; the fit does not have them.
        open_share: unknown share of what a patch faces.
        cosine: cosine at which a patch is seen.
    """

    seen_rad: Float
    continued_rad: Float
    unseen_rad: Float
    guessed_rad: Float
    open_share: Float
    cosine: Float


@dataclass(frozen=True, eq=False)
class CoarsePlanes:
    """Planes over the patches, float32 (plane, rows, columns).

    The first `data` planes are the means of the data; those of ln|H_1| and of arg H_1 follow. Then come the planes of
    `entries`: the lower triangle of their covariance within a patch, as far as pixels need it. The last two are the
    variance of arg H_1 that a patch leaves to all its pixels, and the variance of the phase of the MPI light.
    """

    planes: Float32
    data: int
    entries: tuple[Entry, ...]

    def with_added_variance(self, variance: Float32, /) -> "CoarsePlanes":
        """Return the planes with `variance`, (rows, columns), added to the variance of arg H_1 that a patch's pixels share."""
        planes = self.planes.copy()
        planes[-2] += variance
        return replace(self, planes=planes)

    def weighted_by(self, probability: float, /) -> "CoarsePlanes":
        """Return the planes for a tail that is there with this probability p; otherwise there is direct light alone.

        Means and covariances of the tail are multiplied by p. Whether the tail is there is the same for all pixels.
        This adds the variance p·(1 − p) times the square of the lag.
        """
        planes = self.planes * np.float32(probability)
        planes[-2] += np.float32(probability * (1.0 - probability)) * self.planes[self.data + 1] ** 2
        planes[-1] = self.planes[-1] / np.float32(probability)
        return replace(self, planes=planes)


def needed_entries(data: int, /) -> tuple[Entry, ...]:
    """Return the covariances that a pixel needs: of its data, of the targets with the data, and the variance of arg H_1."""
    among_data = [(i, j) for i in range(data) for j in range(i + 1)]
    of_targets = [(target, j) for target in (data, data + 1) for j in range(data)]
    return (*among_data, *of_targets, (data + 1, data + 1))


def patch_posterior(data: Float, error: Float, fit: PatchFit, /) -> Conditioned:
    """Return what a patch's data (data, n) say of its ln|H_1| and arg H_1; `error` as in `fitted_patches`."""
    count = len(data)
    covariance = fit.covariance + error
    size = count + 2
    lower = {(i, j): covariance[i, j] for i in range(size) for j in range(i + 1)}
    return conditioned(list(data - fit.expected[:count]), lower)


def coarse_planes(
    fit: PatchFit, posterior: Conditioned, lags: LagParts, valid: Bool, bias: Bias | None, /, *, slowness: float
) -> CoarsePlanes:
    """Return what pixels need from n valid patches, (rows, columns); all other patches get the mean of these.

    `bias` is what two harmonics miss in such views; None with more harmonics. `slowness` is that of `DiffuseSettings`.
    """
    values, count = fit.posterior.copy(), len(fit.posterior) - 2
    entries, phases = needed_entries(count), phase_data(count)
    # without this, blending two patches whose phases differ by a turn would give the opposite direction halfway
    values[phases] = wrapped(values[phases], MIDDLE_RAD)
    following = count // 2
    with_more = min(following, 2) - 1
    lag = values[-1].copy()
    values[-1] += BESIDE_MORE * lags.open_share * lags.continued_rad / following**2
    if bias is not None:
        early = MOST_EARLY * lags.open_share**4 * (1.0 - lags.open_share)
        missing = UNSEEN_MORE * early * lags.unseen_rad + GUESSED_SHARE * lags.guessed_rad
        values[-1] += slowness**-SLOWER_EARLY * missing
        values[-1] += bias.share * lag
    values[-1] -= LATE_START_PER_NS[with_more] * (fit.room[-1] - MEAN[-1]) * lag
    values[-1] += FACING_MORE[with_more] * (lags.cosine - FACING_MIDDLE) * lag
    spread = np.einsum("jan,j,jbn->abn", fit.jacobian, WITHIN_PATCH[with_more] ** 2, fit.jacobian)
    counted = _counted_chi_squared(posterior, common=bias is not None)
    common_share = PATCH_SHARE[with_more] + SHARE_PER_CHI_SQUARED[with_more] * counted
    common = {key: common_share * value for key, value in posterior.covariance.items()}
    growth = slowness ** SLOWER_ERROR[with_more]
    errors_rad = (
        growth * LAG_ERROR[with_more] * lag,
        growth * BESIDE_ERROR[with_more] * lags.continued_rad,
        growth * GUESSED_ERROR[with_more] * lags.guessed_rad,
        0.0 if bias is None else bias.sigma_rad,
    )
    common[1, 1] = common[1, 1] + sum(part**2 for part in errors_rad)
    if bias is not None:
        excess = _excess_chi_squared(posterior.chi_squared, valid)
        common[1, 1] = common[1, 1] + VARIANCE_PER_EXCESS * excess * posterior.covariance[1, 1]
    mpi_variance = _mpi_variance(values, spread, common)
    rows = np.array([*values, *(spread[entry] for entry in entries), common[1, 1], mpi_variance])
    planes = np.empty((len(rows), valid.size), np.float32)
    planes[:], planes[:, np.flatnonzero(valid)] = rows.mean(axis=1)[:, None], rows
    return CoarsePlanes(planes.reshape(-1, *valid.shape), count, entries)


def _counted_chi_squared(posterior: Conditioned, *, common: bool) -> Float:
    """Return the χ² that counts for every patch, (n,).

    With `common`, it is such that χ² times the variance of the lag is the same for all patches: the mean over the frame.
    """
    if not common:
        return np.asarray(posterior.chi_squared, np.float64)
    variance = posterior.covariance[1, 1]
    mean: Float = np.mean(variance * np.minimum(posterior.chi_squared, LARGEST_CHI_SQUARED)) / variance
    return mean


def _excess_chi_squared(chi_squared: Float, valid: Bool) -> Float:
    """Return by how much the mean χ² of n valid patches, (rows, columns), and their neighbours exceeds that of rooms, (n,)."""
    local = np.zeros(valid.shape)
    local[valid] = np.minimum(chi_squared, LARGEST_LOCAL_CHI_SQUARED)
    total, count = over_neighbours(np.array([local, valid]))[:, valid]
    usual = max(USUAL_CHI_SQUARED, USUAL_OVER_MEDIAN * float(median(chi_squared)))
    more: Float = np.maximum(total / count - usual, 0.0)
    return more


def _mpi_variance(values: Float, spread: Float, common: dict[Entry, Float]) -> Float:
    """Return the variance of the phase of the MPI light A·e^if·(H_1 − 1), which is p_1·(1 − 1/H_1)."""
    lever = 1.0 / (np.exp(values[-2] + 1j * values[-1]) - 1.0)
    variance: Float = (
        lever.imag**2 * (common[0, 0] + spread[-2, -2])
        + 2.0 * lever.imag * lever.real * (common[1, 0] + spread[-1, -2])
        + lever.real**2 * (common[1, 1] + spread[-1, -1])
    )
    return variance
