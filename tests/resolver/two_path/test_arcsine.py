"""Phases from rotors: an arcsine by a polynomial, compared with Euler's series in 50 decimal digits."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.resolver.two_path.arcsine import COEFFICIENTS, COS_SIXTH, SIN_TWELFTH, phase_of

ULP = np.spacing(2 * np.pi)


def arcsine(s: Decimal) -> Decimal:
    """Return arctan t, t = s/√(1−s²), by Euler's series Σ 2^(2k)·(k!)²/(2k+1)! · t^(2k+1)/(1+t²)^(k+1).

    This method has nothing in common with the polynomial under test.
    """
    t = s / (1 - s * s).sqrt()
    term = t / (1 + t * t)
    total, k = term, 0
    while abs(term) > abs(total) * Decimal("1e-40"):
        k += 1
        term *= Decimal(2 * k) / Decimal(2 * k + 1) * (t * t / (1 + t * t))
        total += term
    return total


def test_the_polynomial_is_the_arcsine_to_1e_17() -> None:
    with localcontext() as context:
        context.prec = 50
        for step in range(1, 300):
            s = Decimal(SIN_TWELFTH) * step / 299
            z = s * s
            polynomial = s + s * z * sum(Decimal(c) * z**k for k, c in enumerate(COEFFICIENTS))
            assert abs(polynomial / arcsine(s) - 1) < Decimal("1.1e-17")


def test_the_constants_are_the_nearest_numbers_to_their_values() -> None:
    assert float((Decimal(6).sqrt() - Decimal(2).sqrt()) / 4) == SIN_TWELFTH
    assert float(Decimal(3).sqrt() / 2) == COS_SIXTH


def test_phases_are_right_to_the_last_digit_of_a_full_turn() -> None:
    phase = np.random.default_rng(8).uniform(0, 2 * np.pi, 200_000)
    cos, sin = np.cos(phase), np.sin(phase)
    expected = np.arctan2(sin, cos) % (2 * np.pi)
    assert np.abs(phase_of(cos, sin) - expected).max() <= ULP


def test_small_phases_keep_their_digits() -> None:
    phase = 10.0 ** np.random.default_rng(10).uniform(-300, -1, 10_000)
    np.testing.assert_allclose(phase_of(np.cos(phase), np.sin(phase)), phase, rtol=4e-16)


def test_a_rotor_of_a_length_that_is_not_quite_1_has_the_same_phase() -> None:
    phase = np.random.default_rng(11).uniform(0.1, 2 * np.pi - 0.1, 10_000)
    for size in (1 - 1e-13, 1 + 1e-13):
        assert np.abs(phase_of(size * np.cos(phase), size * np.sin(phase)) - phase).max() < 1e-13


@pytest.mark.parametrize(
    ("cos", "sin", "phase"),
    [
        (1.0, 0.0, 0.0),
        (1.0, -0.0, 0.0),
        (1.0, -1e-300, 0.0),
        (1.0, 1e-300, 1e-300),
        (0.0, 1.0, 0.5 * np.pi),
        (-0.0, 1.0, 0.5 * np.pi),
        (-1.0, 0.0, np.pi),
        (-1.0, -0.0, np.pi),
        (0.0, -1.0, 1.5 * np.pi),
        (np.sqrt(0.5), np.sqrt(0.5), 0.25 * np.pi),
        (-np.sqrt(0.5), -np.sqrt(0.5), 1.25 * np.pi),
        (np.nan, np.nan, np.nan),
    ],
)
def test_phases_on_the_axes_and_diagonals_and_of_nan(cos: float, sin: float, phase: float) -> None:
    np.testing.assert_allclose(phase_of(np.array([cos]), np.array([sin])), [phase], rtol=2e-16, atol=0)


@given(st.floats(-1, 1).filter(lambda sin: sin != 0), st.booleans())
def test_a_phase_lies_between_0_and_a_full_turn_and_a_mirrored_rotor_has_the_negative_phase(
    sin: float, behind: bool
) -> None:
    cos = (-1) ** behind * np.sqrt((1 - sin) * (1 + sin))
    phase, mirrored = phase_of(np.array([cos, cos]), np.array([abs(sin), -abs(sin)]))
    assert 0 <= phase <= np.pi
    assert np.pi <= mirrored < 2 * np.pi or mirrored == 0
    assert (phase + mirrored) % (2 * np.pi) in (pytest.approx(0, abs=ULP), pytest.approx(2 * np.pi, abs=ULP))
