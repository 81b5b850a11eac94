"""Second paths whose light comes from one place: a mirror's image of the lamp, or a bright surface beside the view.

By a place R, light reaches a surface at P later than by the straight way, by a + |R − P| − |P|: a is how far it goes before it
comes from R, less than nothing for the image in a mirror or a lens. All lengths here are those of light that goes one way, as
the phase, rad, that the fundamental gains by them.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.quantiles import median

AT_FIRST = 1.5 * np.array([(1.0, 0.0, 0.5), (-1.0, 0.0, 0.5)])
"""Where the place is looked for at first, in median ranges of the surfaces: right and left."""

STEPS = 8
"""Gauss–Newton steps from each."""

FARTHEST_STEP = 1.0
"""Largest step, in median ranges."""

DAMPING = 1e-4
"""What is added to the place's part of the normal equations, over their mean: of surfaces on one plane, delays say the same of
places before and behind it."""

TINY = 1e-300
"""Keeps what has no noise, no distance, or fits to the bit, from dividing by zero."""


def missed_by_one_place(later_rad: Float, variance: Float, positions: Float, /) -> Float:
    """Return what delays, (n,), with these variances, (n,), differ by from those of light by the one place that explains most.

    `positions`, (3, n), are those of the surfaces: right, down and away from the camera.
    """
    range_rad = np.sqrt((positions * positions).sum(axis=0))
    scale = float(median(range_rad)) + TINY
    weight = 1.0 / np.maximum(variance, float(median(variance)) / 9.0 + TINY)
    missed = [_missed(later_rad, weight, positions, range_rad, scale * place, scale) for place in AT_FIRST]
    return min(missed, key=lambda one: float(median(one * one)))


def _missed(later_rad: Float, weight: Float, positions: Float, range_rad: Float, place: Float, scale: float) -> Float:
    """Return what is missed, (n,), by the place that is found from `place`, (3,); few delays that are far off count little."""
    away, distance = _seen_from(place, positions)
    before = float(median(later_rad - distance + range_rad))
    for _ in range(STEPS):
        missed = later_rad - (before + distance - range_rad)
        slopes = np.concatenate([np.ones((1, range_rad.size)), away / distance])
        weighted = slopes * (weight / (1.0 + missed * missed / (4.0 * float(median(missed * missed)) + TINY)))
        normal = weighted @ slopes.T
        normal[range(1, 4), range(1, 4)] += DAMPING * np.trace(normal) / 4.0
        step = np.linalg.solve(normal, weighted @ missed)
        step /= max(1.0, float(np.sqrt((step[1:] ** 2).sum())) / (FARTHEST_STEP * scale))
        before, place = before + float(step[0]), place + step[1:]
        away, distance = _seen_from(place, positions)
    return later_rad - (before + distance - range_rad)


def _seen_from(place: Float, positions: Float) -> tuple[Float, Float]:
    """Return the ways from positions, (3, n), to a place, and their lengths, (n,)."""
    away = place[:, None] - positions
    return away, np.sqrt((away * away).sum(axis=0)) + TINY
