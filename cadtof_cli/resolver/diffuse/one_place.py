"""Second paths whose light comes from one place: a mirror's image of the lamp, or a bright surface beside the view.

Light by way of a place R reaches a surface at P later than on the straight way, by a + |R − P| − |P|. Here a is how far
the light goes before it comes from R. It may be 0 or less for an image in a mirror or a lens. All lengths in this
module are those of light that goes one way, as the phase, in rad, that the fundamental gains by them.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.quantiles import median

STARTS = 1.5 * np.array([(1.0, 0.0, 0.5), (-1.0, 0.0, 0.5)])
"""Where the search for the place starts, in median ranges of the surfaces: once to the right, once to the left."""

STEPS = 8
"""Gauss–Newton steps from each start."""

FARTHEST_STEP = 1.0
"""Largest step of the place, in median ranges."""

DAMPING = 1e-4
"""What is added to the place's part of the normal equations, over the mean of their diagonal. If all surfaces lie on
one plane, delays do not tell a place before the plane from one behind it."""

TINY = 1e-300
"""Keeps data without noise or distance, and a fit that is exact to the bit, from dividing by zero."""


def residual_after_one_place(later_rad: Float, variance: Float, positions: Float, /) -> Float:
    """Return the residuals of delays, (n,), with these variances, (n,), after the one place that explains most of them.

    `positions`, (3, n), are those of the surfaces: right, down and away from the camera.
    """
    range_rad = np.sqrt((positions * positions).sum(axis=0))
    scale = float(median(range_rad)) + TINY
    weight = 1.0 / np.maximum(variance, float(median(variance)) / 9.0 + TINY)
    residual = [_residual_from(later_rad, weight, positions, range_rad, scale * place, scale) for place in STARTS]
    return min(residual, key=lambda one: float(median(one * one)))


def _residual_from(
    later_rad: Float, weight: Float, positions: Float, range_rad: Float, place: Float, scale: float
) -> Float:
    """Return the residuals, (n,), after the place that a search from `place`, (3,), finds; outliers have little weight."""
    to_place, distance = _vectors_to(place, positions)
    way_before = float(median(later_rad - distance + range_rad))
    for _ in range(STEPS):
        residual = later_rad - (way_before + distance - range_rad)
        slopes = np.concatenate([np.ones((1, range_rad.size)), to_place / distance])
        weighted = slopes * (weight / (1.0 + residual * residual / (4.0 * float(median(residual * residual)) + TINY)))
        normal = weighted @ slopes.T
        normal[range(1, 4), range(1, 4)] += DAMPING * np.trace(normal) / 4.0
        step = np.linalg.solve(normal, weighted @ residual)
        step /= max(1.0, float(np.sqrt((step[1:] ** 2).sum())) / (FARTHEST_STEP * scale))
        way_before, place = way_before + float(step[0]), place + step[1:]
        to_place, distance = _vectors_to(place, positions)
    return later_rad - (way_before + distance - range_rad)


def _vectors_to(place: Float, positions: Float) -> tuple[Float, Float]:
    """Return the vectors from positions, (3, n), to a place, and their lengths, (n,)."""
    to_place = place[:, None] - positions
    return to_place, np.sqrt((to_place * to_place).sum(axis=0)) + TINY
