"""Pisarenko's decomposition finds as many paths as there are harmonics, exactly."""

import numpy as np
import pytest

from cadtof_cli.resolver.likelihood.pisarenko import pisarenko, strongest_of
from tests.support.mixtures import Mixture


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_as_many_paths_as_harmonics_are_found_exactly(count: int) -> None:
    rng = np.random.default_rng(count)
    gaps = rng.uniform(0.5, 1.0, (count, 500))
    phases = 2 * np.pi * (np.cumsum(gaps, axis=0) / gaps.sum(axis=0) + rng.uniform(size=500))
    amplitudes = rng.uniform(0.1, 1.0, (count, 500))
    phasors = np.stack([(amplitudes * np.exp(1j * h * phases)).sum(axis=0) for h in range(1, count + 1)])
    found = pisarenko(phasors)
    rotors = found.cos + 1j * found.sin
    order = np.argsort(np.angle(rotors), axis=0)
    true_order = np.argsort(np.angle(np.exp(1j * phases)), axis=0)
    np.testing.assert_allclose(
        np.take_along_axis(found.amplitude, order, 0), np.take_along_axis(amplitudes, true_order, 0), rtol=1e-6
    )
    np.testing.assert_allclose(
        np.take_along_axis(rotors, order, 0), np.take_along_axis(np.exp(1j * phases), true_order, 0), atol=1e-7
    )


def test_fewer_paths_than_harmonics_are_among_the_strongest() -> None:
    problem = Mixture((1.0, 0.4), (5.0, 16.0))
    found = strongest_of(pisarenko(problem.exact((1, 2, 3, 4))), 2)
    np.testing.assert_allclose(found.amplitude[:, 0], problem.shares, rtol=1e-5)
    np.testing.assert_allclose(found.cos[:, 0] + 1j * found.sin[:, 0], np.exp(1j * problem.phases), atol=1e-5)


def test_phasors_of_0_and_nan_have_amplitudes_of_0() -> None:
    phasors = np.zeros((3, 2), np.complex128)
    phasors[1, 1] = np.nan
    np.testing.assert_allclose(pisarenko(phasors).amplitude, 0.0, atol=1e-12)


def test_no_amplitude_is_negative() -> None:
    """Any phasors are a sum of as many paths as harmonics, with amplitudes of 0 or more (Carathéodory 1911)."""
    rng = np.random.default_rng(3)
    phasors = 0.02 * (rng.normal(size=(3, 300)) + 1j * rng.normal(size=(3, 300))) + 0.3
    assert (pisarenko(np.asarray(phasors, np.complex128)).amplitude >= 0.0).all()
