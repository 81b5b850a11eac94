"""Robust least squares, in which outliers have no weight, on curves whose truth is known."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.calibration.fit.robust import RobustFit, robust_fit
from cadtof_cli.errors import SettingsError

F = NDArray[np.float64]

X = np.linspace(-1.0, 1.0, 400)
TRUTH = np.array([0.7, -1.3, 0.4])
COLUMNS: F = np.stack([np.ones_like(X), X, X**2], axis=1)
SIGMA = 0.05


def observed(seed: int) -> F:
    noisy: F = COLUMNS @ TRUTH + np.random.default_rng(seed).normal(0.0, SIGMA, X.size)
    return noisy


def parabola(y: F, sigma: float = SIGMA) -> Callable[[F], tuple[F, F]]:
    return lambda parameters: ((y - COLUMNS @ parameters) / sigma, COLUMNS / sigma)


def fitted(y: F, sigma: float = SIGMA) -> RobustFit:
    return robust_fit(parabola(y, sigma), np.zeros(3))


def test_on_gaussian_noise_the_fit_is_nearly_as_efficient_as_least_squares() -> None:
    runs = [observed(seed) for seed in range(200)]
    robust = np.array([fitted(y).parameters for y in runs]) - TRUTH
    plain = np.array([np.linalg.lstsq(COLUMNS, y, rcond=None)[0] for y in runs]) - TRUTH
    efficiency = (plain.var(axis=0) / robust.var(axis=0)).mean()
    assert efficiency == pytest.approx(0.95, abs=0.05)
    # the predicted variance is the observed one
    predicted = np.mean([np.diag(fitted(y).covariance) for y in runs[:20]], axis=0)
    np.testing.assert_allclose(robust.var(axis=0), predicted, rtol=0.3)


def test_the_covariance_is_that_of_least_squares_over_the_efficiency() -> None:
    fit = fitted(observed(1))
    expected = np.linalg.inv(COLUMNS.T @ COLUMNS) * SIGMA**2 / 0.95
    np.testing.assert_allclose(fit.covariance / fit.scale**2, expected, rtol=0.01, atol=1e-12)
    assert fit.scale == pytest.approx(1.0, abs=0.15)
    assert fit.residual == pytest.approx((observed(1) - COLUMNS @ fit.parameters) / SIGMA)


def test_noise_that_is_larger_than_stated_increases_scale_and_standard_errors() -> None:
    right, wrong = fitted(observed(1)), fitted(observed(1), SIGMA / 3)
    assert wrong.scale == pytest.approx(3 * right.scale, rel=1e-6)
    np.testing.assert_allclose(wrong.parameters, right.parameters, atol=1e-3)
    np.testing.assert_allclose(wrong.covariance, right.covariance, rtol=0.02, atol=1e-12)


def test_a_third_of_wild_observations_gets_no_weight() -> None:
    y = observed(2)
    wild = np.random.default_rng(3).permutation(X.size)[:130]
    y[wild] += 5.0
    fit = fitted(y)
    assert (fit.weights[wild] == 0.0).all()
    assert (np.delete(fit.weights, wild) > 0.0).mean() > 0.99
    assert (np.abs(fit.parameters - TRUTH) < 4 * np.sqrt(np.diag(fit.covariance))).all()
    # the weights of the kept observations are Tukey's biweight
    kept = fit.weights > 0.0
    ratio = fit.residual[kept] / fit.scale / 4.685
    np.testing.assert_allclose(fit.weights[kept], (1 - ratio**2) ** 2, rtol=1e-9)


def test_exact_observations_are_fitted_exactly() -> None:
    fit = fitted(COLUMNS @ TRUTH)
    np.testing.assert_allclose(fit.parameters, TRUTH, atol=1e-12)


def test_a_curve_that_is_not_linear_in_its_parameters_is_fitted() -> None:
    y = 2.0 * np.exp(-0.8 * X)

    def model(parameters: F) -> tuple[F, F]:
        a, b = parameters
        wave = np.exp(-b * X)
        return (y - a * wave) / SIGMA, np.stack([wave, -a * X * wave], axis=1) / SIGMA

    np.testing.assert_allclose(robust_fit(model, np.array([1.0, 0.1])).parameters, [2.0, 0.8], atol=1e-9)


def test_the_condition_is_that_of_columns_scaled_to_one_length() -> None:
    fit = fitted(observed(1))
    columns = COLUMNS / np.linalg.norm(COLUMNS, axis=0)
    assert fit.condition == pytest.approx(np.linalg.cond(columns.T @ columns), rel=0.02)


def test_parameters_that_observations_do_not_determine_are_refused() -> None:
    y = observed(1)
    undetermined: F = np.stack([np.ones_like(X), np.zeros_like(X)], axis=1)
    with pytest.raises(SettingsError, match="a wall or distance has no usable pixels"):
        robust_fit(lambda p: (y - undetermined @ p, undetermined), np.zeros(2))
    twice: F = np.stack([X, 2.0 * X], axis=1)
    with pytest.raises(SettingsError, match=r"do not determine all parameters \(condition"):
        robust_fit(lambda p: (y - twice @ p, twice), np.zeros(2))


def test_weights_and_scale_are_tukey_s_biweight_of_the_residuals() -> None:
    """The scale is the median of the absolute residuals over .6745. From 4.685 scales on, the weight is 0."""
    y = observed(3)
    y[::7] += np.linspace(-1.0, 1.0, y[::7].size)
    fit = fitted(y)
    assert fit.scale == pytest.approx(np.median(np.abs(fit.residual)) / 0.6744897501960817)
    share = np.abs(fit.residual) / (4.685 * fit.scale)
    np.testing.assert_allclose(fit.weights, np.where(share < 1.0, (1.0 - share**2) ** 2, 0.0), atol=1e-12)
    assert 0 < (fit.weights == 0.0).sum() < 60
    kept = COLUMNS[fit.weights > 0.0] / SIGMA
    np.testing.assert_allclose(
        fit.covariance, np.linalg.inv(kept.T @ kept) * fit.scale**2 / 0.95, rtol=1e-8, atol=1e-15
    )
    root = 1.0 / np.sqrt(np.diag(kept.T @ kept))
    assert fit.condition == pytest.approx(np.linalg.cond(kept.T @ kept * np.outer(root, root)))


def test_the_fit_ends_where_the_weighted_residuals_balance() -> None:
    """The end is within a thousandth of the standard errors, from any start."""
    y = observed(4)
    y[100:160] += 0.6
    near, far = (robust_fit(parabola(y), start) for start in (np.array([0.7, -1.3, 0.4]), np.array([0.9, -1.0, 0.1])))
    errors = np.sqrt(np.diag(near.covariance))
    assert (np.abs(near.parameters - far.parameters) < 1e-3 * errors).all()
    slope = np.linalg.solve(
        COLUMNS.T @ (near.weights[:, np.newaxis] * COLUMNS), COLUMNS.T @ (near.weights * near.residual)
    )
    assert (np.abs(slope * SIGMA) < 1e-3 * errors).all()


@pytest.mark.parametrize("unit", [1e-5, 1e6])
def test_the_unit_of_the_parameters_does_not_matter(unit: float) -> None:
    y = observed(5)
    plain = fitted(y)
    scaled = robust_fit(lambda p: ((y - unit * COLUMNS @ p) / SIGMA, unit * COLUMNS / SIGMA), np.zeros(3))
    np.testing.assert_allclose(unit * scaled.parameters, plain.parameters, atol=1e-6)
    np.testing.assert_allclose(unit**2 * scaled.covariance, plain.covariance, rtol=1e-4, atol=1e-15)
    assert scaled.condition == pytest.approx(plain.condition, rel=1e-4)


def test_a_fit_ends_when_its_parameters_no_longer_change() -> None:
    """A linear model needs about a dozen steps to find the outliers; sixty are allowed."""
    y, calls = observed(2), 0
    y[::10] += 3.0
    model = parabola(y)

    def counting(parameters: F) -> tuple[F, F]:
        nonlocal calls
        calls += 1
        return model(parameters)

    np.testing.assert_allclose(robust_fit(counting, np.zeros(3)).parameters, TRUTH, atol=0.03)
    assert calls < 25


def test_a_known_parameter_is_kept_and_the_others_are_fitted() -> None:
    """The fit is as if the known parameter's part had been subtracted from the observations."""
    y, free = observed(6), np.array([True, False, True])
    fit = robust_fit(parabola(y), np.zeros(3), given=np.array([np.nan, -1.3, np.nan]))
    others = COLUMNS[:, free]
    alone = robust_fit(lambda p: ((y + 1.3 * X - others @ p) / SIGMA, others / SIGMA), np.zeros(2))
    assert fit.parameters[1] == -1.3
    np.testing.assert_allclose(fit.parameters[free], alone.parameters)
    np.testing.assert_allclose(fit.covariance[np.ix_(free, free)], alone.covariance)
    assert not fit.covariance[1].any()
    assert not fit.covariance[:, 1].any()
    np.testing.assert_array_equal(fit.stderr, np.sqrt(np.diag(fit.covariance)))
