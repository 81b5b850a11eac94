"""The response of a channel pair as a Fourier series, compared with sums, finite differences, waveform and pulse."""

import math

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pulse
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response

TERMS = ((1, 0.9 + 0.1j), (-1, 0.05 - 0.02j), (0, 0.01 + 0j), (-3, 0.08j))


def test_the_answer_is_the_sum_of_its_terms_and_the_slope_its_derivative() -> None:
    response = HarmonicResponse(2, TERMS)
    theta = np.linspace(-4.0, 8.0, 101)
    expected = sum(g * (np.cos(k * theta) + 1j * np.sin(k * theta)) for k, g in TERMS)
    np.testing.assert_allclose(response.at(theta), expected, atol=1e-15)
    step = 1e-5
    slope = (response.at(theta + step) - response.at(theta - step)) / (2 * step)
    np.testing.assert_allclose(response.slope_at(theta), slope, atol=1e-9)


def test_main_mirror_and_linear_follow_from_the_terms() -> None:
    response = HarmonicResponse(2, TERMS)
    assert (response.main, response.mirror, response.linear) == (0.9 + 0.1j, 0.05 - 0.02j, False)
    assert HarmonicResponse(1, ((1, 0.5 + 0j),)).mirror == 0j
    assert HarmonicResponse(1, ((1, 0.5 + 0j), (-1, 0.1j))).linear
    assert not HarmonicResponse(1, ((1, 0.5 + 0j), (0, 0.1j))).linear


def test_the_mirror_term_is_removed_exactly() -> None:
    response = HarmonicResponse(1, TERMS)
    q = np.array([0.3 + 0.1j, -0.2j, 1.0 + 0j])
    recorded = (0.9 + 0.1j) * q + (0.05 - 0.02j) * q.conj()
    np.testing.assert_allclose(response.without_mirror(recorded), q, atol=1e-15)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (((1, 1.0 + 0j), (1, 0.1 + 0j)), r"harmonic 3: an order occurs twice in \[1, 1\]"),
        (((0, 1.0 + 0j),), r"harmonic 3: found G\[k=1\] = 0j, expected more than k = -1"),
        (((1, 0.1 + 0j), (-1, 0.1 + 0j)), r"found G\[k=1\] = \(0.1\+0j\)"),
    ],
)
def test_a_series_with_a_repeated_or_too_weak_main_term_is_refused(
    terms: tuple[tuple[int, complex], ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        HarmonicResponse(3, terms)


def test_a_sine_is_one_term_that_the_pulse_makes_smaller() -> None:
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=(40.0, 20.0, 10.0)))
    for h, response in zip((1, 2, 4), ideal_response(metadata), strict=True):
        expected = math.exp(-((h * 2 * math.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2)
        assert response.harmonic == h
        assert dict(response.terms) == {1: pytest.approx(expected, rel=1e-9)}


@pytest.mark.parametrize("fwhm_ns", [0.0, 1.7])
def test_a_triangle_has_odd_terms_of_alternating_sign_that_fall_with_the_square(fwhm_ns: float) -> None:
    """The terms are 8/π² times 1, 1/9 at −3, 1/25 at 5, 1/49 at −7 and so on; the pulse makes each term smaller."""
    metadata = CaptureMetadata(modulation=Modulation(waveform="triangle"), pulse=Pulse(fwhm_ns=fwhm_ns))
    for h, response in zip((1, 2), ideal_response(metadata), strict=True):
        terms = dict(response.terms)
        assert [k for k, _ in response.terms][:4] == [1, -3, 5, -7][: len(terms)]
        for k, g in terms.items():
            pulse = math.exp(-((k * h * 2 * math.pi * fwhm_ns / 2.354820045 / 40.0) ** 2) / 2)
            assert g == pytest.approx(8 / math.pi**2 / k**2 * pulse, rel=1e-9)
            assert k % 4 == 1
        # every term that is left out is below 1e-4 of the fundamental
        if fwhm_ns == 0.0:
            assert max(map(abs, terms)) == 99
            assert len(terms) == 50


@pytest.mark.parametrize("fwhm_ns", [8.0, 3.497, 3.3, 1.7])
def test_terms_after_the_fifth_are_left_out_below_a_ten_thousandth_of_the_first(fwhm_ns: float) -> None:
    metadata = CaptureMetadata(modulation=Modulation(waveform="triangle"), pulse=Pulse(fwhm_ns=fwhm_ns))
    exponent = (2 * math.pi * fwhm_ns / 2.354820045 / 40.0) ** 2 / 2
    for h, response in zip((1, 2), ideal_response(metadata), strict=True):
        orders = [abs(k) for k, _ in response.terms]
        following = orders[-1] + 2
        for k in (*orders, following):
            share = math.exp(-((k * k - 1) * h * h) * exponent) / k**2
            assert (k <= 5 or share >= 1e-4) == (k != following)
