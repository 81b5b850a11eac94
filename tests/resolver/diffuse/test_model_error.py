"""Errors of the model: their covariance for any number of harmonics, and the share of them that applies to a patch."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.model_error import LAG_WITH_DATA, UNIT, full_error, model_error, mpi_share
from tests.support.diffuse_frames import M_PER_RAD


@pytest.mark.parametrize("following", [1, 2, 3, 6])
def test_the_covariance_is_symmetric_and_positive(following: int) -> None:
    error = full_error(following)
    assert error.shape == (2 * following + 2,) * 2
    np.testing.assert_array_equal(error, error.T)
    assert (np.linalg.eigvalsh(error) > -1e-12).all()
    assert (np.diag(error)[:-2] > 0.0).all()


def test_errors_of_the_data_have_the_documented_standard_deviations() -> None:
    """Independent errors have standard deviations of 2.3 % and 28 mrad at harmonic 2, and 2 % and 21 mrad after it."""
    for following in (1, 2, 4):
        error = full_error(following)[:-2, :-2]
        sigma = np.array([0.023, *[0.02] * (following - 1), 0.028, *[0.021] * (following - 1)])
        np.testing.assert_allclose(error, np.diag(sigma**2))


@pytest.mark.parametrize(
    ("following", "by_ratios", "by_phases", "sigma_mm"),
    [(1, [-0.378], [-0.102], 8.73), (2, [0.189, -0.45], [-0.357, 0.091], 13.61)],
)
def test_the_error_of_the_lag_is_a_regression_on_the_errors_of_the_data(
    following: int, by_ratios: list[float], by_phases: list[float], sigma_mm: float
) -> None:
    """The numbers are rad of the lag per unit of ln|q_h| and per rad of arg q_h that a datum deviates from the model.

    `sigma_mm` is the standard deviation of the error of the lag at T1 = 40 ns.
    """
    error = full_error(following)
    regression = np.linalg.solve(error[:-2, :-2], error[:-2, -1])
    np.testing.assert_allclose(regression, by_ratios + by_phases, atol=6e-4)
    assert 1000 * np.sqrt(error[-1, -1]) * M_PER_RAD == pytest.approx(sigma_mm, rel=1e-3)


@pytest.mark.parametrize("following", [1, 2])
def test_the_errors_of_the_data_explain_the_error_of_the_lag_completely(following: int) -> None:
    """A regression on the errors of the data explains the error of the lag completely."""
    error = full_error(following)
    np.testing.assert_allclose(error[-1, :-2], UNIT * np.array(LAG_WITH_DATA[following]))
    share = np.linalg.solve(error[:-2, :-2], error[:-2, -1])
    assert error[-1, -1] - share @ error[:-2, -1] == pytest.approx(0.0, abs=1e-15)


def test_harmonics_after_the_third_have_no_covariance_with_the_lag() -> None:
    """The covariances of later harmonics with the lag are unknown, so only the second and the third count."""
    error = full_error(4)
    ties = error[-1, :-2].reshape(2, 4)
    np.testing.assert_array_equal(ties[:, :2], full_error(2)[-1, :-2].reshape(2, 2))
    np.testing.assert_array_equal(ties[:, 2:], 0.0)


@pytest.mark.parametrize(("distance", "share"), [(0.3, 1.0), (0.06, 1.0), (0.03, 0.5), (0.0, 0.02)])
def test_errors_are_in_proportion_to_the_mpi_down_to_a_least_share(distance: float, share: float) -> None:
    """Below |q_2 − 1| = .06, the errors are in proportion to |q_2 − 1|, but never below .02 of the full errors."""
    ratios = np.stack([1.0 - distance * np.exp(1j * np.linspace(0, 3, 50)), np.full(50, 0.5)])
    np.testing.assert_allclose(model_error(ratios), np.repeat(share**2 * full_error(2)[..., None], 50, axis=2))


def test_errors_follow_the_mpi_of_the_patch_if_it_has_more_than_the_frame() -> None:
    """A dim wall may get most of its light from a bright ball, while the rest of the view has hardly any MPI.

    The errors of its patches are then as large as in a room.
    """
    distance = np.array([0.006, 0.006, 0.006, 0.003, 0.03, 0.06, 0.9])
    ratios = (1.0 + distance * np.exp(2j))[None]
    shares = np.array([0.1, 0.1, 0.1, 0.1, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(model_error(ratios), full_error(1)[..., None] * shares**2)


def test_the_share_of_mpi_is_that_of_the_median_patch() -> None:
    """The median ignores a few patches with extreme values. Only the second harmonic counts."""
    q_2 = np.array([1.0, 1.0 - 0.012j, 1.015, 0.0, -7.0 + 0.0j])
    assert mpi_share(np.stack([q_2, np.zeros(5)])) == pytest.approx(0.25)
