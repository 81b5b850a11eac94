"""Levenberg–Marquardt for Eq. (9): two unknowns per pixel, from one start after the other until none can better what was found.

The damping is a multiple of the misfit √cost (Fan and Yuan 2005, doi:10.1007/s00607-004-0083-1). The Jacobian vanishes on all
real z in (0, 1), in proportion to the distance from there, and the misfit of light that one path nearly explains is of the order
of that distance squared: √cost has the size of JᵀJ. Damping in units of the diagonal of JᵀJ, as is usual, throws steps far away
there, or cuts them to nothing. `_shares.h` is the compiled twin of all of it.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel
from cadtof_cli.resolver.likelihood.compiled import compiled_search
from cadtof_cli.resolver.likelihood.levenberg_marquardt import Descent, State
from cadtof_cli.resolver.likelihood.normal_equations import LEAST_PIVOT
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from cadtof_cli.resolver.paper.starts import RandomStarts

EASED, MORE, FURTHER = 0.3, 2.0, 4.0
"""What becomes of the damping where a step lowers the cost as promised, by much less, and not at all."""

AS_PROMISED, LESS_THAN_PROMISED = 0.9, 0.25
"""Shares of what was promised."""


@dataclass(frozen=True, kw_only=True)
class MisfitDamped(Descent):
    """The method with damping in units of the misfit.

    A start on its way to the answer lowers its cost by a share of it with every step; one that does not is in a false minimum.
    What is left below `absolute` is worth no other start either.
    """

    max_steps: int = 100
    relative: float = 1e-3
    absolute: float = 1e-29
    first_damping: float = 0.5

    def step(self, now: State, /) -> tuple[Float, Float]:
        """Return the step by Cramer's rule, and what it promises."""
        damping = now.damping[0] * np.sqrt(now.cost)
        a, b, d = now.matrix
        a, d = a + damping, d + damping
        product = a * d
        scale = 1.0 / np.maximum(product - b * b, LEAST_PIVOT * product + np.finfo(np.float64).tiny)
        first, second = now.gradient
        x, y = (d * first - b * second) * scale, (a * second - b * first) * scale
        return np.stack([x, y]), x * (first + damping * x) + y * (second + damping * y)

    def next_damping(self, damping: Float, drop: Float, promised: Float, /) -> Float:
        """Return the damping by what a step gained of its promise."""
        eased = np.where(drop < LESS_THAN_PROMISED * promised, MORE * damping, damping)
        eased = np.where(drop > AS_PROMISED * promised, EASED * damping, eased)
        return np.where(drop > 0.0, eased, FURTHER * damping)


DAMPED = MisfitDamped()


@dataclass(frozen=True)
class Ends:
    """Where the searches of n pixels ended.

    Attributes:
        z: real and imaginary part, (2, n).
        cost: at z, (n,).
        converged: whether a search ended at a minimum, (n,).
        steps: how many a search took, (n,).
    """

    z: Float
    cost: Float
    converged: Bool
    steps: Index


def best_ends(
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    /,
    *,
    numbers: range | None = None,
    stopping: MisfitDamped = DAMPED,
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
        end, steps = stopping.descended(equations[waiting], starts.of(places[waiting], number))
        better = end.cost < best.cost[waiting]
        chosen = waiting[better]
        best.z[:, chosen], best.cost[chosen] = end.points[:, better], end.cost[better]
        best.converged[chosen] = end.converged[better]
        best.steps[waiting] += steps
    return best


def compiled_best_ends(
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    /,
    *,
    numbers: range,
    stopping: MisfitDamped,
    kernel: str,
) -> Ends | None:
    """Return what `best_ends` does, or None where numpy has to."""
    compiled = compiled_search(equations.harmonics, paths=2)
    if compiled is None or not numbers:
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
        np.array(equations.harmonics, np.int64),
        *(np.stack(parts) for parts in zip(*equations.right, strict=True)),
        np.ascontiguousarray(places),
        found.z,
        found.cost,
        found.converged,
        found.steps,
    )
    return found
