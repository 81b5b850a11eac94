"""One path of a sine by maximum likelihood: its misfit, its scatter, and the pixels that it may fit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold, noise_model
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame
from cadtof_cli.resolver.two_path.one_path import OnePath, one_path
from cadtof_cli.resolver.two_path.solver import may_be_one_path
from tests.support.forward import Light, phasors_of


def noise_of(n_av: float) -> NoiseModel:
    return noise_model(CaptureMetadata(), integration_length=n_av, quantised=False)


def fit(light: Light, n_av: float, size: int, *, steps: int, seed: int = 1) -> OnePath:
    p = phasors_of(light.voltages(np.random.default_rng(seed), n_av, size))
    return one_path(fundamental_frame(p[0], p[1]), noise=noise_of(n_av), steps=steps)


@pytest.mark.parametrize("steps", [0, 6])
@pytest.mark.parametrize(("asr", "n_av"), [(5.0, 1e5), (0.1, 1e5), (0.5, 1e4), (5.0, 3e3)])
def test_the_misfit_of_one_path_is_chi_squared_with_two_degrees_of_freedom(asr: float, n_av: float, steps: int) -> None:
    chi_squared = fit(Light(asr), n_av, 40_000, steps=steps).chi_squared
    assert chi_squared.mean() == pytest.approx(2.0, abs=0.05)
    for false_alarm in (0.1, 0.01):
        share = np.mean(chi_squared > chi_squared_threshold(false_alarm, pairs=1))
        assert share == pytest.approx(false_alarm, abs=4 * math.sqrt(false_alarm / 40_000))


@pytest.mark.parametrize("steps", [0, 6])
@pytest.mark.parametrize(("asr", "n_av"), [(5.0, 1e5), (8.0, 1e4), (2.0, 1e4)])
def test_the_phase_scatters_as_predicted_and_less_than_half_as_much_as_the_first_phasor(
    asr: float, n_av: float, steps: int
) -> None:
    light = Light(asr, direct_ns=7.0)
    found = fit(light, n_av, 20_000, steps=steps)
    phase = np.angle(found.cos + 1j * found.sin)
    assert np.median(found.sigma_rad) == pytest.approx(phase.std(), rel=0.03)
    assert phase.mean() == pytest.approx(2 * np.pi * 7.0 / 40.0, abs=5 * phase.std() / math.sqrt(20_000))
    first = np.angle(phasors_of(light.voltages(np.random.default_rng(1), n_av, 20_000))[0])
    assert 0.36 < phase.std() / first.std() < 0.5


@pytest.mark.parametrize(("asr", "n_av"), [(0.0, 1e5), (0.05, 1e5), (0.3, 1e4), (1.0, 1e5), (5.0, 3e3)])
def test_sigma_is_the_scatter_of_the_phase_with_little_or_no_ambient_light(asr: float, n_av: float) -> None:
    """Without ambient light, the second harmonic has more noise than its weight in the fit stands for."""
    found = fit(Light(asr, direct_ns=7.0), n_av, 40_000, steps=6)
    assert np.median(found.sigma_rad) == pytest.approx(np.angle(found.cos + 1j * found.sin).std(), rel=0.02)


def test_the_likelihood_is_the_largest_of_all_phases() -> None:
    rng = np.random.default_rng(5)
    size = 4000
    strength = 10.0 ** rng.uniform(-2, 2, size)
    p1 = np.exp(1j * rng.uniform(0, 2 * np.pi, size))
    p2 = strength * np.exp(1j * rng.uniform(0, 2 * np.pi, size))
    noise = noise_of(1e5)
    weight = noise.each[0].dark_variance / noise.each[1].dark_variance
    found = one_path(fundamental_frame(p1, p2), noise=noise, steps=6)
    rotor = found.cos - 1j * found.sin
    reached = (p1 * rotor).real + weight * (p2 * rotor**2).real
    grid = np.exp(-2j * np.pi * np.arange(4096) / 4096)[:, np.newaxis]
    best = ((p1 * grid).real + weight * (p2 * grid**2).real).max(axis=0)
    off = np.abs(best - reached) / (1 + strength)
    assert np.max(off) < 2e-4  # antipodal phasors have two nearly equal maxima
    assert np.mean(off > 1e-5) < 2e-3


@pytest.mark.parametrize("second_floor", [0.0, 1e-3])
def test_every_pixel_that_one_path_fits_may_be_one_path(second_floor: float) -> None:
    """This holds even if one harmonic has much more noise than the other."""
    p = phasors_of(Light(5.0).voltages(np.random.default_rng(2), 1e5, 20_000))
    first, second = noise_of(1e5).each
    noise = replace(noise_of(1e5), each=(first, replace(second, floor=second_floor)))
    p[1] += np.random.default_rng(3).normal(0.0, math.sqrt(second_floor), (2, 20_000)).T @ np.array([1.0, 1j])
    frame = fundamental_frame(p[0], p[1])
    fits = one_path(frame, noise=noise, steps=6).chi_squared
    for limit in (2.0, 9.2, 20.0):
        may_be = may_be_one_path(frame, limit, noise=noise)
        assert may_be[fits <= limit].all()


@pytest.mark.parametrize("amplitude", [1e-3, 0.2, 1.0])
def test_noiseless_phasors_are_fitted_exactly(amplitude: float) -> None:
    phase = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    rotor = np.exp(1j * phase)
    found = one_path(fundamental_frame(amplitude * rotor, amplitude * rotor**2), noise=noise_of(1e5), steps=6)
    np.testing.assert_allclose(found.cos + 1j * found.sin, rotor, atol=1e-14)
    np.testing.assert_allclose(found.amplitude, amplitude, rtol=1e-14)
    assert found.chi_squared.max() < 1e-20


def test_nan_stays_nan_and_inputs_are_not_changed() -> None:
    p1, p2 = np.array([np.nan, 0.3 + 0j]), np.array([0.3 + 0j, 0.3j])
    before = p1.copy(), p2.copy()
    found = one_path(fundamental_frame(p1, p2), noise=noise_of(1e5), steps=1)
    assert np.isnan(found.chi_squared[0])
    assert np.isfinite(found.chi_squared[1])
    np.testing.assert_array_equal(p1, before[0])
    np.testing.assert_array_equal(p2, before[1])
