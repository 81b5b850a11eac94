"""Errors of the model: their covariance for any number of harmonics, and the share of them that applies to a patch."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.model_error import LAG_WITH_DATA, UNIT, full_error, model_error, mpi_share
from tests.support.diffuse_frames import M_PER_RAD


@pytest.mark.parametrize("following", [1, 2, 3, 6])
def test_errors_are_a_distribution_that_there_can_be(following: int) -> None:
    error = full_error(following)
    assert error.shape == (2 * following + 2,) * 2
    np.testing.assert_array_equal(error, error.T)
    assert (np.linalg.eigvalsh(error) > -1e-12).all()
    assert (np.diag(error)[:-2] > 0.0).all()


def test_ratios_are_wrong_by_hundredths_and_phases_by_as_many_radians() -> None:
    """Independent errors have standard deviations of 2.3 % and 28 mrad at harmonic 2, and 2 % and 21 mrad after it."""
    for following in (1, 2, 4):
        error = full_error(following)[:-2, :-2]
        sigma = np.array([0.023, *[0.02] * (following - 1), 0.028, *[0.021] * (following - 1)])
        np.testing.assert_allclose(error, np.diag(sigma**2))


@pytest.mark.parametrize(
    ("following", "by_ratios", "by_phases", "left_mm"),
    [(1, [-0.378], [-0.102], 8.73), (2, [0.189, -0.45], [-0.357, 0.091], 13.61)],
)
def test_a_lag_is_wrong_by_centimetres_and_the_data_tell_of_it(
    following: int, by_ratios: list[float], by_phases: list[float], left_mm: float
) -> None:
    """The numbers are rad of the lag per unit of ln|q_h| and per rad of arg q_h that a datum deviates from the model.

    `left_mm` is the standard deviation of the error of the lag at T1 = 40 ns.
    """
    error = full_error(following)
    told = np.linalg.solve(error[:-2, :-2], error[:-2, -1])
    np.testing.assert_allclose(told, by_ratios + by_phases, atol=6e-4)
    assert 1000 * np.sqrt(error[-1, -1]) * M_PER_RAD == pytest.approx(left_mm, rel=1e-3)


@pytest.mark.parametrize("following", [1, 2])
def test_the_error_of_the_lag_is_what_those_of_the_data_say_of_it(following: int) -> None:
    """A regression on the errors of the data explains the error of the lag completely."""
    error = full_error(following)
    np.testing.assert_allclose(error[-1, :-2], UNIT * np.array(LAG_WITH_DATA[following]))
    share = np.linalg.solve(error[:-2, :-2], error[:-2, -1])
    assert error[-1, -1] - share @ error[:-2, -1] == pytest.approx(0.0, abs=1e-15)


def test_harmonics_beyond_the_third_say_of_the_lag_what_the_third_says_for_them() -> None:
    """The covariances of later harmonics with the lag are unknown, so only the second and the third count."""
    error = full_error(4)
    ties = error[-1, :-2].reshape(2, 4)
    np.testing.assert_array_equal(ties[:, :2], full_error(2)[-1, :-2].reshape(2, 2))
    np.testing.assert_array_equal(ties[:, 2:], 0.0)


@pytest.mark.parametrize(("off", "share"), [(0.3, 1.0), (0.06, 1.0), (0.03, 0.5), (0.0, 0.02)])
def test_where_there_is_less_mpi_less_is_wrong_of_it(off: float, share: float) -> None:
    """Below |q_2 − 1| = .06, the errors are in proportion to |q_2 − 1|, but never below .02 of the full errors."""
    ratios = np.stack([1.0 - off * np.exp(1j * np.linspace(0, 3, 50)), np.full(50, 0.5)])
    np.testing.assert_allclose(model_error(ratios), np.repeat(share**2 * full_error(2)[..., None], 50, axis=2))


def test_errors_go_with_the_mpi_of_a_patch_that_has_more_than_the_frame() -> None:
    """A dim wall may get most of its light from a bright ball, while the rest of the view has hardly any MPI.

    The errors of its patches are then as large as in a room.
    """
    off = np.array([0.006, 0.006, 0.006, 0.003, 0.03, 0.06, 0.9])
    ratios = (1.0 + off * np.exp(2j))[None]
    shares = np.array([0.1, 0.1, 0.1, 0.1, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(model_error(ratios), full_error(1)[..., None] * shares**2)


def test_a_share_of_mpi_is_that_of_the_patch_in_the_middle() -> None:
    """The median ignores a few patches with extreme values. Only the second harmonic counts."""
    q_2 = np.array([1.0, 1.0 - 0.012j, 1.015, 0.0, -7.0 + 0.0j])
    assert mpi_share(np.stack([q_2, np.zeros(5)])) == pytest.approx(0.25)
