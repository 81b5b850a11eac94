"""The compiled search, weights and scans receive the problem unchanged, and what they fill in is the answer."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.kernels import NUMPY
from cadtof_cli.resolver.likelihood import levenberg_marquardt, mixture, starts
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from tests.support.kernels import by_kernel
from tests.support.mixtures import noise_of

HARMONICS, COUNT, OTHER_KERNEL = (1, 2, 4), 5, "elsewhere"

SOLVER = LevenbergMarquardt(max_steps=17, relative=0.02, absolute=0.3, first_damping=0.005)


def handed_over(name: str, function: Callable[..., Any], *given: Any, **options: Any) -> tuple[Any, list[Any]]:
    """Return the result of a function, and the arguments of its call of the compiled function of this name.

    The compiled function is replaced by one that fills the last array with 7, which is True in an array of bool.
    """
    call: list[Any] = []

    def compiled(*arguments: Any) -> None:
        call.extend(arguments)
        arguments[-1].fill(7)

    with pytest.MonkeyPatch.context() as patch:
        for module in (levenberg_marquardt, mixture, starts):
            patch.setattr(module, "chosen_kernel", lambda: OTHER_KERNEL)
            patch.setattr(module, "compiled_search", lambda *_, **__: SimpleNamespace(**{name: compiled}))
        return function(*given, **options), call


def measured() -> Measured:
    re, im = 0.1 * np.random.default_rng(1).normal(size=(2, len(HARMONICS), COUNT))
    return Measured(HARMONICS, re, im)


def paths() -> Mixture:
    phase = np.array([[0.5], [2.0]]) + np.linspace(0.0, 1.0, COUNT)
    return Mixture(np.full((2, COUNT), 0.2), np.cos(phase), np.sin(phase))


def problem(kind: str) -> tuple[WhiteFit | WeightedFit, Float]:
    """Return a problem, and the weights that the compiled search must receive."""
    if kind == "white":
        return WhiteFit(measured(), (3.0, 2.0, 1.0)), np.array([3.0, 2.0, 1.0])
    weighted = by_kernel(NUMPY, WeightedFit.around, measured(), paths(), noise=noise_of(HARMONICS, n_av=1e4))
    return weighted, weighted.weights


@pytest.mark.parametrize(("number", "kind"), [(0, "white"), (1, "weighted")])
def test_the_compiled_search_receives_the_problem_unchanged(number: int, kind: str) -> None:
    given, weights = problem(kind)
    samples, begins = np.linspace(1.0, 3.0, COUNT), paths().points
    found, call = handed_over("solve", SOLVER.solve, given, begins, samples=samples)
    assert call[:6] == [OTHER_KERNEL, number, 2, 17, 0.02, 0.005]
    expected: tuple[Any, ...] = (HARMONICS, measured().re, measured().im, weights, begins, 0.3 / samples)
    for received, sent in zip(call[6:12], expected, strict=True):
        np.testing.assert_allclose(received, sent, rtol=1e-15)
    assert [id(part) for part in call[12:]] == [id(part) for part in vars(found).values()]
    assert found.converged.all()


def test_the_compiled_weights_receive_the_paths_and_their_noise() -> None:
    noise = noise_of(HARMONICS, n_av=1e4)
    fit, call = handed_over("weigh", WeightedFit.around, measured(), paths(), noise=noise)
    assert call[:2] == [OTHER_KERNEL, 2]
    expected = (HARMONICS, [one.covariance_terms for one in noise.each], paths().points)
    for received, sent in zip(call[2:5], expected, strict=True):
        np.testing.assert_array_equal(received, sent)
    assert fit.weights is call[5]
    assert (fit.weights == np.full((3, len(HARMONICS), COUNT), 7.0)).all()


@pytest.mark.parametrize("pairs", [False, True])
def test_the_compiled_scan_receives_its_grid(pairs: bool) -> None:
    """The grid has 32 places per turn, eight per period of harmonic 4. Its lags go up to half a turn."""
    weights = (3.0, 2.0, 1.0)
    found, call = handed_over("scan", starts.scanned, measured(), weights=weights, pairs=pairs)
    assert call[:4] == [OTHER_KERNEL, 3, 32, pairs]
    turn = 2.0 * np.pi * np.arange(32)[:, np.newaxis] / 32
    waves = np.array(weights) * np.exp(1j * np.array(HARMONICS) * turn)
    rho = (waves.real[1:17] / sum(weights)).sum(axis=1)
    factors, lags = (
        np.stack([waves.real, waves.imag], axis=-1),
        np.stack([rho, -2.0 * rho, 1.0 / (1.0 - rho**2)], axis=1),
    )
    for received, sent in zip(call[4:8], (factors, lags, measured().re, measured().im), strict=True):
        np.testing.assert_allclose(received, sent, atol=1e-12)
    assert [id(part) for part in call[8:]] == [id(part) for part in vars(found).values()]
