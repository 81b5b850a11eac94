from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.resolver.two_path.arctangent import COEFFICIENTS, TAN_EIGHTH, phase_of

ULP = np.spacing(2 * np.pi)


def arctangent(t: Decimal) -> Decimal:
    """Euler's series, Σ 2^(2k)·(k!)²/(2k+1)! · t^(2k+1)/(1+t²)^(k+1): faster than Gregory's, and nothing like ours."""
    term = t / (1 + t * t)
    total, k = term, 0
    while abs(term) > abs(total) * Decimal("1e-40"):
        k += 1
        term *= Decimal(2 * k) / Decimal(2 * k + 1) * (t * t / (1 + t * t))
        total += term
    return total


def test_the_polynomial_is_the_arctangent_to_8e_18() -> None:
    with localcontext() as context:
        context.prec = 50
        for step in range(1, 300):
            t = Decimal(TAN_EIGHTH) * step / 299
            z = t * t
            ours = t + t * z * sum(Decimal(c) * z**k for k, c in enumerate(COEFFICIENTS))
            assert abs(ours / arctangent(t) - 1) < Decimal("8e-18")


def test_phases_are_right_to_the_last_digit_of_a_full_turn() -> None:
    phase = np.random.default_rng(8).uniform(0, 2 * np.pi, 200_000)
    size = np.random.default_rng(9).uniform(0.5, 2.0, phase.size)
    cos, sin = size * np.cos(phase), size * np.sin(phase)
    expected = np.arctan2(sin, cos) % (2 * np.pi)
    assert np.abs(phase_of(cos, sin) - expected).max() <= ULP


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
        (1.0, 1.0, 0.25 * np.pi),
        (-1.0, -1.0, 1.25 * np.pi),
        (np.nan, 1.0, np.nan),
        (1.0, np.nan, np.nan),
    ],
)
def test_phases_of_the_axes_and_of_what_is_no_number(cos: float, sin: float, phase: float) -> None:
    np.testing.assert_equal(phase_of(np.array([cos]), np.array([sin])), [phase])


@given(st.floats(-1, 1), st.floats(-1, 1).filter(lambda sin: sin != 0))
def test_a_phase_lies_in_one_turn_and_its_mirror_image_on_the_other_side(cos: float, sin: float) -> None:
    phase, mirrored = phase_of(np.array([cos, cos]), np.array([abs(sin), -abs(sin)]))
    assert 0 <= phase <= np.pi
    assert np.pi <= mirrored < 2 * np.pi or mirrored == 0
    assert (phase + mirrored) % (2 * np.pi) in (pytest.approx(0, abs=ULP), pytest.approx(2 * np.pi, abs=ULP))
