"""The compiled search, weights and scans receive the problem unchanged, and their answer is returned unchanged."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.likelihood import levenberg_marquardt, mixture, starts
from cadtof_cli.resolver.likelihood.compiled import Minimum, Planes, Scanned
from cadtof_cli.resolver.likelihood.levenberg_marquardt import Compilable, LevenbergMarquardt
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from tests.support.mixtures import noise_of

HARMONICS, COUNT, OTHER_KERNEL = (1, 2, 4), 5, "elsewhere"

SOLVER = LevenbergMarquardt(max_steps=17, relative=0.02, absolute=0.3, first_damping=0.005)


def by_kernel(name: str, function: Callable[..., Any], *given: Any, **options: Any) -> Any:
    """Return the result of a function that takes the kernel of this name, which need not exist, for the chosen one."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (levenberg_marquardt, mixture, starts):
            patch.setattr(module, "chosen_kernel", lambda: name)
        return function(*given, **options)


class Recorder:
    """Stands in for a compiled function: it records the arguments of the call and returns a fixed answer."""

    def __init__(self, answer: Any) -> None:
        self.call: tuple[tuple[Any, ...], dict[str, Any]] = (), {}
        self._answer = answer

    def __call__(self, *given: Any, **options: Any) -> Any:
        self.call = given, options
        return self._answer


def measured() -> Measured:
    re, im = 0.1 * np.random.default_rng(1).normal(size=(2, len(HARMONICS), COUNT))
    return Measured(HARMONICS, re, im)


def paths() -> Mixture:
    phase = np.array([[0.5], [2.0]]) + np.linspace(0.0, 1.0, COUNT)
    return Mixture(np.full((2, COUNT), 0.2), np.cos(phase), np.sin(phase))


def problems() -> dict[str, tuple[Compilable, Float, Planes]]:
    """Return each kind of problem with its starts and the planes that the compiled search must receive."""
    seen, light = measured(), paths()
    white = np.array([3.0, 2.0, 1.0])
    weighted = by_kernel(NUMPY, WeightedFit.around, seen, light, noise=noise_of(HARMONICS, n_av=1e4))
    return {
        "white": (WhiteFit(seen, (3.0, 2.0, 1.0)), light.points, Planes(0, 2, HARMONICS, seen.re, seen.im, white)),
        "weighted": (weighted, light.points, Planes(1, 2, HARMONICS, seen.re, seen.im, weighted.weights)),
    }


@pytest.mark.parametrize("kind", ["white", "weighted"])
def test_the_compiled_search_receives_the_problem_unchanged(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, begins, planes = problems()[kind]
    ends = Minimum(begins + 1.0, np.ones(COUNT), np.ones((3, COUNT)), np.ones(COUNT, bool), np.arange(COUNT))
    recorder = Recorder(ends)
    monkeypatch.setattr(levenberg_marquardt, "compiled_ends", recorder)
    samples = np.linspace(1.0, 3.0, COUNT)
    found = by_kernel(OTHER_KERNEL, SOLVER.solve, problem, begins, samples=samples)
    (given, given_starts), options = recorder.call
    assert (given.kind, given.paths, given.harmonics) == (planes.kind, planes.paths, planes.harmonics)
    for received, sent in ((given.re, planes.re), (given.im, planes.im), (given_starts, begins)):
        np.testing.assert_array_equal(received, sent)
    np.testing.assert_array_equal(given.weights, planes.weights)
    np.testing.assert_allclose(options.pop("worth"), 0.3 / samples)
    assert options == {"most_steps": 17, "relative": 0.02, "first_damping": 0.005, "kernel": OTHER_KERNEL}
    assert found.points is ends.points
    assert found.cost is ends.cost
    assert found.matrix is ends.matrix
    assert found.converged is ends.converged
    assert found.steps is ends.steps


@pytest.mark.parametrize("kind", ["white", "weighted"])
def test_numpy_searches_if_the_compiled_search_declines(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, begins, _ = problems()[kind]
    recorder = Recorder(None)
    monkeypatch.setattr(levenberg_marquardt, "compiled_ends", recorder)
    unaided, expected = (by_kernel(kernel, SOLVER.solve, problem, begins) for kernel in (OTHER_KERNEL, NUMPY))
    assert recorder.call[0]
    np.testing.assert_array_equal(unaided.points, expected.points)
    np.testing.assert_array_equal(unaided.steps, expected.steps)


def test_the_compiled_weights_receive_the_paths_and_their_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    noise, answer = noise_of(HARMONICS, n_av=1e4), np.ones((3, len(HARMONICS), COUNT))
    recorder = Recorder(answer)
    monkeypatch.setattr(mixture, "compiled_weights", recorder)
    fit = by_kernel(OTHER_KERNEL, WeightedFit.around, measured(), paths(), noise=noise)
    assert fit.weights is answer
    (points,), options = recorder.call
    np.testing.assert_array_equal(points, paths().points)
    np.testing.assert_array_equal(options.pop("noise"), [one.covariance_terms for one in noise.each])
    assert options == {"harmonics": HARMONICS, "kernel": OTHER_KERNEL}
    monkeypatch.setattr(mixture, "compiled_weights", Recorder(None))
    unaided, expected = (
        by_kernel(kernel, WeightedFit.around, measured(), paths(), noise=noise).weights
        for kernel in (OTHER_KERNEL, NUMPY)
    )
    np.testing.assert_array_equal(unaided, expected)


@pytest.mark.parametrize("pairs", [False, True])
def test_the_compiled_scan_receives_its_grid(pairs: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The grid has 32 places per turn, eight per period of harmonic 4. Its lags go up to half a turn."""
    seen, weights, answer = measured(), (3.0, 2.0, 1.0), Scanned.empty(COUNT)
    recorder = Recorder(answer)
    monkeypatch.setattr(starts, "compiled_scan", recorder)
    assert by_kernel(OTHER_KERNEL, starts.scanned, seen, weights=weights, pairs=pairs) is answer
    (factors, lags, re, im), options = recorder.call
    turn = 2.0 * np.pi * np.arange(32)[:, np.newaxis] / 32
    waves = np.array(weights) * np.exp(1j * np.array(HARMONICS) * turn)
    np.testing.assert_allclose(factors, np.stack([waves.real, waves.imag], axis=-1), atol=1e-12)
    rho = (waves.real[1:17] / sum(weights)).sum(axis=1)
    np.testing.assert_allclose(lags, np.stack([rho, -2.0 * rho, 1.0 / (1.0 - rho**2)], axis=1), atol=1e-12)
    assert re is seen.re
    assert im is seen.im
    assert options == {"harmonics": HARMONICS, "pairs": pairs, "kernel": OTHER_KERNEL}
    monkeypatch.setattr(starts, "compiled_scan", Recorder(None))
    unaided, expected = (
        by_kernel(one, starts.scanned, seen, weights=weights, pairs=pairs) for one in (OTHER_KERNEL, NUMPY)
    )
    np.testing.assert_array_equal(unaided.first, expected.first)
    np.testing.assert_array_equal(unaided.peak, expected.peak)
