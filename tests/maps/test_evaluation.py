"""Errors of maps against truth, compared with numpy over the errors of all frames at once."""

import numpy as np
import pytest

from cadtof_cli.maps.evaluation import DepthErrors, ErrorTally, EvaluationTally, SequenceTally


def test_error_figures_are_those_of_the_errors_of_all_frames() -> None:
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.5, 5.0, (3, 20, 30))
    depth = truth + rng.normal(0.004, 0.01, truth.shape)
    truth[0, :3], depth[1, 5:9] = np.nan, np.nan
    tally = ErrorTally()
    for found, expected in zip(depth, truth, strict=True):
        tally.add(found, expected)
    errors = 100.0 * (depth - truth)
    errors = errors[np.isfinite(errors)]
    summary = tally.summary()
    size = np.abs(errors)
    assert summary.median_cm == pytest.approx(np.quantile(size, 0.5), rel=1e-7)
    assert summary.p90_cm == pytest.approx(np.quantile(size, 0.9), rel=1e-7)
    assert summary.rmse_cm == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)
    assert summary.bias_cm == pytest.approx(errors.mean(), rel=1e-9)
    assert summary.valid == pytest.approx((1800 - 90 - 120) / (1800 - 90))


@pytest.mark.parametrize("error_m", [0.02, -0.02, 0.0, 30.0])
def test_quantiles_are_of_magnitudes_and_the_bias_has_a_sign(error_m: float) -> None:
    tally = ErrorTally()
    tally.add(np.full((2, 3), 1.0 + error_m), np.full((2, 3), 1.0))
    assert tally.summary().median_cm == pytest.approx(abs(100 * error_m), abs=1e-6)
    assert tally.summary().p90_cm == tally.summary().median_cm
    assert tally.summary().bias_cm == pytest.approx(100 * error_m, abs=1e-9)


def test_pixels_without_an_answer_or_without_truth_give_no_figures() -> None:
    tally = ErrorTally()
    assert tally.summary() == DepthErrors(None, None, None, None, 0.0)
    tally.add(np.full((2, 2), np.nan), np.ones((2, 2)))
    tally.add(np.ones((2, 2)), np.full((2, 2), np.nan))
    assert tally.summary() == DepthErrors(None, None, None, None, 0.0)
    tally.add(np.ones((2, 2)), np.ones((2, 2)))
    assert tally.summary().valid == 0.5


def test_shares_within_the_predicted_standard_deviation() -> None:
    rng = np.random.default_rng(11)
    sigma = rng.uniform(0.001, 0.01, (200, 300))
    truth = np.full(sigma.shape, 2.0)
    depth = truth + sigma * rng.standard_normal(sigma.shape)
    truth[:10], depth[10:20], sigma[20:30] = np.nan, np.nan, np.nan
    tally = ErrorTally()
    tally.add(depth, truth, sigma_m=sigma)
    found = tally.summary()
    assert found.within_1_sigma == pytest.approx(0.6827, abs=0.006)
    assert found.within_2_sigma == pytest.approx(0.9545, abs=0.003)


def test_no_shares_without_a_standard_deviation() -> None:
    tally = ErrorTally()
    tally.add(np.full((2, 2), 1.01), np.ones((2, 2)))
    assert (tally.summary().within_1_sigma, tally.summary().within_2_sigma) == (None, None)


def test_figures_are_told_in_cm_and_percent_and_missing_ones_by_a_dash() -> None:
    assert DepthErrors(0.404, 1.0, 2.5, -0.026, 0.9, 0.905, 0.995).in_words == (
        *("0.40", "1.00", "2.50", "-0.03"),
        *("90.0%", "90.5%", "99.5%"),
    )
    assert DepthErrors(None, None, None, None, 0.0).in_words == ("–", "–", "–", "–", "0.0%", "–", "–")


def test_the_first_phasor_is_evaluated_only_if_every_map_has_it() -> None:
    rng = np.random.default_rng(3)
    truth, sigma = rng.uniform(1.0, 2.0, (5, 7)), np.full((5, 7), 0.01)
    depth, first_phasor = truth + 0.01 * rng.normal(size=truth.shape) + 0.003, truth + 0.5
    tally, direct = EvaluationTally(), ErrorTally()
    for frames in (1, 2):
        tally.add(depth, truth, sigma_m=sigma, first_phasor_m=first_phasor)
        direct.add(depth, truth, sigma_m=sigma)
        found = tally.summary()
        assert (found.frames, found.direct) == (frames, direct.summary())
        assert found.first_phasor is not None
        assert found.first_phasor.bias_cm == pytest.approx(50.0)
        assert found.first_phasor.within_1_sigma is None
        assert list(found.in_words.items()) == [("first phasor", found.first_phasor), ("direct path", found.direct)]
    tally.add(depth, truth, sigma_m=None, first_phasor_m=None)
    assert (tally.summary().frames, tally.summary().first_phasor) == (3, None)
    assert list(tally.summary().in_words) == ["direct path"]


def test_depths_that_are_not_finite_do_not_count() -> None:
    tally = ErrorTally()
    tally.add(np.array([np.inf, np.inf, 1.0]), np.array([np.inf, 1.0, 1.0]))
    assert tally.summary() == DepthErrors(0.0, 0.0, 0.0, 0.0, 0.5)


@pytest.mark.parametrize("far", [1e300, -1e300, np.inf])
def test_a_depth_beyond_float32_counts_as_missing(far: float) -> None:
    """A float64 file can hold such a depth; its square overflows."""
    truth, depth = np.full((2, 3), 2.0), np.full((2, 3), 2.01)
    truth[0, 0], depth[0, 1] = far, far
    tally = ErrorTally()
    tally.add(depth, truth)
    summary = tally.summary()
    assert summary.rmse_cm == pytest.approx(1.0)
    assert summary.valid == pytest.approx(4 / 5)


@pytest.mark.parametrize("far", [np.inf, 1e300, -np.inf, -1e300])
def test_depths_not_finite_or_beyond_float32_do_not_count_in_a_sequence(far: float) -> None:
    tally = SequenceTally((3,))
    for frame in ([far, 1.0, np.nan], [far, 3.0, np.nan], [2.0, np.nan, np.nan]):
        tally.add(np.array(frame), np.array(frame))
    found = tally.summary()
    np.testing.assert_array_equal(found.frames, [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(found.mean, np.array([2.0, 2.0, np.nan], np.float32))
    np.testing.assert_array_equal(found.std, np.array([np.nan, np.sqrt(2.0), np.nan], np.float32))
