"""Levenberg–Marquardt for a block of small least-squares problems; each has its own damping and stops on its own.

Settings are frozen, the state is explicit, one loop holds the limit of steps, and the result says which problems did
not converge. The caller passes a `Problem`. The loop drops problems that have stopped from the block.
`_levenberg_marquardt.h` is the compiled twin, and this module is its front.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Float, Index, Int64
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous
from cadtof_cli.resolver.likelihood.kernel import compiled_search
from cadtof_cli.resolver.likelihood.mixture import Measured
from cadtof_cli.resolver.likelihood.normal_equations import Linearised, Triangle, cholesky, entry, solve

SHRINK_BELOW = 0.75
"""Stopped problems are dropped when the share still at work falls below this: copying costs a fifth of a step."""

MOST_DAMPING = 1e12
"""Damping at which a problem stops, because its steps have shrunk to nothing."""


class Problem(Protocol):
    """n least-squares problems, whose points have P numbers, (P, n), and whose steps have M numbers, (M, n)."""

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations at the points."""

    def moved(self, points: Float, steps: Float, /) -> Float:
        """Return the points after steps, (M, n)."""

    def __getitem__(self, chosen: Index, /) -> Self:
        """Return the problems of the given indices."""


class PathsProblem(Problem, Protocol):
    """Paths of n pixels that are fitted to phasors: a problem that the compiled search knows, too."""

    @property
    def kind(self) -> int:
        """The kind of the problem, numbered as in `kernel.py`."""

    @property
    def measured(self) -> Measured:
        """The phasors."""

    @property
    def weights(self) -> tuple[float, ...] | Float:
        """The weights, as in `WhiteFit` or `WeightedFit`."""

    @property
    def response_arrays(self) -> tuple[NDArray[Any] | None, ...]:
        """Arrays that only a problem of the kind `RESPONSE` has."""


@dataclass(frozen=True)
class Minimum:
    """Ends of n searches: points (P, n), cost (n,), triangle of JᵀWJ, and whether they converged, (n,)."""

    points: Float
    cost: Float
    matrix: Triangle
    converged: Bool


@dataclass(frozen=True)
class State:
    """State of the search for n problems, which are the last axis of all arrays.

    A problem goes on while a step promises to lower its cost by more than `worth` plus a share of the cost. `damping`,
    (D, n), is all that the method remembers about its damping, in its own units; row 0 is the damping itself.
    """

    points: Float
    matrix: Triangle
    gradient: Float
    cost: Float
    worth: Float
    damping: Float
    converged: Bool
    stopped: Bool

    def __getitem__(self, chosen: Index) -> "State":
        return State(*(part[..., chosen] for part in vars(self).values()))

    def put(self, at: Index, other: "State", /) -> None:
        """Overwrite the problems of the given indices."""
        some = slice(None) if at.size == self.cost.size else at  # a slice is copied four times as fast
        for part, new in zip(vars(self).values(), vars(other).values(), strict=True):
            part[..., some] = new


