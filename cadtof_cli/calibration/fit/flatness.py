"""Whether a target was the flat wall that a calibration took it for: what is left over the array, in blocks.

Medians of blocks keep what a scene has, shapes and the paths that it adds, and little of noise and of pixels' own phases.
They are held against lengths, not against noise: many frames make a sound camera's small errors visible, and those are no
reason to refuse it.
"""

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index

BLOCKS = 12
"""Blocks that the shorter side of the array has, as far as it has pixels enough."""

LEAST_IN_BLOCK = 4
"""Values from which on a block's median counts."""

MEDIAN_VARIANCE = 0.5 * np.pi
"""Variance of a median over that of a mean, for Gaussian values."""

SURE = 3.0
"""Standard deviations by which blocks must depart more than the scatter within them explains."""


def blocks(where: Bool, /) -> list[Index]:
    """Return which values lie in each square block of the array, of those blocks that have enough of them.

    The values are those of the pixels that `where`, (Y, X), names, row by row.
    """
    size = max(2, -(-min(where.shape) // BLOCKS))
    rows, columns = np.nonzero(where)
    block = (rows // size) * (where.shape[1] // size + 1) + columns // size
    order = np.argsort(block, kind="stable")
    _, starts = np.unique(block[order], return_index=True)
    return [places for places in np.split(order, starts[1:]) if places.size >= LEAST_IN_BLOCK]


def shape_rms(values: Float, where: Bool, /) -> float:
    """Return the root mean square of the blocks' medians, less what the scatter within blocks makes of them; 0 at least.

    The values, (m,), are those that `blocks` counts.
    """
    groups = [values[places] for places in blocks(where)]
    if not groups:
        return 0.0
    square = float(np.mean([np.median(group) ** 2 for group in groups]))
    chance = MEDIAN_VARIANCE * float(np.mean([np.var(group, ddof=1) / group.size for group in groups]))
    return float(np.sqrt(max(0.0, square - (1.0 + SURE * np.sqrt(2.0 / len(groups))) * chance)))
