"""One path under a triangle's response, compared with scipy's least squares on the exact series."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation
from cadtof_cli.phasors.noise import NoiseModel, noise_model
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.resolver.response.one_path import angle_of, one_path_of_response
from cadtof_cli.resolver.response.table import response_block
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame
from cadtof_cli.resolver.two_path.one_path import OnePath, one_path

METADATA = CaptureMetadata(modulation=Modulation(waveform="triangle"))

RESPONSES: tuple[HarmonicResponse, ...] = tuple(ideal_response(METADATA))

PIXELS = 60

PIXEL_PHASES = np.random.default_rng(9).normal(0.0, 0.3, (2, PIXELS))
"""Phase that each pixel adds to its paths, rad, (2, n)."""


def noise_of(n_av: float) -> NoiseModel:
    return noise_model(METADATA, integration_length=n_av, quantised=False)


def answer(response: HarmonicResponse, phase: Float, pixel_phase: Float | float) -> Complex:
    theta = response.harmonic * phase + pixel_phase
    return np.asarray(response.without_mirror(response.at(theta)) * np.exp(-1j * np.asarray(pixel_phase)))


def drawn(n_av: float, *, with_phases: bool, misfit: float = 0.0, seed: int = 1) -> tuple[Float, Float, Complex]:
    """Return amplitudes and phases of paths, and their noisy phasors; `misfit` shortens those of harmonic 2."""
    rng = np.random.default_rng(seed)
    amplitude, phase = rng.uniform(0.1, 0.4, PIXELS), rng.uniform(0.0, 2.0 * np.pi, PIXELS)
    clean = [
        amplitude * answer(one, phase, PIXEL_PHASES[row] if with_phases else 0.0) for row, one in enumerate(RESPONSES)
    ]
    clean[1] = clean[1] * (1.0 - misfit)
    sigma = [np.sqrt(one.dark_variance) for one in noise_of(n_av).each]
    noise = [s * (rng.normal(size=PIXELS) + 1j * rng.normal(size=PIXELS)) for s in sigma]
    return amplitude, phase, np.stack([p + e for p, e in zip(clean, noise, strict=True)])


def fitted(p: Complex, n_av: float, *, with_phases: bool, steps: int = 4) -> OnePath:
    model = response_block(RESPONSES, PIXEL_PHASES if with_phases else None)
    start = one_path(fundamental_frame(p[0], p[1]), noise=noise_of(n_av), steps=3)
    return one_path_of_response(start, p, response=model.block(slice(0, PIXELS)), noise=noise_of(n_av), steps=steps)


def phase_error(found: OnePath, phase: Float) -> Float:
    return np.asarray(np.angle((found.cos + 1j * found.sin) * np.exp(-1j * phase)))


@pytest.mark.parametrize("with_phases", [False, True])
def test_a_path_without_noise_is_found_exactly(with_phases: bool) -> None:
    amplitude, phase, p = drawn(1e12, with_phases=with_phases)
    found = fitted(p, 1e5, with_phases=with_phases)
    assert_allclose(phase_error(found, phase), 0.0, atol=2e-5)
    assert_allclose(found.amplitude, amplitude, rtol=2e-5)
    assert_allclose(found.chi_squared, 0.0, atol=1e-3)
    assert_allclose(found.cos**2 + found.sin**2, 1.0)


@pytest.mark.parametrize("with_phases", [False, True])
def test_the_path_is_that_of_scipy_s_least_squares_along_and_across_each_phasor(with_phases: bool) -> None:
    n_av = 1e4
    _, phase, p = drawn(n_av, with_phases=with_phases, misfit=0.02)
    found, noise = fitted(p, n_av, with_phases=with_phases), noise_of(n_av)
    for pixel in range(0, PIXELS, 4):
        each = [one.one_path_variances(np.array([found.amplitude[pixel]])) for one in noise.each]

        def residuals(values: Float, pixel: int = pixel, each: list[tuple[Float, Float]] = each) -> Float:
            parts: list[float] = []
            for row, (response, (along, across)) in enumerate(zip(RESPONSES, each, strict=True)):
                f = complex(answer(response, np.array(values[1]), PIXEL_PHASES[row, pixel] if with_phases else 0.0))
                turned = (p[row, pixel] - values[0] * f) * np.exp(-1j * np.angle(f))
                parts += [turned.real / np.sqrt(along[0]), turned.imag / np.sqrt(across[0])]
            return np.array(parts)

        best = least_squares(residuals, [found.amplitude[pixel], phase[pixel]], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        sigma = np.sqrt(np.linalg.inv(best.jac.T @ best.jac)[1, 1])
        assert abs(phase_error(found, np.array(best.x[1]))[pixel]) < 0.1 * sigma
        assert_allclose(found.amplitude[pixel], best.x[0], rtol=1e-3)
        assert_allclose(found.sigma_rad[pixel], sigma, rtol=0.06)
        assert_allclose(found.chi_squared[pixel], 2.0 * best.cost, rtol=0.05, atol=0.05)


@pytest.mark.parametrize("misfit", [-0.05, 0.05])
def test_the_fall_off_is_the_signed_chi_squared_of_the_length_of_the_second_phasor(misfit: float) -> None:
    """It is positive if the second phasor is shorter than the path predicts, and negative if it is longer."""
    n_av = 1e5
    _, phase, p = drawn(1e12, with_phases=False, misfit=misfit)
    found, noise = fitted(p, n_av, with_phases=False), noise_of(n_av)
    difference, variance = np.zeros(PIXELS), np.zeros(PIXELS)
    for row, (response, sign) in enumerate(zip(RESPONSES, (1.0, -1.0), strict=True)):
        f = answer(response, phase + phase_error(found, phase), 0.0)
        difference += sign * (p[row] / f).real
        variance += noise.each[row].one_path_variances(found.amplitude)[0] / np.abs(f) ** 2
    assert_allclose(found.fall_off, np.sign(difference) * difference**2 / variance, rtol=0.02)
    assert (np.sign(found.fall_off) == np.sign(misfit)).all()


@pytest.mark.parametrize(("n_av", "off_rad"), [(1e4, 0.02), (1e5, 0.01)])
def test_chi_squared_and_the_fall_off_are_computed_after_the_last_step(n_av: float, off_rad: float) -> None:
    _, phase, p = drawn(n_av, with_phases=False)
    begin_rad = phase + off_rad
    start = OnePath(np.full(PIXELS, 0.25), np.cos(begin_rad), np.sin(begin_rad), *(np.ones(PIXELS) for _ in range(3)))
    block, noise = response_block(RESPONSES, None).block(slice(None)), noise_of(n_av)
    one, many = (one_path_of_response(start, p, response=block, noise=noise, steps=steps) for steps in (1, 6))
    for found, after in ((one.chi_squared, many.chi_squared), (one.fall_off, many.fall_off)):
        assert_allclose(found, after, rtol=0.2, atol=0.2)


def test_nan_stays_nan_and_a_rotor_s_angle_is_within_half_a_turn() -> None:
    _, _, p = drawn(1e5, with_phases=False)
    p[0, 3] = np.nan
    found = fitted(p, 1e5, with_phases=False)
    assert np.flatnonzero(np.isnan(found.amplitude)).tolist() == [3]
    angle = np.array([-3.0, -1.0, 0.5, 3.1])
    assert_allclose(angle_of(np.cos(angle), np.sin(angle)), angle, rtol=1e-6)


def test_a_step_turns_a_path_by_less_than_half_a_radian() -> None:
    """From a start that is .9 rad off, one step turns the path by at most .4 rad, in either direction."""
    _, phase, p = drawn(1e12, with_phases=False)
    model = response_block(RESPONSES, None)
    begin_rad = phase + 0.9
    start = OnePath(np.full(PIXELS, 0.25), np.cos(begin_rad), np.sin(begin_rad), *(np.ones(PIXELS) for _ in range(3)))
    block = model.block(slice(None))
    turned = phase_error(one_path_of_response(start, p, response=block, noise=noise_of(1e5), steps=1), begin_rad)
    assert np.abs(turned).max() < 0.4 + 1e-5
    assert (np.abs(np.abs(turned) - 0.4) < 1e-5).any()


def test_a_step_from_the_opposite_phase_leaves_no_amplitude_below_0() -> None:
    _, phase, p = drawn(1e12, with_phases=False)
    start = OnePath(np.full(PIXELS, 0.25), -np.cos(phase), -np.sin(phase), *(np.ones(PIXELS) for _ in range(3)))
    block = response_block(RESPONSES, None).block(slice(None))
    found = one_path_of_response(start, p, response=block, noise=noise_of(1e5), steps=1)
    assert found.amplitude.min() == 0.0
