"""The front of the compiled twin of `newton.search`, `_search.h`."""

import numpy as np

from cadtof_cli.arrays import Float32
from cadtof_cli.resolver.response.newton import Equations, SearchState, search
from cadtof_cli.resolver.two_path.kernel import NUMPY, extension


def searched(equations: Equations, start: Float32, /, *, steps: int, stage: int = -1) -> SearchState:
    """Return what `search` does, by the kernel of the response's block: all give the same bits."""
    response = equations.response
    if response.kernel == NUMPY:
        return search(equations, start, steps=steps, stage=stage)
    tables = response.stages[stage]
    numbers = [table.harmonic for table in tables]
    constants = [*numbers, *(tables[0].step / number for number in numbers), 1.0 / tables[0].step, *equations.weights]
    count = start.shape[1]
    values, misfit, done = np.empty((4, count), np.float32), np.empty(count, np.float32), np.empty(count, np.bool_)
    phase = None if response.phase_rad is None else response.phase_rad[:, equations.pixels]
    given = (*(table.entries for table in tables), phase, equations.observed, equations.enough, start)
    extension().search(
        response.kernel,
        steps,
        np.array(constants, np.float32),
        *(None if array is None else np.ascontiguousarray(array) for array in given),
        values,
        misfit,
        done,
    )
    return SearchState(values, misfit, done)
