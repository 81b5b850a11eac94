"""The paper's solver against the closed form, which has no local minima, and against scipy on equal pixels."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import leastsq

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.likelihood.normal_equations import Linearised
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath, rotors_of
from cadtof_cli.resolver.paper.levenberg_marquardt import DAMPED
from cadtof_cli.resolver.paper.solver import TwoShares, steps_of_starts, two_shares
from cadtof_cli.resolver.paper.starts import RandomStarts
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths
from tests.support.mixtures import C, Mixture

SEEDS = 20


def closed_form_paths(phasors: C) -> C:
    """Return a·exp(ix) and b·exp(iy) of the closed form, the stronger path first, (2, n)."""
    with np.errstate(all="ignore"):
        two = two_paths(fundamental_frame(phasors[0], phasors[1]))
    return stronger_first(np.stack((two.a * (two.cos_x + 1j * two.sin_x), two.b * (two.cos_y + 1j * two.sin_y))))


def solved(phasors: C, seed: int = 0) -> tuple[TwoShares, C]:
    with np.errstate(all="ignore"):
        found = two_shares(phasors, harmonics=(1, 2), places=np.arange(phasors.shape[1]), starts=RandomStarts(10, seed))
    return found, stronger_first(found.paths.amplitude * (found.paths.cos + 1j * found.paths.sin))


def stronger_first(paths: NDArray[Any]) -> NDArray[Any]:
    return np.take_along_axis(paths, np.argsort(-np.abs(paths), axis=0), axis=0)


def is_wrong(found: C, truth: C) -> NDArray[np.bool_]:
    """Return the pixels in which a path is off by more than a millionth of all light, or is NaN."""
    missed: NDArray[np.bool_] = ~(np.abs(found - truth).max(axis=0) <= 1e-6 * np.abs(truth).sum(axis=0))
    return missed


def test_random_paths_are_found_to_rounding() -> None:
    rng = np.random.default_rng(2)
    amplitudes, phases = rng.uniform(0.1, 1.0, (2, 3000)), rng.uniform(0, 2 * np.pi, (2, 3000))
    phasors = np.stack([(amplitudes * np.exp(1j * h * phases)).sum(axis=0) for h in (1, 2)])
    found, paths = solved(phasors)
    missed = is_wrong(paths, stronger_first(amplitudes * np.exp(1j * phases)))
    assert missed.mean() < 0.003
    assert (found.cost[~missed] < 1e-20).all()


def test_a_missed_pixel_ended_in_a_local_minimum_and_its_cost_shows_it() -> None:
    """Without MPI every real z in (0, 1) is a stationary point, so that the best of a few starts can be wrong.

    With MPI it never is.
    """
    one = Mixture((1.0,), (5.0,)).phasors((1, 2), n_av=1e5, size=4000, rng=np.random.default_rng(3))
    with np.errstate(all="ignore"):
        found = two_shares(one, harmonics=(1, 2), places=np.arange(4000), starts=RandomStarts(3, 0))
    missed = is_wrong(
        stronger_first(found.paths.amplitude * (found.paths.cos + 1j * found.paths.sin)), closed_form_paths(one)
    )
    assert missed.any()
    assert (found.cost[missed] > 1e-20).all()
    two = Mixture((1.0, 0.3), (5.0, 16.0)).phasors((1, 2), n_av=1e5, size=4000, rng=np.random.default_rng(4))
    assert not is_wrong(solved(two)[1], closed_form_paths(two)).any()


def test_without_mpi_at_most_three_pixels_in_a_thousand_are_missed_for_any_seed() -> None:
    """Pixels are missed independently of each other, so the counts of twenty seeds scatter as independent draws do."""
    size = 1000
    drawn = Mixture((1.0,), (5.0,)).phasors((1, 2), n_av=1e5, size=size, rng=np.random.default_rng(6))
    truth = closed_form_paths(drawn)
    missed = np.array([is_wrong(solved(drawn, seed)[1], truth).sum() for seed in range(SEEDS)])
    assert missed.mean() < 0.003 * size
    assert missed.max() < missed.mean() + 5.0 * np.sqrt(missed.mean()) + 1.0


def test_scipy_misses_no_fewer_from_the_same_starts() -> None:
    drawn = [Mixture((1.0, *mpi), (5.0, 16.0)[: 1 + len(mpi)]) for mpi in ((), (0.3,))]
    rng = np.random.default_rng(5)
    phasors = np.concatenate([problem.phasors((1, 2), n_av=1e5, size=30, rng=rng) for problem in drawn], axis=1)
    truth = closed_form_paths(phasors)
    starts = drawn_starts(np.arange(60), seed=0).T
    of_scipy = np.stack([best_of_scipy(*given) for given in zip(*phasors, starts, strict=True)], axis=1)
    assert is_wrong(solved(phasors)[1], truth).sum() <= is_wrong(of_scipy, truth).sum()


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
    found, _ = solved(np.array([[0.0, 0.3], [0.2, 0.1]], np.complex128))
    np.testing.assert_array_equal(found.converged, [False, True])
    assert np.isnan(found.paths.amplitude[:, 0]).all()


def complex_of(parts: NDArray[np.float64]) -> C:
    return np.asarray(parts[0] + 1j * parts[1], np.complex128)


def drawn_starts(places: NDArray[np.intp], *, seed: int) -> C:
    return np.stack([complex_of(RandomStarts(10, seed).of(places, number)) for number in range(10)])


def test_starts_follow_from_seed_and_place_alone() -> None:
    everywhere = np.arange(10000)
    whole = drawn_starts(everywhere, seed=3)
    for part in (slice(0, 1), slice(4095, 4097), slice(17, 9001), slice(50, 50), slice(None, None, -7)):
        np.testing.assert_array_equal(drawn_starts(everywhere[part], seed=3), whole[:, part])
    assert (drawn_starts(everywhere, seed=4) != whole).all()
    assert np.unique(whole).size == whole.size


def test_starts_are_uniform_in_a_square_and_uncorrelated() -> None:
    whole = drawn_starts(np.arange(10000), seed=3)
    for parts, middle in ((whole.real, 0.5), (whole.imag, 0.0)):
        assert middle - 3.0 <= parts.min() < middle - 2.99 < middle + 2.99 < parts.max() < middle + 3.0
        counts, _ = np.histogram(parts, bins=50, range=(middle - 3.0, middle + 3.0))
        assert np.square(counts / 2000.0 - 1.0).sum() * 2000.0 < 95.0  # χ² of 49 degrees of freedom, 1e-4
    parts = np.concatenate([whole.real[:, :-1], whole.imag[:, :-1], whole.real[:1, 1:]])
    correlations = np.corrcoef(parts) - np.eye(len(parts))
    assert np.abs(correlations).max() < 5.0 / np.sqrt(10000)


def test_splitmix64_gives_the_numbers_of_its_reference_implementations() -> None:
    """The expected numbers are the first three of seed 1234567 that reference implementations print."""
    starts = RandomStarts(1, 0)
    starts.__dict__["key"] = 1234567 + 0x9E3779B97F4A7C15  # the reference adds the increment before its first number
    known = (6457827717110365317, 3203168211198807973, 9817491932198370423)
    expected = [[n >> 32, n & 0xFFFFFFFF] for n in known]
    found = (starts.of(np.arange(3), 0) + np.array([[2.5], [3.0]])) * 2**32 / 6.0
    np.testing.assert_allclose(found.T, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4), (1, 3)])
def test_higher_harmonics_give_more_equations(harmonics: tuple[int, ...]) -> None:
    problem = Mixture((1.0, 0.3), (5.0, 16.0))
    with np.errstate(all="ignore"):
        found = two_shares(
            problem.exact(harmonics), harmonics=harmonics, places=np.zeros(1, np.intp), starts=RandomStarts(20, 1)
        )
    assert found.cost[0] < 1e-20
    if harmonics != (1, 3):  # with (1, 3), two different pairs of delays have the same phasors
        np.testing.assert_allclose(sorted(found.paths.amplitude[:, 0]), sorted(problem.shares), rtol=1e-9)


def test_a_start_at_the_answer_ends_at_once_and_others_take_steps() -> None:
    """For light of two paths, the answer is z = α/p_1. The steps of a pixel do not depend on the other pixels."""
    rng = np.random.default_rng(5)
    amplitudes, phases = rng.uniform(0.2, 1.0, (2, 200)), rng.uniform(0, 2 * np.pi, (2, 200))
    paths = amplitudes * np.exp(1j * phases)
    phasors = np.stack([(amplitudes * np.exp(1j * h * phases)).sum(axis=0) for h in (1, 2, 3)])
    equations, answer = EliminatedPath.of_phasors(phasors, harmonics=(1, 2, 3)), paths[0] / phasors[0]
    found, taken = DAMPED.descended(equations, np.stack([answer.real, answer.imag]))
    assert np.quantile(taken, 0.98) <= 1  # in the other pixels z is large, and rounding costs them digits
    np.testing.assert_allclose(complex_of(found.points), answer, rtol=1e-9)
    places, starts = np.arange(200), RandomStarts(3, 1)
    steps = steps_of_starts(phasors, harmonics=(1, 2, 3), places=places, starts=starts)
    assert steps.shape == (3, 200)
    assert (steps > 1).mean() > 0.95
    some = slice(30, 40)
    alone = steps_of_starts(phasors[:, some], harmonics=(1, 2, 3), places=places[some], starts=starts)
    np.testing.assert_array_equal(alone, steps[:, some])


class FlatCost(EliminatedPath):
    """Equations whose derivatives promise a lower cost for a step, but whose cost is the same everywhere."""

    def linearised(self, z: Float, /) -> Linearised:
        count = z.shape[1]
        return Linearised(np.repeat([[1.0], [0.0], [1.0]], count, axis=1), np.ones((2, count)), np.ones(count))


def test_a_step_that_does_not_lower_the_cost_is_not_taken() -> None:
    start = np.array([[0.3, 0.7], [0.1, -0.4]])
    end, _ = DAMPED.descended(FlatCost((2,), ()), start)
    np.testing.assert_array_equal(end.points, start)


@pytest.mark.parametrize("z", [0j, 1 + 0j, 1j, -1 + 0j, 2 + 0j, 1 + 1j, 0.3 - 0.4j])
def test_both_shares_have_a_modulus_and_a_rotor_which_is_1_for_a_share_of_0(z: complex) -> None:
    first, second = rotors_of(np.array([z.real]), np.array([z.imag]))
    for share, (modulus, (cos, sin)) in ((z, first), (1 - z, second)):
        expected = share / abs(share) if share else 1.0
        np.testing.assert_allclose(modulus, abs(share), rtol=1e-15)
        np.testing.assert_allclose(cos + 1j * sin, expected, rtol=1e-15)
