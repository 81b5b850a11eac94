"""The higher terms of a response that targets determine, and the terms of a waveform after a change."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize

from cadtof_cli.calibration.fit.pixels import Observations, Terms, series
from cadtof_cli.calibration.fit.terms import TermFit, composed, fit_terms

TRIANGLE = {-3: 1 / 9 + 0.01j, 5: 1 / 25 + 0j}


def test_an_imbalance_mirrors_every_term_of_the_waveform() -> None:
    """An imbalance turns any waveform v into v + c·conj(v), so that every term k also appears at −k."""
    c = 0.03 - 0.02j
    theta = np.linspace(-3.0, 3.0, 50)
    wave = np.exp(1j * theta) * series(TRIANGLE, theta)
    found = np.exp(1j * theta) * series(composed(TRIANGLE, {-1: c}), theta)
    np.testing.assert_allclose(found, wave + c * wave.conj(), atol=1e-15)


@pytest.mark.parametrize("k", [0, -3, 3, 5])
def test_a_change_of_another_order_changes_that_order_alone(k: int) -> None:
    found = composed(TRIANGLE, {k: 0.02j})
    assert found == TRIANGLE | {k: TRIANGLE.get(k, 0j) + 0.02j}
    assert composed(TRIANGLE, {}) == TRIANGLE


HARMONICS = (1, 2)

TRUTH = ({-1: 0.02 + 0.01j, 0: 0.004j}, {-1: -0.015j, 0: 0.003 + 0j, 3: 0.01 + 0j})


def observed(
    *,
    noise_v: float = 1e-4,
    pixels: int = 250,
    targets: int = 6,
    seed: int = 1,
    spoilt: int = 0,
    truth: Terms = TRUTH,
    turn: float = 0.5,
) -> Observations:
    """Return targets at distances over a turn of the fundamental, seen by pixels with different phases and gains.

    In the first `spoilt` pixels, one phasor is turned by `turn` rad.
    """
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.4, 5.6, targets)[:, np.newaxis] + rng.normal(0.0, 0.05, (targets, pixels))
    pixel_phases, gain = rng.normal(0.0, 0.2, (2, pixels)), rng.uniform(0.9, 1.1, (2, pixels))
    size = 0.06 * np.linspace(1.0, 0.5, targets)[:, np.newaxis] * np.ones(pixels)
    theta = np.stack([h * phase + pixel_phases[row] for row, h in enumerate(HARMONICS)], axis=1)
    volts = np.stack(
        [size * gain[row] * np.exp(1j * theta[:, row]) * series(truth[row], theta[:, row]) for row in range(2)], axis=1
    )
    volts = volts + noise_v * (rng.normal(size=volts.shape) + 1j * rng.normal(size=volts.shape))
    volts[0, 0, :spoilt] *= np.exp(1j * turn)
    return Observations(np.asarray(volts, np.complex128), np.full((targets, 2), noise_v), phase, HARMONICS)


def orders(found: TermFit) -> set[int]:
    return set(found.terms[0])


def test_existing_terms_are_taken_and_found() -> None:
    """The term k = 3 exists in the second harmonic only, but is taken in both; no other term is taken."""
    found = fit_terms(observed(), ({}, {}), distances=6)
    assert orders(found) == {-1, 0, 3}
    for row, terms in enumerate(found.terms):
        for (k, value), error in zip(terms.items(), found.stderr[row], strict=True):
            assert abs(value - TRUTH[row].get(k, 0j)) < 5.0 * error
            assert error < 2e-4
    assert found.residual == pytest.approx(1.0, abs=0.04)
    assert found.kept.mean() > 0.98
    findings = dict(text.split(": ", maxsplit=1) for text in found.findings)
    assert list(findings) == ["k = -1", "k = +0", "k = -3", "k = +5", "k = +3"]
    assert [text.split(",")[0] for text in findings.values()] == ["used", "used", "not used", "not used", "used"]


def test_standard_errors_are_the_scatter_of_repetitions() -> None:
    drawn = [fit_terms(observed(seed=seed, pixels=80), ({}, {}), distances=6) for seed in range(2, 26)]
    assert all(orders(one) == {-1, 0, 3} for one in drawn)
    for row in range(2):
        for k in (-1, 0, 3):
            values = np.array([one.terms[row][k] for one in drawn])
            predicted = np.mean([dict(zip(one.terms[row], one.stderr[row], strict=True))[k] for one in drawn])
            spread = max(values.real.std(ddof=1), values.imag.std(ddof=1))
            assert predicted == pytest.approx(spread, rel=0.45)


@pytest.mark.parametrize(("turn", "left_out"), [(0.5, True), (0.03, True), (0.02, True), (0.004, False)])
def test_pixels_that_fit_worse_than_all_others_are_left_out(turn: float, left_out: bool) -> None:
    """In the first pixels, one of twelve phasors is turned by so many rad. The noise of a phasor is 1.7 mrad.

    The root of the misfit of a pixel, over all phasors, is 3.9 ± .7 in units of the noise.
    """
    found = fit_terms(observed(spoilt=10, turn=turn), ({}, {}), distances=6)
    assert (~found.kept[:10]).sum() == (10 if left_out else pytest.approx(0, abs=1))
    assert found.kept[10:].mean() > 0.97
    assert found.residual == pytest.approx(1.0, abs=0.05)


def test_terms_with_large_standard_errors_are_not_taken() -> None:
    """With noise of 1/50 of the signal and few pixels, the standard errors exceed 2e-3."""
    found = fit_terms(observed(noise_v=2e-3, pixels=60), ({}, {}), distances=6)
    assert not orders(found)
    assert all("cannot be determined" in text for text in found.findings)


def test_terms_too_small_to_matter_are_not_taken() -> None:
    """Terms below 2e-4 are left out, and larger terms are taken."""
    for size, taken in ((1.6e-4, False), (2.4e-4, True)):
        found = fit_terms(observed(noise_v=1e-6, truth=({3: size + 0j}, {})), ({}, {}), distances=6)
        assert (orders(found) == {3}) is taken
        assert taken or not orders(found)


def test_one_distance_determines_no_further_terms() -> None:
    found = fit_terms(observed(), ({5: 0.1j}, {}), distances=1)
    assert (found.terms, found.stderr, found.residual) == (({5: 0.1j}, {}), ((), ()), 1.0)
    assert found.kept.all()
    (told,) = found.findings
    assert "depths at other distances will be wrong, at 5 % by centimetres, and sigma will not say it" in told


def test_two_distances_that_are_the_same_for_all_pixels_determine_no_further_terms() -> None:
    """Without noise, the normal matrix then has no inverse."""
    phase = np.tile([[0.4], [2.3]], (1, 50))
    volts = np.stack([0.06 * np.exp(1j * h * phase) * series({-1: 0.02 + 0j}, h * phase) for h in HARMONICS], axis=1)
    found = fit_terms(Observations(volts, np.full((2, 2), 1e-4), phase, HARMONICS), ({}, {}), distances=2)
    assert not orders(found)
    assert all("cannot be determined: standard error inf, condition inf" in text for text in found.findings)


def test_the_residual_of_one_pixel_is_that_of_the_best_fit() -> None:
    """24 numbers were measured, and 9 are fitted: an amplitude for each of 6 targets, a gain for the second harmonic, and a
    phase for each harmonic."""
    seen = observed(pixels=1, truth=({}, {}))

    def misfits(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        gain, phases = np.array([1.0, numbers[6]]), numbers[7:]
        theta = np.stack([h * seen.phase[:, 0] + phase for h, phase in zip(HARMONICS, phases, strict=True)], axis=1)
        left = seen.volts[:, :, 0] - numbers[:6, np.newaxis] * gain * np.exp(1j * theta)
        return np.asarray(left.ravel().view(np.float64) / 1e-4)

    best = optimize.least_squares(misfits, [*np.abs(seen.volts[:, 0, 0]), 1.0, 0.0, 0.0])
    found = fit_terms(seen, ({}, {}), distances=6)
    assert not orders(found)
    assert found.residual == pytest.approx(np.sqrt(2.0 * best.cost / (24 - 9)), rel=0.01)


def test_terms_are_added_to_those_of_the_waveform() -> None:
    base = ({-3: 1 / 9 + 0j}, {-3: 1 / 9 + 0j})
    imbalance = ({-1: 0.02j}, {-1: 0.01 + 0j})
    truth = tuple(composed(one, change) for one, change in zip(base, imbalance, strict=True))
    found = fit_terms(observed(truth=truth), base, distances=6)
    for found_terms, true_terms in zip(found.terms, truth, strict=True):
        assert found_terms.keys() == true_terms.keys()
        for k, value in true_terms.items():
            assert abs(found_terms[k] - value) < 3e-4


def test_noise_alone_leaves_out_none_of_thousands_of_pixels() -> None:
    """One pixel in a million has a root of the misfit beyond five deviations; one in a thousand has such a misfit."""
    assert fit_terms(observed(pixels=6000, targets=4), ({}, {}), distances=4).kept.all()


ERRORS = 3e-3 * np.array([1.0, -1.0, 0.5, 1.5, -1.2, -0.8])
"""Errors of the distances of six targets, in rad; their mean is 0."""


@pytest.mark.parametrize("truth", [({-1: 0.02 + 0j}, {-1: 0.02 + 0j}), ({-1: 0.02 + 0j, 3: 0.01 + 0j},) * 2])
def test_wrong_distances_are_no_terms(truth: Terms) -> None:
    """Errors of 3 mm look like terms of every order, but errors of the distances explain the targets better."""
    exact = observed(truth=truth, pixels=1500)
    found = fit_terms(replace(exact, phase=exact.phase + ERRORS[:, np.newaxis]), ({}, {}), distances=6)
    assert orders(found) == set(truth[0])
    assert found.terms[0][-1] == pytest.approx(truth[0][-1], abs=1e-4)
    assert found.residual == pytest.approx(1.0, abs=0.03)
    assert found.stretch is not None
    ways = exact.phase.mean(axis=1) + ERRORS
    np.testing.assert_allclose(ways * (found.stretch - 1.0), -ERRORS, atol=4e-4)


def test_right_distances_are_not_doubted() -> None:
    assert all(fit_terms(observed(seed=seed), ({}, {}), distances=6).stretch is None for seed in range(8))
