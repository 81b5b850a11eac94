"""The points where a search of the likelihood begins, and the moduli and powers that are known before it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cadtof_cli.resolver.likelihood.mixture import Measured
from cadtof_cli.resolver.likelihood.solver import Likelihood
from cadtof_cli.resolver.likelihood.starts import best_pair, exact_start, strongest_path
from tests.support.forward import T1_NS
from tests.support.mixtures import Mixture, noise_of

HARMONICS = (1, 2, 3)
STEPS = 24
"""Delays of the grid per turn: eight per period of the highest harmonic."""


@pytest.mark.parametrize("place", range(0, STEPS, 5))
@pytest.mark.parametrize("weights", [(1.0, 1.0, 1.0), (1e5, 3e4, 2e3)])
def test_a_single_path_on_the_grid_is_found_as_the_strongest_path(place: int, weights: tuple[float, ...]) -> None:
    problem = Mixture((1.0,), (place / STEPS * T1_NS,), asr=2.0)
    found = strongest_path(Measured.of_phasors(problem.exact(HARMONICS), harmonics=HARMONICS), weights=weights)
    assert_allclose(found.amplitude[0], 1.0 / 3.0, rtol=1e-12)
    assert_allclose(found.cos[0] + 1j * found.sin[0], np.exp(2j * np.pi * place / STEPS), atol=1e-12)


@pytest.mark.parametrize(("steps", "fine"), [(STEPS, False), (2 * STEPS, True)])
def test_two_paths_on_the_grid_are_found_as_the_best_pair(steps: int, fine: bool) -> None:
    problem, weights = Mixture((1.0, 0.5), (3 / steps * T1_NS, 11 / steps * T1_NS), asr=1.5), (5.0, 2.0, 1.0)
    found = best_pair(Measured.of_phasors(problem.exact(HARMONICS), harmonics=HARMONICS), weights=weights, fine=fine)
    assert_allclose(found.amplitude[:, 0], np.array([1.0, 0.5]) / 3.0, rtol=1e-9)
    assert_allclose(np.angle(found.cos + 1j * found.sin)[:, 0], 2 * np.pi * np.array([3, 11]) / steps, atol=1e-9)


def test_three_paths_begin_where_the_first_three_harmonics_have_them_exactly() -> None:
    harmonics, times_ns = (1, 2, 3, 5), np.array([4.0, 9.0, 21.0])
    problem = Mixture((1.0, 0.6, 0.3), tuple(times_ns), asr=1.1)
    found = exact_start(Measured.of_phasors(problem.exact(harmonics), harmonics=harmonics), paths=3)
    assert found is not None
    order = np.argsort(-found.amplitude[:, 0])
    assert_allclose(found.amplitude[order, 0], np.array([1.0, 0.6, 0.3]) / 3.0, rtol=1e-6)
    turn = (found.cos + 1j * found.sin)[order, 0]
    assert_allclose(turn, np.exp(2j * np.pi * times_ns / T1_NS), atol=1e-6)


def test_the_confidence_is_the_length_of_the_fundamental_and_every_harmonic_has_its_power() -> None:
    exact = Mixture((1.0, 0.8), (5.0, 14.0)).exact(HARMONICS, 3)
    solver = Likelihood(exact, noise=noise_of(HARMONICS, n_av=1e5))
    assert_allclose(solver.modulus, np.abs(exact[0]))
    assert_allclose(solver.powers, np.abs(exact) ** 2)
