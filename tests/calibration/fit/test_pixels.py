"""Phases, gains and amplitudes of pixels are found from made-up targets without noise."""

import numpy as np
import pytest

from cadtof_cli.calibration.fit.pixels import Observations, fit_pixels, series, two_way

TARGETS, PIXELS = 4, 50
HARMONICS = (1, 2)
RNG = np.random.default_rng(1)


def test_a_series_is_the_sum_of_its_terms_over_the_main_term() -> None:
    theta = np.linspace(-3.0, 3.0, 20)
    expected = 1.0 + (0.1 - 0.2j) * np.exp(-2j * theta) + 0.05j * np.exp(2j * theta)
    np.testing.assert_allclose(series({-1: 0.1 - 0.2j, 3: 0.05j}, theta), expected, rtol=1e-14)
    np.testing.assert_array_equal(series({}, theta), 1.0)


@pytest.mark.parametrize("terms", [({}, {}), ({-1: 0.03 - 0.02j, 0: 0.01j}, {-1: -0.02j, 3: 0.04 + 0j})])
def test_phases_gains_and_amplitudes_are_found_exactly(terms: tuple[dict[int, complex], ...]) -> None:
    phase = RNG.uniform(0.3, 3.0, (TARGETS, PIXELS))
    pixel_phases = RNG.normal(0.0, 0.3, (2, PIXELS))
    gain = np.stack([np.ones(PIXELS), RNG.uniform(0.7, 1.3, PIXELS)])
    amplitude = RNG.uniform(0.02, 0.1, (TARGETS, PIXELS))
    volts = np.empty((TARGETS, 2, PIXELS), np.complex128)
    for row, h in enumerate(HARMONICS):
        theta = h * phase + pixel_phases[row]
        volts[:, row] = amplitude * gain[row] * np.exp(1j * theta) * series(terms[row], theta)
    noise = np.tile([2e-4, 3e-4], (TARGETS, 1))
    observed = Observations(volts, noise, phase, HARMONICS)
    fit = fit_pixels(observed, terms)
    np.testing.assert_allclose(np.angle(np.exp(1j * (fit.phase - pixel_phases))), 0.0, atol=1e-7)
    np.testing.assert_allclose(np.exp(fit.log_gain), gain, rtol=1e-6)
    np.testing.assert_allclose(fit.left, 0.0, atol=1e-6)
    np.testing.assert_allclose(fit.weights, np.abs(volts) ** 2 / noise[:, :, np.newaxis] ** 2)
    assert fit.misfit.max() < 1e-4
    some = fit_pixels(observed[slice(10, 20)], terms)
    np.testing.assert_allclose(some.phase, fit.phase[:, 10:20], atol=1e-12)


def test_the_misfit_is_chi_squared_over_all_targets_and_harmonics() -> None:
    """4 × 2 complex values are 16 numbers. Fitted are 2 phases, 1 log gain and 4 log amplitudes: 16 − 7 = 9 remain."""
    size = 4000
    phase = RNG.uniform(0.3, 3.0, (TARGETS, size))
    sigma = 1e-4
    noise = sigma * (RNG.normal(size=(TARGETS, 2, size)) + 1j * RNG.normal(size=(TARGETS, 2, size)))
    clean = np.stack([0.05 * np.exp(1j * h * phase) for h in HARMONICS], axis=1)
    volts = np.asarray(clean + noise, np.complex128)
    fit = fit_pixels(Observations(volts, np.full((TARGETS, 2), sigma), phase, HARMONICS), ({}, {}))
    assert fit.misfit.mean() == pytest.approx(9.0, rel=0.03)


def test_two_way_separates_the_parts_of_harmonics_and_of_targets() -> None:
    by_harmonic = np.stack([np.zeros(PIXELS), RNG.normal(size=PIXELS)])
    by_target = RNG.normal(size=(TARGETS, PIXELS))
    weights = RNG.uniform(1.0, 3.0, (TARGETS, 1, PIXELS)) * np.array([1.0, 2.5])[:, np.newaxis]
    harmonic, target = two_way(by_harmonic + by_target[:, np.newaxis, :], weights)
    np.testing.assert_allclose(harmonic, by_harmonic, atol=1e-12)
    np.testing.assert_allclose(target, by_target, atol=1e-12)


def test_two_way_separates_the_parts_of_a_sum_whatever_the_weights() -> None:
    by_harmonic = np.stack([np.zeros(PIXELS), *RNG.normal(size=(2, PIXELS))])
    by_target = RNG.normal(size=(TARGETS, PIXELS))
    weights = RNG.exponential(size=(TARGETS, 3, PIXELS))
    harmonic, target = two_way(by_harmonic + by_target[:, np.newaxis, :], weights)
    np.testing.assert_allclose(harmonic, by_harmonic, atol=1e-12)
    np.testing.assert_allclose(target, by_target, atol=1e-12)
