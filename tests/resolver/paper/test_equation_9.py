"""The paper's solver against the closed form, which has no local minima, and against scipy on the same pixels."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import leastsq

from cadtof_cli.resolver.paper.equation_9 import TwoShares, two_shares
from cadtof_cli.resolver.paper.starts import random_starts
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths
from tests.support.mixtures import C, Mixture

SEEDS = 20


def in_closed_form(phasors: C) -> C:
    """a·exp(ix) and b·exp(iy), the stronger first, (2, n)."""
    with np.errstate(all="ignore"):
        two = two_paths(fundamental_frame(phasors[0], phasors[1]))
    return stronger_first(np.stack((two.a * (two.cos_x + 1j * two.sin_x), two.b * (two.cos_y + 1j * two.sin_y))))


def by_elimination(phasors: C, seed: int = 0) -> tuple[TwoShares, C]:
    starts = random_starts(10, pixels=range(phasors.shape[1]), seed=seed)
    with np.errstate(all="ignore"):
        found = two_shares(phasors, harmonics=(1, 2), starts=starts)
    return found, stronger_first(found.paths.amplitude * (found.paths.cos + 1j * found.paths.sin))


def stronger_first(paths: NDArray[Any]) -> NDArray[Any]:
    return np.take_along_axis(paths, np.argsort(-np.abs(paths), axis=0), axis=0)


def wrong(found: C, truth: C) -> NDArray[np.bool_]:
    """Where a path is off by more than a millionth of the light."""
    missed: NDArray[np.bool_] = ~(np.abs(found - truth).max(axis=0) <= 1e-6 * np.abs(truth).sum(axis=0))
    return missed


def test_random_paths_are_found_to_rounding() -> None:
    rng = np.random.default_rng(2)
    amplitudes, phases = rng.uniform(0.1, 1.0, (2, 3000)), rng.uniform(0, 2 * np.pi, (2, 3000))
    phasors = np.stack([(amplitudes * np.exp(1j * h * phases)).sum(axis=0) for h in (1, 2)])
    found, paths = by_elimination(phasors)
    missed = wrong(paths, stronger_first(amplitudes * np.exp(1j * phases)))
    assert missed.mean() < 0.003
    assert (found.cost[~missed] < 1e-20).all()


def test_what_is_missed_ended_in_a_local_minimum_and_shows_it() -> None:
    """Without MPI every real z in (0, 1) is stationary: there, and nowhere else, the best of ten starts can be false."""
    one = Mixture((1.0,), (5.0,)).phasors((1, 2), n_av=1e5, size=4000, rng=np.random.default_rng(3))
    found, paths = by_elimination(one)
    missed = wrong(paths, in_closed_form(one))
    assert missed.any()
    assert (found.cost[missed] > 1e-20).all()
    two = Mixture((1.0, 0.3), (5.0, 16.0)).phasors((1, 2), n_av=1e5, size=4000, rng=np.random.default_rng(4))
    assert not wrong(by_elimination(two)[1], in_closed_form(two)).any()


def test_without_mpi_seven_pixels_in_a_hundred_are_missed_whatever_the_seed() -> None:
    """Every pixel has its own luck, so the counts of twenty seeds scatter as those of independent draws do, and no more."""
    size = 1000
    drawn = Mixture((1.0,), (5.0,)).phasors((1, 2), n_av=1e5, size=size, rng=np.random.default_rng(6))
    truth = in_closed_form(drawn)
    missed = np.array([wrong(by_elimination(drawn, seed)[1], truth).mean() for seed in range(SEEDS)])
    spread = np.sqrt(missed.mean() * (1.0 - missed.mean()) / size)
    assert missed.mean() == pytest.approx(0.07, abs=0.015)
    assert (np.abs(missed - missed.mean()) < 4.0 * spread).all()
    assert missed.std(ddof=1) < 1.6 * spread


def test_scipy_misses_no_fewer_from_the_same_starts() -> None:
    drawn = [Mixture((1.0, *mpi), (5.0, 16.0)[: 1 + len(mpi)]) for mpi in ((), (0.3,))]
    rng = np.random.default_rng(5)
    phasors = np.concatenate([problem.phasors((1, 2), n_av=1e5, size=30, rng=rng) for problem in drawn], axis=1)
    truth = in_closed_form(phasors)
    ours = wrong(by_elimination(phasors)[1], truth)
    own = random_starts(10, pixels=range(60), seed=0).T
    theirs = wrong(np.stack([best_of_scipy(*given) for given in zip(*phasors, own, strict=True)], axis=1), truth)
    assert ours.sum() <= theirs.sum()


def best_of_scipy(p1: complex, p2: complex, starts: C) -> C:
    q = p2 * abs(p1) / p1**2

    def residual(z: NDArray[np.float64]) -> tuple[float, float]:
        first, second = complex(*z), 1 - complex(*z)
        rest = q - first * first / abs(first) - second * second / abs(second)
        return rest.real, rest.imag

    ends = [leastsq(residual, (start.real, start.imag), xtol=1e-12, ftol=1e-12)[0] for start in starts]
    z = complex(*min(ends, key=lambda end: np.hypot(*residual(end))))
    return stronger_first(np.array([[z * p1], [(1 - z) * p1]]))[:, 0]


def test_without_a_fundamental_there_is_no_equation() -> None:
    found, _ = by_elimination(np.array([[0.0, 0.3], [0.2, 0.1]], np.complex128))
    np.testing.assert_array_equal(found.converged, [False, True])
    assert np.isnan(found.paths.amplitude[:, 0]).all()


def test_starts_follow_from_seed_and_place_alone() -> None:
    whole = random_starts(10, pixels=range(10000), seed=3)
    for part in (range(1), range(4095, 4097), range(4096, 8192), range(17, 9001), range(50, 50)):
        np.testing.assert_array_equal(random_starts(10, pixels=part, seed=3), whole[:, part.start : part.stop])
    np.testing.assert_array_equal(random_starts(4, pixels=range(10000), seed=3), whole[:4])
    assert (random_starts(10, pixels=range(10000), seed=4) != whole).all()
    assert np.unique(whole).size == whole.size
    assert whole.mean() == pytest.approx(0.5, abs=0.02)
    assert whole.real.std() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4), (1, 3)])
def test_higher_harmonics_give_more_equations(harmonics: tuple[int, ...]) -> None:
    problem = Mixture((1.0, 0.3), (5.0, 16.0))
    with np.errstate(all="ignore"):
        found = two_shares(
            problem.exact(harmonics), harmonics=harmonics, starts=random_starts(20, pixels=range(1), seed=1)
        )
    assert found.cost[0] < 1e-20
    if harmonics != (1, 3):  # where two pairs of delays have the same phasors
        np.testing.assert_allclose(sorted(found.paths.amplitude[:, 0]), sorted(problem.shares), rtol=1e-9)
