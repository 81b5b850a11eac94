"""Inverse square roots, compared with roots in 40 decimal digits."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from cadtof_cli.resolver.two_path.roots import LEAST, START, inverse_root, inverse_root_or_none, rough_inverse_root


def numbers(seed: int, size: int) -> np.ndarray:
    """Return normal numbers of every exponent."""
    rng = np.random.default_rng(seed)
    return rng.uniform(1.0, 2.0, size) * 2.0 ** rng.integers(-1022, 1023, size)


def test_inverse_roots_and_the_roots_that_they_make_are_right_to_the_last_digits() -> None:
    x = np.append(numbers(1, 3000), [LEAST, 1.0, 2.0, np.nextafter(2.0, 1.0), np.finfo(np.float64).max])
    with localcontext() as context:
        context.prec = 40
        for value, inverse, root in zip(x, inverse_root(x), x * inverse_root(x), strict=True):
            exact = Decimal(value).sqrt()
            assert abs(Decimal(inverse) * exact - 1) < Decimal("2e-16")
            assert abs(Decimal(root) / exact - 1) < Decimal("3e-16")


def test_the_start_and_the_cubic_step_have_their_documented_errors() -> None:
    x = np.geomspace(1.0, 4.0, 100_000)
    start = (START - (x.view(np.uint64) >> np.uint64(1))).view(np.float64)
    assert np.abs(start * np.sqrt(x) - 1.0).max() < 0.035
    assert np.abs(rough_inverse_root(x) * np.sqrt(x) - 1.0).max() < 2.7e-5


@pytest.mark.parametrize("tiny", [0.0, -0.0, 5e-324, np.nextafter(LEAST, 0.0)])
def test_numbers_below_the_least_normal_one_have_a_root_near_0_and_an_inverse_of_0(tiny: float) -> None:
    x = np.array([tiny])
    np.testing.assert_array_equal(inverse_root_or_none(x), 0.0)
    assert 0.0 <= abs((x * inverse_root(x))[0]) < 1e-153
    assert tiny or (x * inverse_root(x))[0] == 0.0


def test_normal_numbers_have_the_same_inverse_root_from_both_functions() -> None:
    x = np.append(numbers(3, 1000), LEAST)
    np.testing.assert_array_equal(inverse_root_or_none(x), inverse_root(x))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_and_infinity_give_nan(bad: float) -> None:
    with np.errstate(invalid="ignore"):
        assert np.isnan(inverse_root(np.array([bad]))).all()


def test_inputs_are_not_changed() -> None:
    x = numbers(2, 10)
    before = x.copy()
    inverse_root(x)
    np.testing.assert_array_equal(x, before)