@dataclass(frozen=True, kw_only=True)
class Descent(ABC):
    """The loop, its stopping rule and the first damping; a subclass defines a step and how the damping changes.

    A problem has converged when a step promises to lower its cost by no more than `relative`·cost + `absolute`/samples.

    Attributes:
        max_steps: number of steps after which the search gives up.
        relative: share of the cost; a smaller decrease is not worth a step.
        absolute: cost; a smaller decrease is not worth a step.
        first_damping: damping of the first step, in the units of the method.
    """

    max_steps: int
    relative: float = 0.0
    absolute: float = 0.0
    first_damping: float = 1e-3

    def descended(self, problem: Problem, starts: Float, /, *, samples: Float | None = None) -> tuple[State, Int64]:
        """Return the end of every problem from its start, (P, n), and its number of steps; NaN does not converge."""
        count = starts.shape[1]
        at, none, worth = problem.linearised(starts), np.zeros(count, np.bool_), self.worth(count, samples)
        state = State(starts, at.matrix, at.gradient, at.cost, worth, self.begin(count), none, none)
        at_work: Index = np.arange(count)
        ends, steps = state[at_work], np.zeros(count, np.int64)
        for _ in range(self.max_steps):
            state = self._stepped(problem, state)
            steps[at_work[~state.stopped]] += 1
            going = np.flatnonzero(~state.stopped)
            if going.size < SHRINK_BELOW * at_work.size:
                ends.put(at_work, state)
                at_work, problem, state = at_work[going], problem[going], state[going]
            if not going.size:
                break
        ends.put(at_work, state)
        return ends, steps

    def _stepped(self, problem: Problem, now: State) -> State:
        """Try one step of every problem. A problem that has stopped, or whose step raises the cost, does not move."""
        step, promised = self.step(now)
        done = promised <= self.relative * now.cost + now.worth
        points = problem.moved(now.points, step)
        there = problem.linearised(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            drop = now.cost - there.cost
            damping = self.next_damping(now.damping, drop, promised)
        down = (drop > 0.0) & ~now.stopped
        return State(
            np.where(down, points, now.points),
            np.where(down, there.matrix, now.matrix),
            np.where(down, there.gradient, now.gradient),
            np.where(down, there.cost, now.cost),
            now.worth,
            damping,
            now.converged | (done & ~now.stopped),
            now.stopped | done | ~(damping[0] < MOST_DAMPING) | ~np.isfinite(promised),
        )

    def worth(self, count: int, samples: Float | None, /) -> Float:
        """Return the decrease that is not worth a step, (n,), of problems that are means of `samples` recordings."""
        return np.full(count, self.absolute if samples is None else self.absolute / samples)

    def begin(self, count: int, /) -> Float:
        """Return the damping of the first step, (D, n)."""
        return np.full((1, count), self.first_damping)

    @abstractmethod
    def step(self, now: State, /) -> tuple[Float, Float]:
        """Return the damped step, (M, n), and the decrease of the cost that it promises, (n,)."""

    @abstractmethod
    def next_damping(self, damping: Float, drop: Float, promised: Float, /) -> Float:
        """Return the damping, (D, n), after a step that lowered the cost by `drop`, (n,), and had promised `promised`."""


class LevenbergMarquardt(Descent):
    """The method with damping in units of the matrix's diagonal."""

    def solve(self, problem: PathsProblem, starts: Float, /, *, samples: Float | None = None) -> Minimum:
        """Minimise every problem from its start, (P, n); the starts are not changed. NaN does not converge.

        `samples`, (n,): each problem is the mean of so many recordings, and the cost is in units of the noise of one
        recording (None: 1). All kernels give the same bits.
        """
        if (compiled := compiled_search(problem.measured.harmonics, paths=len(starts) // 3)) is not None:
            return self._compiled_ends(compiled, problem, starts, samples)
        end, _ = self.descended(problem, starts, samples=samples)
        return Minimum(end.points, end.cost, end.matrix, end.converged)

    def _compiled_ends(
        self, compiled: ModuleType, problem: PathsProblem, starts: Float, samples: Float | None
    ) -> Minimum:
        measured, count, size = problem.measured, starts.shape[1], len(starts) // 3 * 2
        ends = Minimum(
            np.empty_like(starts, order="C"),
            np.empty(count),
            np.empty((size * (size + 1) // 2, count)),
            np.empty(count, np.bool_),
        )
        weights = np.asarray(problem.weights)
        compiled.solve(
            chosen_kernel(),
            problem.kind,
            size // 2,
            self.max_steps,
            self.relative,
            self.first_damping,
            np.array(measured.harmonics, np.int64),
            *contiguous(measured.re, measured.im, weights, starts, self.worth(count, samples)),
            ends.points,
            ends.cost,
            ends.matrix,
            ends.converged,
            *problem.response_arrays,
        )
        return ends

    def begin(self, count: int, /) -> Float:
        """Return the damping, and the factor by which the next step that raises the cost multiplies it."""
        return np.array([np.full(count, self.first_damping), np.full(count, 2.0)])

    def step(self, now: State, /) -> tuple[Float, Float]:
        """Return the step, solved by Cholesky factors, and the decrease that it promises."""
        damping = now.damping[0]
        step = solve(cholesky(now.matrix, len(now.gradient), damping=damping), now.gradient)
        promised = np.zeros_like(now.cost)
        for i, (part, slope) in enumerate(zip(step, now.gradient, strict=True)):
            promised += part * (slope + damping * now.matrix[entry(i, i)] * part)
        return step, promised

    def next_damping(self, damping: Float, drop: Float, promised: Float, /) -> Float:
        """Return damping and factor. The larger the share of the promise that a step gains, the smaller the damping.

        Every step in a row that raises the cost raises the damping by twice the factor of the step before.
        """
        own, growth = damping
        twice = 2.0 * (drop / promised) - 1.0
        eased = own * np.maximum(1.0 - twice * twice * twice, 0.1)
        down = drop > 0.0
        return np.array([np.where(down, eased, own * growth), np.where(down, 2.0, 2.0 * growth)])
