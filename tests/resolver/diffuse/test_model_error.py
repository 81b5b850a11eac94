"""What the model gets wrong: a covariance that there can be, for any number of harmonics."""

import numpy as np
import pytest

from cadtof_cli.resolver.diffuse.model_error import LAG_WITH_DATA, UNIT, full_error, model_error


@pytest.mark.parametrize("further", [1, 2, 3, 6])
def test_errors_are_a_distribution_that_there_can_be(further: int) -> None:
    error = full_error(further)
    assert error.shape == (2 * further + 2,) * 2
    np.testing.assert_array_equal(error, error.T)
    assert (np.linalg.eigvalsh(error) > -1e-12).all()
    assert (np.diag(error)[:-2] > 0.0).all()


@pytest.mark.parametrize("further", [1, 2])
def test_the_error_of_the_lag_is_what_those_of_the_data_say_of_it(further: int) -> None:
    """Conditioned on the data's errors, none is left: the regression of one on the others explains it."""
    error = full_error(further)
    np.testing.assert_allclose(error[-1, :-2], UNIT * np.array(LAG_WITH_DATA[further]))
    share = np.linalg.solve(error[:-2, :-2], error[:-2, -1])
    assert error[-1, -1] - share @ error[:-2, -1] == pytest.approx(0.0, abs=1e-15)


def test_harmonics_beyond_the_third_say_of_the_lag_what_the_third_says_for_them() -> None:
    """Their ties are not known: the lag goes with the second and the third alone."""
    error = full_error(4)
    ties = error[-1, :-2].reshape(2, 4)
    np.testing.assert_array_equal(ties[:, :2], full_error(2)[-1, :-2].reshape(2, 2))
    np.testing.assert_array_equal(ties[:, 2:], 0.0)


@pytest.mark.parametrize(("off", "share"), [(0.3, 1.0), (0.06, 1.0), (0.03, 0.5), (0.0, 0.02)])
def test_where_there_is_less_mpi_less_is_wrong_of_it(off: float, share: float) -> None:
    """Errors are those of light that is not there: they go with how far q_2 is off 1, from .06 down, and never quite end."""
    ratios = np.stack([1.0 - off * np.exp(1j * np.linspace(0, 3, 50)), np.full(50, 0.5)])
    np.testing.assert_allclose(model_error(ratios), share**2 * full_error(2))
