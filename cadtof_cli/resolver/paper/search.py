"""Levenberg–Marquardt for Eq. (9): two unknowns a pixel, from one start after the other until none can better what was found.

The damping is a multiple of the misfit √cost (Fan and Yuan 2005, doi:10.1007/s00607-004-0083-1). The Jacobian vanishes on all
real z in (0, 1), in proportion to the distance from there, and the misfit of light that one path nearly explains is of the order
of that distance squared: √cost has the size of JᵀJ. Damping in units of the diagonal of JᵀJ, as is usual, throws steps far away
there, or cuts them to nothing. `_shares.h` is the compiled twin of all of it.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.resolver.likelihood.compiled import MOST_HARMONIC, MOST_ROWS, compiled_search
from cadtof_cli.resolver.likelihood.levenberg_marquardt import MOST_DAMPING, SHRINK_BELOW, Linearised
from cadtof_cli.resolver.likelihood.normal_equations import LEAST_PIVOT
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from cadtof_cli.resolver.paper.records import STOPPING, Ends, RandomStarts, Stopping
from cadtof_cli.resolver.two_path.kernel import NUMPY, chosen_kernel

EASED, MORE, FURTHER = 0.3, 2.0, 4.0
"""What becomes of the damping where a step lowers the cost as promised, by much less, and not at all."""

AS_PROMISED, LESS_THAN_PROMISED = 0.9, 0.25
"""Shares of what was promised."""


def best_ends(
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    /,
    *,
    numbers: range | None = None,
    stopping: Stopping = STOPPING,
    kernel: str | None = None,
) -> Ends:
    """Return the best end of n pixels at their places in the frame, (n,): of all starts, or of those of the numbers alone.

    NaN has none: its cost is infinite. `kernel`: what runs, of `available_kernels` (None: the chosen); all give the same bits.
    """
    kernel, numbers = kernel or chosen_kernel(), range(starts.count) if numbers is None else numbers
    if kernel != NUMPY:
        found = compiled_best_ends(equations, places, starts, numbers=numbers, stopping=stopping, kernel=kernel)
        if found is not None:
            return found
    count = places.size
    best = Ends(
        np.full((2, count), np.nan), np.full(count, np.inf), np.zeros(count, np.bool_), np.zeros(count, np.intp)
    )
    for number in numbers:
        waiting: Index = np.flatnonzero(~(best.cost <= stopping.absolute))
        if not waiting.size:
            break
        found = ends(equations[waiting], starts.of(places[waiting], number), stopping=stopping)
        better = found.cost < best.cost[waiting]
        chosen = waiting[better]
        best.z[:, chosen], best.cost[chosen] = found.z[:, better], found.cost[better]
        best.converged[chosen] = found.converged[better]
        best.steps[waiting] += found.steps
    return best


def ends(equations: EliminatedPath, z: Float, /, *, stopping: Stopping = STOPPING) -> Ends:
    """Return where the search ends from z, (2, n); pixels that have stopped are dropped as it goes on."""
    at_work: Index = np.arange(z.shape[1])
    none = np.zeros(at_work.size, np.bool_)
    state = _State(z, equations.linearised(z), np.full(at_work.size, stopping.first_damping), none, none)
    result = Ends(z.copy(), state.at.cost, none, np.zeros(at_work.size, np.intp))
    for _ in range(stopping.max_steps):
        state = _stepped(equations, state, stopping)
        result.steps[at_work[~state.stopped]] += 1
        going = np.flatnonzero(~state.stopped)
        if going.size < SHRINK_BELOW * at_work.size:
            _store(result, at_work, state)
            at_work, equations, state = at_work[going], equations[going], state[going]
        if not going.size:
            break
    _store(result, at_work, state)
    return result


@dataclass(frozen=True)
class _State:
    z: Float
    at: Linearised
    damping: Float
    converged: Bool
    stopped: Bool

    def __getitem__(self, chosen: Index) -> "_State":
        at = Linearised(self.at.matrix[:, chosen], self.at.gradient[:, chosen], self.at.cost[chosen])
        return _State(self.z[:, chosen], at, self.damping[chosen], self.converged[chosen], self.stopped[chosen])


def _stepped(equations: EliminatedPath, state: _State, stopping: Stopping) -> _State:
    """Try one step of every pixel; one that has stopped, or whose step leads up, stays where it is."""
    now = state.at
    step, promised = _step(now, state.damping * np.sqrt(now.cost))
    done = promised <= stopping.relative * now.cost + stopping.absolute
    z = state.z + step
    there = equations.linearised(z)
    drop = now.cost - there.cost
    eased = np.where(drop < LESS_THAN_PROMISED * promised, MORE * state.damping, state.damping)
    eased = np.where(drop > AS_PROMISED * promised, EASED * state.damping, eased)
    damping = np.where(drop > 0.0, eased, FURTHER * state.damping)
    moves = (drop > 0.0) & ~state.stopped
    at = Linearised(*(np.where(moves, *pair) for pair in zip(_parts(there), _parts(now), strict=True)))
    stopped = state.stopped | done | ~(damping < MOST_DAMPING) | ~np.isfinite(promised)
    converged = state.converged | (done & ~state.stopped)
    return _State(np.where(moves, z, state.z), at, damping, converged, stopped)


def _step(now: Linearised, damping: Float) -> tuple[Float, Float]:
    """Return the damped step, (2, n), and by how much it promises to lower the cost, (n,)."""
    a, b, d = now.matrix
    a, d = a + damping, d + damping
    product = a * d
    scale = 1.0 / np.maximum(product - b * b, LEAST_PIVOT * product + np.finfo(np.float64).tiny)
    first, second = now.gradient
    x, y = (d * first - b * second) * scale, (a * second - b * first) * scale
    return np.stack([x, y]), x * (first + damping * x) + y * (second + damping * y)


def _parts(at: Linearised) -> tuple[Float, Float, Float]:
    return at.matrix, at.gradient, at.cost


def _store(result: Ends, at_work: Index, state: _State) -> None:
    result.z[:, at_work], result.cost[at_work] = state.z, state.at.cost
    result.converged[at_work] = state.converged


def compiled_best_ends(
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    /,
    *,
    numbers: range,
    stopping: Stopping,
    kernel: str,
) -> Ends | None:
    """Return what `best_ends` does, or None where numpy has to."""
    compiled, harmonics = compiled_search(), equations.harmonics
    if compiled is None or not numbers or len(harmonics) > MOST_ROWS or max(harmonics) > MOST_HARMONIC:
        return None
    count = places.size
    found = Ends(np.empty((2, count)), np.empty(count), np.empty(count, np.bool_), np.empty(count, np.intp))
    compiled.shares(
        kernel,
        numbers.start,
        numbers.stop,
        stopping.max_steps,
        starts.key,
        stopping.relative,
        stopping.absolute,
        stopping.first_damping,
        np.array(harmonics, np.int64),
        *(np.stack(parts) for parts in zip(*equations.right, strict=True)),
        np.ascontiguousarray(places),
        found.z,
        found.cost,
        found.converged,
        found.steps,
    )
    return found
