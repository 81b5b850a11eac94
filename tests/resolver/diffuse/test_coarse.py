"""The planes that patches hand to their pixels: means, covariances within a patch, variances common to its pixels."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.diffuse.bias import Bias
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes, LagParts, coarse_planes, needed_entries, patch_posterior
from cadtof_cli.resolver.diffuse.condition import Conditioned
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.prior import WITHIN_PATCH
from tests.support.diffuse_frames import F

DATA, PATCHES = 3, 4
VALID = np.array([[True, True, False], [True, False, True]])


def fit(seed: int = 1, *, targets: tuple[float, float] = (0.3, -0.4), data: int = DATA) -> PatchFit:
    rng = np.random.default_rng(seed)
    count = data + 2
    jacobian = 0.1 * rng.normal(size=(6, count, PATCHES))
    covariance = 0.02 * np.einsum("jan,jbn->abn", jacobian, jacobian) + 1e-3 * np.eye(count)[..., None]
    expected = rng.normal(size=(count, PATCHES))
    expected[data // 2 : data] = -np.abs(expected[data // 2 : data])
    expected[-2], expected[-1] = targets
    room, state = np.zeros(6), np.zeros((6, PATCHES))
    return PatchFit(room, state, expected, expected.copy(), covariance, jacobian)


def error_of(variance: float, data: int = DATA) -> F:
    """Return the covariance of independent errors of the data, all with this variance; the targets have no errors."""
    error = np.zeros((data + 2, data + 2, PATCHES))
    error[range(data), range(data)] = variance
    return error


STRAIGHT = Bias(0.0, 0.0)
"""No share of the lag is missed, and no standard deviation is added."""


def kept_share(posterior: Conditioned) -> F:
    """Return the variance that patches leave to their pixels with two harmonics, over their posterior variance."""
    variance = posterior.covariance[1, 1]
    share: F = 2.5 * float(np.mean(variance * np.minimum(posterior.chi_squared, 1.0))) / variance
    return share


def lags(*lags_rad: float, open_share: float = 0.5, cosine: float = 0.7) -> LagParts:
    """Return lags by light that the view does not show: by its continued border, unseen light, and guessed walls."""
    lags = (0.0, *lags_rad, *[0.0] * (3 - len(lags_rad)))
    return LagParts(*(np.full(PATCHES, value) for value in (*lags, open_share, cosine)))


def planes(known: PatchFit, light: LagParts, bias: Bias = STRAIGHT, *, slowness: float = 1.0) -> CoarsePlanes:
    data = known.expected[:-2] + 0.01
    posterior = patch_posterior(data, error_of(1e-3, len(data)), known)
    return coarse_planes(known, posterior, light, VALID, bias if len(data) < 4 else None, slowness=slowness)


def test_valid_patches_keep_their_values_and_the_others_get_the_mean() -> None:
    known = fit()
    found = planes(known, lags())
    assert found.data == DATA
    for plane, expected in zip(found.planes, known.expected, strict=False):
        assert_allclose(plane[VALID], expected, rtol=1e-6)
        assert_allclose(plane[~VALID], expected.mean(), rtol=1e-6)


def test_phases_that_differ_by_full_turns_give_the_same_planes() -> None:
    """Pixels between two patches get a phase between those of the patches, so these must not differ by turns."""
    known = fit(data=4)
    turned = known.posterior.copy()
    turned[2, 1] += 2.0 * np.pi
    turned[3, 2] -= 4.0 * np.pi
    turned_planes, planes_before = (planes(one, lags()).planes for one in (replace(known, posterior=turned), known))
    assert_allclose(turned_planes, planes_before, atol=1e-6)


@pytest.mark.parametrize("turn", [-1, 0, 1])
def test_phases_of_neighbours_with_strong_mpi_lie_side_by_side_beyond_half_a_turn(turn: int) -> None:
    """Pixels between patches of -3 and -3.3 rad got phases around 0, and depths that were up to 2 m off."""
    known = fit(data=4)
    known.posterior[2:4] = -3.0
    known.posterior[3, 2] = -3.3 + turn * 2.0 * np.pi
    phases = planes(known, lags()).planes[3][VALID]
    assert_allclose(phases, [-3.0, -3.0, -3.3, -3.0], rtol=1e-6)


def test_a_pixel_needs_the_covariances_of_its_data_and_of_the_targets_with_them() -> None:
    assert needed_entries(2) == ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (3, 3))


def test_patches_leave_the_mean_of_their_posterior_variances_times_chi_squared() -> None:
    """It is 2.5 times the mean, over the patches, of the posterior variance times χ².

    The posterior is computed here by conditioning a Gaussian with numpy.
    """
    known = fit()
    left = []
    for patch in range(PATCHES):
        whole = known.covariance[:, :, patch]
        among = whole[:DATA, :DATA] + 1e-3 * np.eye(DATA)
        between = whole[DATA:, :DATA]
        residual = np.full(DATA, 0.01)
        chi_squared = float(residual @ np.linalg.solve(among, residual))
        left.append(chi_squared * (whole[DATA:, DATA:] - between @ np.linalg.solve(among, between.T))[1, 1])
    assert_allclose(planes(known, lags()).planes[-2][VALID], 2.5 * np.mean(left), rtol=1e-4)


def test_planes_are_weighted_by_the_probability_of_a_tail() -> None:
    """Mean and variance are those of draws in which one half has the tail and the other half has no lag."""
    certain = planes(fit(), lags())
    assert certain.weighted_by(1.0).planes.tobytes() == certain.planes.tobytes()
    halved = certain.weighted_by(0.5)
    lag, left = (certain.planes[row][0, 0] for row in (DATA + 1, -2))
    rng = np.random.default_rng(5)
    drawn = np.where(rng.random(400_000) < 0.5, lag + np.sqrt(left) * rng.standard_normal(400_000), 0.0)
    assert_allclose(halved.planes[DATA + 1][0, 0], drawn.mean(), rtol=0.02)
    assert_allclose(halved.planes[-2][0, 0], drawn.var(), rtol=0.02)
    assert_allclose(halved.planes[:-2], 0.5 * certain.planes[:-2], rtol=1e-6)


def test_a_chi_squared_above_one_counts_as_one() -> None:
    known = fit()
    variances = []
    for difference in (0.15, 0.3):
        posterior = patch_posterior(known.expected[:DATA] + difference, error_of(1e-3), known)
        assert (posterior.chi_squared > 1.0).all()
        variances.append(coarse_planes(known, posterior, lags(), VALID, STRAIGHT, slowness=1.0).planes[-2][VALID])
    assert_allclose(variances[0], 2.5 * np.mean(posterior.covariance[1, 1]), rtol=1e-5)
    assert_allclose(variances[1], variances[0], rtol=1e-6)


def kept_variance(chi_squared: F, bias: Bias | None = STRAIGHT) -> F:
    """Return the variance that patches with this χ², (rows, columns), leave to their pixels, over the posterior variance."""
    count, data = chi_squared.size, 2 if bias else 4
    values = np.full((data + 2, count), -0.1)
    square = (data + 2, data + 2, count)
    known = PatchFit(
        np.zeros(6),
        np.zeros((6, count)),
        values,
        values,
        np.zeros(square),
        np.zeros((6, *square[1:])),
    )
    zero = np.zeros(count)
    nothing = LagParts(zero, zero, zero, zero, zero + 0.5, zero + 0.7)
    left = {(i, j): np.full(count, 0.01 if i == j else 0.0) for i in range(2) for j in range(i + 1)}
    posterior = Conditioned((np.zeros(count), np.zeros(count)), left, chi_squared.ravel())
    every = np.ones(chi_squared.shape, np.bool_)
    return np.asarray(coarse_planes(known, posterior, nothing, every, bias, slowness=1.0).planes[-2] / 0.01, np.float64)


def test_neighbouring_patches_with_a_much_larger_chi_squared_get_more_variance() -> None:
    """The added variance is twelve times the excess of their mean χ² over three."""
    chi_squared = np.full((7, 8), 0.5)
    usual = kept_variance(chi_squared)
    chi_squared[2:5, 2:5] = 10.0
    found = kept_variance(chi_squared)
    elsewhere = found[0, 7]
    assert_allclose(elsewhere, 2.5 * (9 * 1.0 + 47 * 0.5) / 56, rtol=1e-5)
    assert_allclose(found[3, 3] - elsewhere, 12.0 * 7.0, rtol=1e-5)
    assert_allclose(found[2, 2] - elsewhere, 12.0 * ((4 * 10.0 + 5 * 0.5) / 9 - 3.0), rtol=1e-5)
    assert_allclose(usual, 2.5 * 0.5, rtol=1e-5)


def test_a_single_patch_with_a_large_chi_squared_adds_no_variance() -> None:
    chi_squared = np.full((7, 8), 0.5)
    chi_squared[3, 3] = 1e6
    found = kept_variance(chi_squared)
    assert_allclose(found, found[0, 0], rtol=1e-6)


def test_if_all_patches_have_a_large_chi_squared_none_gets_more_variance() -> None:
    chi_squared = np.full((7, 8), 4.0)
    chi_squared[2:5, 2:5] = 15.0
    found = kept_variance(chi_squared)
    assert_allclose(found, found[0, 0], rtol=1e-6)


def test_with_three_harmonics_every_patch_has_its_own_chi_squared() -> None:
    chi_squared = np.full((7, 8), 0.5)
    chi_squared[2:5, 2:5] = 10.0
    found = kept_variance(chi_squared, None)
    assert_allclose(found[3, 3] - found[0, 0], 0.1 * 9.5, rtol=1e-4)


def test_the_missed_share_is_added_in_proportion_to_the_lag() -> None:
    known = fit()
    without, found = planes(known, lags()), planes(known, lags(), Bias(0.07, 0.02))
    difference = found.planes[: DATA + 2] - without.planes[: DATA + 2]
    assert_allclose(difference[: DATA + 1], 0.0, atol=1e-7)
    assert_allclose(difference[-1], -0.4 * 0.07, rtol=1e-4)
    assert_allclose(found.planes[-2] - without.planes[-2], 0.02**2, rtol=1e-3)


@pytest.mark.parametrize(
    ("data", "light", "added_lag", "variance"),
    [
        (DATA, lags(0.2), 1.0, 1.0),
        (DATA, lags(0.0, 0.2, open_share=0.8), 2.0**-3, 1.0),
        (DATA, lags(0.0, 0.0, 0.1), 2.0**-3, 1.0),
        (4, lags(0.2), 1.0, np.sqrt(2.0)),
        (4, lags(0.0, 0.0, 0.1), 1.0, np.sqrt(2.0)),
    ],
)
def test_with_slow_modulation_less_lag_is_added_and_more_harmonics_get_more_variance(
    data: int, light: LagParts, added_lag: float, variance: float
) -> None:
    """`added_lag` and `variance` are the lag and the variance at twice the period, over those at the usual period."""
    known = fit(data=data, targets=(0.3, -1e-6))
    nothing, usual, slow = (
        planes(known, one, slowness=slowness) for one, slowness in ((lags(), 2.0), (light, 1.0), (light, 2.0))
    )
    added = [(found.planes[data + 1] - nothing.planes[data + 1])[VALID] for found in (usual, slow)]
    assert_allclose(added[1], added_lag * added[0], rtol=1e-3, atol=1e-6)
    variances = [(found.planes[-2] - nothing.planes[-2])[VALID] for found in (usual, slow)]
    assert_allclose(variances[1], variance * variances[0], rtol=1e-3, atol=1e-9)


def test_with_slow_modulation_the_common_error_of_the_lag_grows_only_with_three_harmonics() -> None:
    """If the period is twice as long, its variance is √2 times as large."""
    for data, further in ((DATA, 0.0), (4, (np.sqrt(2.0) - 1.0) * (0.05 * 1.2) ** 2)):
        known = fit(data=data, targets=(0.3, 1.2))
        usual, slow = (planes(known, lags(), slowness=slowness) for slowness in (1.0, 2.0))
        assert_allclose((slow.planes[-2] - usual.planes[-2])[VALID], further, rtol=0.1, atol=1e-7)


@pytest.mark.parametrize(
    ("light", "added_lag", "sigma"),
    [
        (lags(0.2), 0.3 * 0.5 * 0.2, 0.0),
        (lags(0.2, open_share=0.0), 0.0, 0.0),
        (lags(0.0, 0.2, open_share=0.8), 0.14 * 0.2, 0.0),
        (lags(0.0, 0.2, open_share=0.6), 0.14 * (0.75**4 * 2.0) * 0.2, 0.0),
        (lags(0.0, 0.2, open_share=1.0), 0.0, 0.0),
        (lags(0.0, 0.0, 0.1), 0.18 * 0.1, 0.35 * 0.1),
    ],
)
def test_with_two_harmonics_light_that_the_view_does_not_show_adds_lag(
    light: LagParts, added_lag: float, sigma: float
) -> None:
    """Three lags are added to arg H_1.

    One is .3 of the lag by the continued border, in proportion to the unknown share of what a patch faces. One is at
    most .14 of the lag by unseen light, if .8 of what a patch faces is unknown. One is .18 of the lag that guessed
    walls would cause, with a standard deviation of .35 of it.
    """
    known = fit()
    without, found = planes(known, lags()), planes(known, light)
    difference = found.planes[: DATA + 2] - without.planes[: DATA + 2]
    assert_allclose(difference[: DATA + 1], 0.0, atol=1e-7)
    assert_allclose(difference[-1], added_lag, rtol=1e-4, atol=1e-7)
    assert_allclose(found.planes[-2] - without.planes[-2], sigma**2, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(("further", "of_room"), [(1, 1.1), (2, 0.8), (3, 0.8)])
def test_the_variance_within_a_patch_is_smaller_with_more_harmonics(further: int, of_room: float) -> None:
    """The standard deviation of arg H_1 within a patch is a share `of_room` of that between the patches of a room."""
    known = fit(data=2 * further)
    found = planes(known, lags())
    spread = of_room * np.array([0.15, 0.42, 0.35, 1.2, 0.42, 1.75])
    expected = ((spread[:, None] * known.jacobian[:, -1]) ** 2).sum(axis=0)
    place = found.data + 2 + found.entries.index((2 * further + 1, 2 * further + 1))
    assert_allclose(found.planes[place][VALID], expected, rtol=1e-5)


@pytest.mark.parametrize(("further", "share"), [(1, 0.0), (2, 0.05), (3, 0.05)])
def test_with_three_harmonics_lag_is_added_straight_on_and_taken_back_at_grazing_angles(
    further: int, share: float
) -> None:
    known = replace(fit(data=2 * further), room=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 4.4]))
    for cosine in (0.2, 0.7, 1.0):
        lag = planes(known, lags(cosine=cosine)).planes[2 * further + 1][VALID]
        assert_allclose(lag, -0.4 * (1.0 + share * (cosine - 0.7)), rtol=1e-5)


@pytest.mark.parametrize(("further", "per_ns"), [(1, 0.0), (2, 0.012)])
def test_with_three_harmonics_a_late_start_of_unseen_light_reduces_the_lag(further: int, per_ns: float) -> None:
    known = fit(data=2 * further)
    late = replace(known, room=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 4.4 + 2.0]))
    usual = replace(known, room=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 4.4]))
    found = []
    for one in (usual, late):
        posterior = patch_posterior(one.expected[:-2], error_of(1e-3, 2 * further), one)
        found.append(
            coarse_planes(one, posterior, lags(), VALID, STRAIGHT if further == 1 else None, slowness=1.0).planes[
                2 * further + 1
            ][VALID]
        )
    assert_allclose(found[0], -0.4, rtol=1e-6)
    assert_allclose(found[1], -0.4 * (1.0 - 2.0 * per_ns), rtol=1e-5)


@pytest.mark.parametrize("further", [2, 3])
def test_with_more_harmonics_light_from_beside_the_view_adds_less_lag(further: int) -> None:
    """The lag added for the continued border falls with the square of their number, and guessed walls add no lag.

    The standard deviation is half of either lag.
    """
    known = fit(data=2 * further)
    without = planes(known, lags())
    for light, added_lag, sigma in (
        (lags(0.2), 0.3 * 0.5 * 0.2 / further**2, 0.1),
        (lags(0.0, 0.2), 0.0, 0.0),
        (lags(0.0, 0.0, 0.3), 0.0, 0.15),
    ):
        found = planes(known, light)
        assert_allclose(found.planes[-2] - without.planes[-2], sigma**2, rtol=1e-3, atol=1e-9)
        difference = found.planes[: 2 * further + 2] - without.planes[: 2 * further + 2]
        assert_allclose(difference[:-1], 0.0, atol=1e-7)
        assert_allclose(difference[-1], added_lag, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("further", [2, 3])
def test_with_more_harmonics_a_patch_leaves_a_tenth_of_its_variance_and_a_twentieth_of_the_lag(further: int) -> None:
    """A patch leaves a tenth of its posterior variance, and another tenth for each unit of χ².

    The error that all patches share has a standard deviation of a twentieth of the lag.
    """
    known = fit(data=2 * further)
    found, data = planes(known, lags()), 2 * further
    posterior = patch_posterior(known.expected[:data] + 0.01, error_of(1e-3, data), known)
    expected = (0.1 + 0.1 * posterior.chi_squared) * posterior.covariance[1, 1] + (0.05 * known.posterior[-1]) ** 2
    assert_allclose(found.planes[-2][VALID], expected, rtol=1e-4)
    assert found.data == data


@pytest.mark.parametrize("targets", [(0.3, -0.4), (0.05, -0.2), (1.0, 0.5)])
def test_the_variance_of_the_mpi_phase_is_that_of_draws(targets: tuple[float, float]) -> None:
    """MPI light is p_1·(1 − 1/H_1). Its phase is drawn here with ln|H_1| and arg H_1 from their covariances.

    These are the covariance that a patch leaves to its pixels and the covariance within a patch.
    """
    known = fit(targets=targets)
    small = PatchFit(
        known.room,
        known.state,
        known.expected,
        known.posterior,
        1e-6 * known.covariance,
        1e-3 * known.jacobian,
    )
    data = small.expected[:DATA] + 1e-5
    posterior = patch_posterior(data, error_of(1e-9), small)
    found = coarse_planes(small, posterior, lags(), VALID, STRAIGHT, slowness=1.0)
    spread = np.einsum("jan,j,jbn->abn", small.jacobian, WITHIN_PATCH[0] ** 2, small.jacobian)[-2:, -2:]
    rng = np.random.default_rng(4)
    for patch in range(PATCHES):
        left = kept_share(posterior)[patch] * np.array(
            [[posterior.covariance[max(i, j), min(i, j)][patch] for j in range(2)] for i in range(2)]
        )
        drawn = rng.multivariate_normal(targets, left + spread[..., patch], size=40_000)
        phase = np.angle(1.0 - np.exp(-drawn[:, 0] - 1j * drawn[:, 1]))
        assert found.planes[-1][VALID][patch] == pytest.approx(phase.var(), rel=0.05)
