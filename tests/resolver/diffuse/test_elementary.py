"""Elementary functions in single precision, compared with the standard library in double precision."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.diffuse.elementary import exponential, logarithm, phase_of, rotor, within_a_turn

COUNT = 20001


def floats(first: float, last: float) -> Float32:
    return np.linspace(first, last, COUNT).astype(np.float32)


def truth(function: Callable[[float], float], x: Float32) -> list[float]:
    return [function(float(one)) for one in x]


def test_the_logarithm_is_right_to_single_precision() -> None:
    for x in (floats(0.5, 2.0), np.exp(floats(-60.0, 60.0))):
        np.testing.assert_allclose(logarithm(x), truth(math.log, x), rtol=2e-7, atol=1e-7)
    assert logarithm(np.ones(1, np.float32))[0] == 0.0


def test_the_exponential_is_right_to_single_precision() -> None:
    x = floats(-80.0, 80.0)
    np.testing.assert_allclose(exponential(x), truth(math.exp, x), rtol=2e-7)
    assert exponential(np.zeros(1, np.float32))[0] == 1.0


@pytest.mark.parametrize("largest", [0.8, 7.0, 1e3])
def test_the_rotor_is_right_to_single_precision(largest: float) -> None:
    x = floats(-largest, largest)
    cos, sin = rotor(x)
    np.testing.assert_allclose(cos, truth(math.cos, x), atol=2e-7)
    np.testing.assert_allclose(sin, truth(math.sin, x), atol=2e-7)


def test_the_phase_is_right_to_single_precision_in_every_direction() -> None:
    angle = np.linspace(-3.1415, 3.1415, COUNT)
    for length in (1e-30, 1.0, 1e3):
        cos, sin = ((length * part).astype(np.float32) for part in (np.cos(angle), np.sin(angle)))
        expected = [math.atan2(float(y), float(x)) for x, y in zip(cos, sin, strict=True)]
        np.testing.assert_allclose(phase_of(cos, sin), expected, atol=3e-7)


def test_the_axes_have_exact_phases() -> None:
    """A pixel at the very beginning of the unambiguous range must not appear at its end."""
    cos, sin = (np.array(parts, np.float32) for parts in ([1.0, 1e-3, 0.0, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0, -1.0]))
    expected = np.array([0.0, 0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
    np.testing.assert_array_equal(phase_of(cos, sin), expected.astype(np.float32))


def test_phases_are_brought_between_0_and_a_full_turn() -> None:
    """This includes phases so little below 0 that a full turn minus them rounds to a full turn in single precision."""
    x = np.concatenate([floats(-6.28, 12.56), np.array([-1e-9, 0.0, 2.0 * math.pi], np.float32)])
    found = within_a_turn(x)
    assert ((found >= 0.0) & (found < np.float32(2.0 * math.pi))).all()
    np.testing.assert_allclose(np.exp(1j * found.astype(np.float64)), np.exp(1j * x.astype(np.float64)), atol=2e-6)


def test_nan_stays_nan() -> None:
    nan = np.full(1, np.nan, np.float32)
    assert np.isnan(exponential(nan)).all()
    assert np.isnan(np.stack(rotor(nan))).all()
    assert np.isnan(phase_of(nan, np.ones(1, np.float32))).all()


@pytest.mark.parametrize("value", [1e5, -1e5, 3e38, np.inf, -np.inf])
def test_very_large_numbers_and_infinity_raise_no_error(value: float) -> None:
    x = np.full(3, value, np.float32)
    with np.errstate(all="ignore"):
        for found in (exponential(x), *rotor(x), phase_of(x, x)):
            assert found.shape == x.shape
