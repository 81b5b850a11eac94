"""The front of the compiled search of Eq. (9): what `search` does, with the same bits."""

import numpy as np

from cadtof_cli.arrays import Index
from cadtof_cli.resolver.likelihood.compiled import MOST_HARMONIC, MOST_ROWS, compiled_search
from cadtof_cli.resolver.paper.equation_9 import EliminatedPath
from cadtof_cli.resolver.paper.records import Ends, RandomStarts, Stopping


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
