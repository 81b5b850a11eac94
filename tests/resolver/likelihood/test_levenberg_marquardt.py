"""The loop of Levenberg–Marquardt on Rosenbrock's function as least squares: residuals 10·(y − x²) and root − x."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pytest

from cadtof_cli.arrays import Float, Index
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.likelihood.normal_equations import Linearised

SOLVER = LevenbergMarquardt(max_steps=200, absolute=1e-20)


@dataclass(frozen=True)
class Rosenbrock:
    """Rosenbrock functions, one per problem, each with its minimum at (root, root²)."""

    root: Float

    def linearised(self, points: Float, /) -> Linearised:
        x, y = points
        first, second = 10.0 * (x * x - y), self.root - x
        matrix = np.stack((400.0 * x * x + 1.0, -200.0 * x, np.full_like(x, 100.0)))
        gradient = np.stack((-20.0 * x * first + second, 10.0 * first))
        return Linearised(matrix, gradient, first * first + second * second)

    def moved(self, points: Float, steps: Float, /) -> Float:
        return points + steps

    def __getitem__(self, chosen: Index, /) -> Self:
        return replace(self, root=self.root[chosen])


def problem(count: int) -> tuple[Rosenbrock, Float]:
    rng = np.random.default_rng(1)
    return Rosenbrock(rng.uniform(-2, 2, count)), rng.uniform(-3, 3, (2, count))


def test_every_problem_ends_in_its_own_minimum() -> None:
    valleys, starts = problem(200)
    before = starts.copy()
    end, steps = SOLVER.descended(valleys, starts)
    np.testing.assert_array_equal(starts, before)
    assert end.converged.all()
    np.testing.assert_allclose(end.points, [valleys.root, valleys.root**2], atol=1e-8)
    assert end.cost.max() < 1e-16
    assert steps.min() < steps.max()


def test_a_problem_solved_alone_takes_the_same_steps() -> None:
    valleys, starts = problem(40)
    together, steps = SOLVER.descended(valleys, starts)
    for index in range(40):
        some = np.array([index])
        alone, steps_alone = SOLVER.descended(valleys[some], starts[:, some])
        assert (alone.points[:, 0] == together.points[:, index]).all()
        assert alone.cost[0] == together.cost[index]
        assert steps_alone[0] == steps[index]


@pytest.mark.parametrize("limit", [1, 3])
def test_a_search_that_reaches_its_limit_of_steps_has_not_converged(limit: int) -> None:
    valleys, starts = problem(50)
    end, steps = replace(SOLVER, max_steps=limit).descended(valleys, starts)
    assert not end.converged.all()
    assert steps.max() <= limit
    assert (end.cost <= valleys.linearised(starts).cost).all()


def test_a_start_at_the_minimum_stays_there() -> None:
    valleys = Rosenbrock(np.array([1.5]))
    end, _ = SOLVER.descended(valleys, np.array([[1.5], [2.25]]))
    assert end.converged[0]
    np.testing.assert_array_equal(end.points[:, 0], [1.5, 2.25])


def test_a_start_of_nan_does_not_converge() -> None:
    valleys, starts = problem(3)
    starts[0, 1] = np.nan
    with np.errstate(all="ignore"):
        end, _ = SOLVER.descended(valleys, starts)
    np.testing.assert_array_equal(end.converged, [True, False, True])


@dataclass(frozen=True)
class ListedCosts:
    """Problems whose derivatives promise a lower cost for any step, but whose cost is the next number of a fixed list."""

    costs: list[float]

    def linearised(self, points: Float, /) -> Linearised:
        one = np.ones((1, points.shape[1]))
        return Linearised(one, one[0:1], one[0] * self.costs.pop(0))

    def moved(self, points: Float, steps: Float, /) -> Float:
        return points + steps

    def __getitem__(self, chosen: Index, /) -> Self:
        return self


@pytest.mark.parametrize("lower", [0, 1, 3, 7])
def test_steps_in_a_row_that_raise_the_cost_multiply_the_damping_by_2_4_8(lower: int) -> None:
    """Ten steps in a row that raise the cost multiply the damping by 2, 4, …, 2¹⁰, so from 2⁻¹⁰ to 2⁴⁵.

    That is beyond 10¹², where the search gives up; nine such steps are not enough. The `lower` steps before them lower
    the cost by more than was promised. Each of these divides the damping by ten and starts the factors again at 2.
    """
    costs = [100.0 - 10.0 * number for number in range(lower + 1)]
    solver = LevenbergMarquardt(max_steps=60, first_damping=2.0**-10 * 10.0**lower)
    end, steps = solver.descended(ListedCosts(costs + [200.0] * 60), np.zeros((1, 1)))
    assert steps[0] == lower + 9
    assert not end.converged[0]
    assert end.cost[0] == costs[-1]


def test_the_damping_follows_the_share_of_its_promise_that_a_step_gains() -> None:
    """It is multiplied by 1 − (2ρ − 1)³ with the share ρ (Nielsen 1999), and by a tenth at least."""
    shares = np.array([0.25, 0.5, 0.75, 0.9, 1.0, 2.0])
    damping, growth = LevenbergMarquardt(max_steps=1).next_damping(
        np.array([np.full(6, 8.0), np.full(6, 4.0)]), 3.0 * shares, np.full(6, 3.0)
    )
    np.testing.assert_allclose(damping, 8.0 * np.array([1.125, 1.0, 0.875, 0.488, 0.1, 0.1]))
    np.testing.assert_allclose(growth, 2.0)
