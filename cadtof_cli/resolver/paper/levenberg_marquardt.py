"""Levenberg–Marquardt for Eq. (9): two unknowns per pixel, one start after the other until no start can be better.

The damping is a multiple of the misfit √cost (Fan and Yuan 2005, doi:10.1007/s00607-004-0083-1), for this reason. The
Jacobian vanishes on all real z in (0, 1), in proportion to the distance from this line. If one path nearly explains the
light, the misfit is of the order of the distance squared, so √cost has the size of JᵀJ. The usual damping, in units of
the diagonal of JᵀJ, gives steps near this line that are far too long or nearly 0. `_levenberg_marquardt.h` is the
compiled twin of this module.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, Int64
from cadtof_cli.resolver.kernels import chosen_kernel
from cadtof_cli.resolver.likelihood.kernel import compiled_search
from cadtof_cli.resolver.likelihood.levenberg_marquardt import Descent, State
from cadtof_cli.resolver.likelihood.normal_equations import LEAST_PIVOT
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from cadtof_cli.resolver.paper.starts import RandomStarts

EASED, MORE, FURTHER = 0.3, 2.0, 4.0
"""Factors of the damping after a step that lowers the cost as promised, by much less than promised, and not at all."""

AS_PROMISED, LESS_THAN_PROMISED = 0.9, 0.25
"""A step counts as promised above the first share of the promised decrease, and as much less below the second share."""


@dataclass(frozen=True, kw_only=True)
class MisfitDamped(Descent):
    """The method with damping in units of the misfit.

    A search that approaches the answer lowers its cost by a share with every step; a search that does not is in a false
    minimum. If the cost falls below `absolute`, no other start is tried either.
    """

    max_steps: int = 100
    relative: float = 1e-3
    absolute: float = 1e-29
    first_damping: float = 0.5

    def step(self, now: State, /) -> tuple[Float, Float]:
        """Return the step, by Cramer's rule, and the decrease that it promises."""
        damping = now.damping[0] * np.sqrt(now.cost)
        a, b, d = now.matrix
        a, d = a + damping, d + damping
        product = a * d
        scale = 1.0 / np.maximum(product - b * b, LEAST_PIVOT * product + np.finfo(np.float64).tiny)
        first, second = now.gradient
        x, y = (d * first - b * second) * scale, (a * second - b * first) * scale
        return np.stack([x, y]), x * (first + damping * x) + y * (second + damping * y)

    def next_damping(self, damping: Float, drop: Float, promised: Float, /) -> Float:
        """Return the damping, which depends on the share of the promise that the step gained."""
        eased = np.where(drop < LESS_THAN_PROMISED * promised, MORE * damping, damping)
        eased = np.where(drop > AS_PROMISED * promised, EASED * damping, eased)
        return np.where(drop > 0.0, eased, FURTHER * damping)


DAMPED = MisfitDamped()


@dataclass(frozen=True)
class Ends:
    """The best end of the searches of n pixels.

    Attributes:
        z: real and imaginary part of the best end, (2, n).
        cost: cost at z, (n,).
        converged: whether the best search ended at a minimum, (n,).
        steps: number of steps of all searches, (n,).
    """

    z: Float
    cost: Float
    converged: Bool
    steps: Int64


def best_ends(
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    /,
    *,
    numbers: range | None = None,
    stopping: MisfitDamped = DAMPED,
) -> Ends:
    """Return the best end of n pixels over all starts, or only over the starts with the given numbers.

    `places` are the flat indices of the pixels in the frame, (n,). Pixels of NaN have no end, and their cost is
    infinite. All kernels give the same bits.
    """
    numbers = range(starts.count) if numbers is None else numbers
    if numbers and (compiled := compiled_search(equations.harmonics, paths=2)) is not None:
        return _compiled_best_ends(compiled, equations, places, starts, numbers, stopping)
    count = places.size
    best = Ends(
        np.full((2, count), np.nan), np.full(count, np.inf), np.zeros(count, np.bool_), np.zeros(count, np.int64)
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


def _compiled_best_ends(
    compiled: ModuleType,
    equations: EliminatedPath,
    places: Index,
    starts: RandomStarts,
    numbers: range,
    stopping: MisfitDamped,
) -> Ends:
    count = places.size
    found = Ends(np.empty((2, count)), np.empty(count), np.empty(count, np.bool_), np.empty(count, np.int64))
    compiled.shares(
        chosen_kernel(),
        numbers.start,
        numbers.stop,
        stopping.max_steps,
        starts.key,
        stopping.relative,
        stopping.absolute,
        stopping.first_damping,
        np.array(equations.harmonics, np.int64),
        *(np.stack(parts) for parts in zip(*equations.right, strict=True)),
        np.ascontiguousarray(places, np.int64),
        found.z,
        found.cost,
        found.converged,
        found.steps,
    )
    return found
