"""Levenberg–Marquardt for a block of small least-squares problems: own damping and own stopping for each.

Settings are frozen, the state is explicit, one loop owns the limit of steps, and a problem that does not converge says so in
its result. What is solved comes as a `Problem`; problems that have stopped are dropped from the block as the loop goes on.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.resolver.likelihood.compiled import Minimum, Planes, compiled_ends
from cadtof_cli.resolver.likelihood.normal_equations import Triangle, cholesky, entry, solve
from cadtof_cli.resolver.two_path.kernel import NUMPY, chosen_kernel

SHRINK_BELOW = 0.75
"""Share of a block still at work below which the others are dropped: copying costs as much as a fifth of a step."""

MOST_DAMPING = 1e12
"""Damping at which a problem stops: its steps have shrunk to nothing."""


@dataclass(frozen=True)
class Linearised:
    """A problem around its points: `matrix` JᵀWJ by its triangle, `gradient` JᵀW·residual, (M, n), `cost` rᵀWr, (n,)."""

    matrix: Triangle
    gradient: Float
    cost: Float


class Problem(Protocol):
    """n least-squares problems with points of P numbers, (P, n), and M degrees of freedom."""

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations at the points."""

    def moved(self, points: Float, steps: Float, /) -> Float:
        """Return the points after steps of (M, n)."""

    def planes(self, points: Float, /) -> Planes | None:
        """Return them for the compiled search from such points; None: it knows no such problems."""

    def __getitem__(self, chosen: Index, /) -> Self:
        """Return the problems of the given indices."""


@dataclass(frozen=True, kw_only=True)
class LevenbergMarquardt:
    """When to stop, and how carefully to begin.

    A problem has converged once a step promises to lower its cost by no more than `relative`·cost + `absolute`/samples.

    Attributes:
        max_steps: steps after which a problem that has not converged is given up.
        relative: share of the cost that is not worth a step.
        absolute: cost that is not worth a step.
        first_damping: damping of the first step, in units of the matrix's diagonal.
    """

    max_steps: int
    relative: float = 0.0
    absolute: float = 0.0
    first_damping: float = 1e-3

    def solve(
        self, problem: Problem, starts: Float, /, *, samples: Float | None = None, kernel: str | None = None
    ) -> Minimum:
        """Minimise every problem from its start, (P, n); the starts are not changed. NaN does not converge.

        `samples`, (n,): what is solved are means of so many recordings, the cost is in units of one's noise (None: 1).
        `kernel`: what runs, of `available_kernels` (None: the chosen); all give the same bits.
        """
        worth = np.full(starts.shape[1], self.absolute if samples is None else self.absolute / samples)
        kernel = kernel or chosen_kernel()
        planes = problem.planes(starts) if kernel != NUMPY else None
        if planes is not None:
            ends = compiled_ends(
                planes,
                starts,
                worth=worth,
                most_steps=self.max_steps,
                relative=self.relative,
                first_damping=self.first_damping,
                kernel=kernel,
            )
            if ends is not None:
                return ends
        return self._solved_by_numpy(problem, starts, worth)

    def _solved_by_numpy(self, problem: Problem, starts: Float, worth: Float) -> Minimum:
        at_work: Index = np.arange(starts.shape[1])
        state = _begin(problem, starts, self.first_damping, worth)
        result = Minimum(
            starts.copy(), state.at.cost, state.at.matrix, state.converged, np.zeros(starts.shape[1], np.intp)
        )
        for _ in range(self.max_steps):
            state = self._stepped(problem, state)
            result.steps[at_work[~state.stopped]] += 1
            going = np.flatnonzero(~state.stopped)
            if going.size < SHRINK_BELOW * at_work.size:
                _store(result, at_work, state)
                at_work, problem, state = at_work[going], problem[going], state[going]
            if not going.size:
                break
        _store(result, at_work, state)
        return result

    def _stepped(self, problem: Problem, state: "_State") -> "_State":
        """Try one step of every problem; one that has stopped, or whose step leads up, stays where it is."""
        now = state.at
        step = solve(cholesky(now.matrix, len(now.gradient), damping=state.damping), now.gradient)
        promised = np.zeros_like(now.cost)
        for i, (part, slope) in enumerate(zip(step, now.gradient, strict=True)):
            promised += part * (slope + state.damping * now.matrix[entry(i, i)] * part)
        done = promised <= self.relative * now.cost + state.worth
        points = problem.moved(state.points, step)
        there = problem.linearised(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = (now.cost - there.cost) / promised
        down = (there.cost < now.cost) & ~state.stopped
        twice = 2.0 * gain - 1.0
        eased = state.damping * np.maximum(1.0 - twice * twice * twice, 0.1)
        damping = np.where(down, eased, state.damping * state.growth)
        if not down.all():
            for stays, moves in (
                (state.points, points),
                (now.matrix, there.matrix),
                (now.gradient, there.gradient),
                (now.cost, there.cost),
            ):
                np.copyto(moves, stays, where=~down)
        return _State(
            points,
            there,
            state.worth,
            damping,
            np.where(down, 2.0, 2.0 * state.growth),
            state.converged | (done & ~state.stopped),
            state.stopped | done | ~(damping < MOST_DAMPING) | ~np.isfinite(promised),
        )


@dataclass(frozen=True)
class _State:
    """n problems on their way; `worth` is what a step must promise to lower their cost by, besides a share of it."""

    points: Float
    at: Linearised
    worth: Float
    damping: Float
    growth: Float
    converged: Bool
    stopped: Bool

    def __getitem__(self, chosen: Index) -> "_State":
        at = Linearised(self.at.matrix[:, chosen], self.at.gradient[:, chosen], self.at.cost[chosen])
        return _State(
            self.points[:, chosen],
            at,
            self.worth[chosen],
            self.damping[chosen],
            self.growth[chosen],
            self.converged[chosen],
            self.stopped[chosen],
        )


def _begin(problem: Problem, starts: Float, damping: float, worth: Float) -> _State:
    count = starts.shape[1]
    none = np.zeros(count, np.bool_)
    return _State(
        starts, problem.linearised(starts), worth, np.full(count, damping), np.full(count, 2.0), none, none.copy()
    )


def _store(result: Minimum, at_work: Index, state: _State) -> None:
    some = slice(None) if at_work.size == result.cost.size else at_work  # a slice is copied four times as fast
    result.points[:, some] = state.points
    result.cost[some] = state.at.cost
    result.matrix[:, some] = state.at.matrix
    result.converged[some] = state.converged
