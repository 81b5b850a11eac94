"""The scatter of Table 1 of the paper, and predicted standard deviations against the observed scatter."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.phasors.noise import HarmonicNoise, NoiseModel, noise_model
from cadtof_cli.resolver.two_path.closed_form import TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.uncertainty import two_path_sigmas
from tests.support.forward import Light, ns_from_rad, phasors_of

# ASR 5, MPI ratio 0.3, n_av 1e5. Each row, in ns: delay of the second path, then the standard deviations of direct and
# second path: the Cramér–Rao bounds of docs/physics.md, and the values of the paper
TABLE_1 = [
    (16.0, (0.049, 0.165), (0.05, 0.16)),
    (25.0, (0.032, 0.107), (0.03, 0.12)),
    (11.0, (0.157, 0.510), (0.17, 0.52)),
]


def solve(light: Light, n_av: float | tuple[float, float], size: int) -> tuple[TwoPaths, NDArray[np.float64]]:
    each = n_av if isinstance(n_av, tuple) else (n_av, n_av)
    volts = np.stack([light.voltages(np.random.default_rng(12), length, size)[row] for row, length in enumerate(each)])
    p = phasors_of(volts)
    paths = two_paths(fundamental_frame(p[0], p[1]))
    return paths, two_path_sigmas(paths, noise=noise_model(CaptureMetadata(), integration_length=n_av, quantised=False))


def delays_ns(paths: TwoPaths, sigmas: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the delays of the stronger and the weaker path, then their predicted standard deviations."""
    x, y = (
        ns_from_rad(np.arctan2(s, c) % (2 * np.pi)) for c, s in ((paths.cos_x, paths.sin_x), (paths.cos_y, paths.sin_y))
    )
    strong = paths.a > paths.b
    sx, sy = map(ns_from_rad, sigmas)
    return np.where(strong, x, y), np.where(strong, y, x), np.where(strong, sx, sy), np.where(strong, sy, sx)


@pytest.mark.parametrize(("second_ns", "bounds", "paper"), TABLE_1)
def test_400_solves_reach_the_bound_and_table_1(
    second_ns: float, bounds: tuple[float, float], paper: tuple[float, float]
) -> None:
    paths, sigmas = solve(Light(5.0, 0.3, 5.0, second_ns), 1e5, 400)
    direct, second, *_ = delays_ns(paths, sigmas)
    for delays, true, bound, published in zip((direct, second), (5.0, second_ns), bounds, paper, strict=True):
        assert delays.std() == pytest.approx(bound, rel=0.15)
        assert delays.std() == pytest.approx(published, rel=0.15, abs=0.005)
        assert abs(delays.mean() - true) < 0.15 * bound + 4 * bound / 20


@pytest.mark.parametrize("second_ns", [16.0, 25.0, 11.0])
def test_predicted_sigma_is_the_observed_scatter_in_table_1(second_ns: float) -> None:
    direct, second, sigma_direct, sigma_second = delays_ns(*solve(Light(5.0, 0.3, 5.0, second_ns), 1e5, 4000))
    assert 0.95 < np.median(sigma_direct) / direct.std() < 1.05
    assert 0.95 < np.median(sigma_second) / second.std() < 1.05


@pytest.mark.parametrize(
    "light", [Light(0.0, 0.3), Light(0.3, 0.3), Light(0.5, 0.5, 5.0, 14.0), Light(2.0, 0.6, 30.0, 38.0)]
)
def test_predicted_sigma_is_the_observed_scatter_if_the_noise_is_far_from_white(light: Light) -> None:
    direct, second, sigma_direct, sigma_second = delays_ns(*solve(light, 1e5, 4000))
    assert 0.94 < np.median(sigma_direct) / direct.std() < 1.06
    assert 0.94 < np.median(sigma_second) / second.std() < 1.06


@pytest.mark.parametrize("light", [Light(0.0, 0.3), Light(0.5, 0.5, 5.0, 14.0), Light(5.0, 0.3)])
@pytest.mark.parametrize("lengths", [(1e6, 1e5), (1e5, 1e6)])
def test_predicted_sigma_is_the_observed_scatter_if_each_harmonic_has_a_length_of_its_own(
    light: Light, lengths: tuple[float, float]
) -> None:
    direct, second, sigma_direct, sigma_second = delays_ns(*solve(light, lengths, 4000))
    assert 0.94 < np.median(sigma_direct) / direct.std() < 1.06
    assert 0.94 < np.median(sigma_second) / second.std() < 1.06


def test_white_noise_gives_the_formula_of_the_bound() -> None:
    sigma, a, b = 1e-3, 0.4, 0.1
    first, second = (
        HarmonicNoise(harmonic=h, averaging=0.0, pulse=1.0, pulse_double=1.0, floor=sigma**2) for h in (1, 2)
    )
    gap = np.linspace(0.2, 2 * np.pi - 0.2, 40)
    p = [a + b * np.exp(1j * h * gap) for h in (1, 2)]
    paths = two_paths(fundamental_frame(*p))
    x, y = two_path_sigmas(paths, noise=NoiseModel((first, second), np.inf, estimated=False))
    c = np.cos(gap)
    bound = sigma * np.sqrt(13 + 20 * c + 12 * c**2) / (2 * (1 - c) * (2 + c))
    strong = paths.a > paths.b
    np.testing.assert_allclose(np.where(strong, x, y), bound / a, rtol=1e-4)
    np.testing.assert_allclose(np.where(strong, y, x), bound / b, rtol=1e-4)


def test_a_vanishing_path_has_no_finite_sigma() -> None:
    with np.errstate(divide="ignore", invalid="ignore"):
        paths = two_paths(fundamental_frame(np.array([0.5 + 0j]), np.array([0.5 + 0j])))
        sigmas = two_path_sigmas(paths, noise=noise_model(CaptureMetadata(), integration_length=1e5, quantised=False))
    assert not np.isfinite(np.concatenate(sigmas)).any()


def test_amplitudes_that_exceed_all_light_have_the_noise_of_all_light() -> None:
    """Noise can make a + b larger than 1. Such amplitudes had a sigma of 0."""
    gap, noise = np.linspace(0.3, np.pi, 50), noise_model(CaptureMetadata(), integration_length=300.0, quantised=False)
    all_light = np.array([0.96 + 0.04 * np.exp(1j * h * gap) for h in (1, 2)])
    possible = two_path_sigmas(two_paths(fundamental_frame(*all_light)), noise=noise)
    beyond = two_path_sigmas(two_paths(fundamental_frame(*(1.2 * all_light))), noise=noise)
    assert (possible > 0.0).all()
    np.testing.assert_allclose(beyond, possible / 1.2, rtol=1e-3)
