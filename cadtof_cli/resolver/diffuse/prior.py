"""What rooms are like before their data are seen: the state's mean, its spread between rooms, and its pattern within a room.

The components are those of `tail.STATE`. The numbers are those that gave the best depths of rendered rooms. They hold
for rooms that were rendered afterwards.
"""

import numpy as np

from cadtof_cli.arrays import Float

MEAN = np.array([np.log(0.95), 0.0, 0.0, np.log(0.1), np.log(12.0), 4.4])
"""Mean over rooms. The albedo is .95 as the radiosity sees it: rooms are closed, but it knows only a part of their
walls. Light beside the view is as within it, and later bounces are as they come. Unseen light is .1 of the direct
light, decays with 12 ns and starts 4.4 ns late, as the light of a surface .65 m beside the target does."""

BETWEEN_ROOMS = np.array([0.38, 0.3, 0.42, 1.8, 0.65, 1.5])
"""Standard deviations between rooms: ln s, ln b, ln u, ln v, ln τ, and t in ns. Light that the view does not show
varies most."""

CORRELATIONS = {(0, 3): 0.45, (3, 5): -0.6, (4, 5): 0.5}
"""Correlations between rooms. Unseen light has bounced more often, so bright rooms have more of it (s and v). Near
walls give more of it, and earlier (v and t). Large rooms keep light longer, and give it later (τ and t)."""

WITHIN_ROOM = np.array([0.15, 0.42, 0.35, 1.2, 0.42, 1.75])
"""Standard deviations between the patches of one room. The scale of the albedo differs least between them."""

WITHIN_PATCH = (1.1 * WITHIN_ROOM, 0.8 * WITHIN_ROOM)
"""Standard deviations between a pixel and its patch, which may lie on an edge: with two harmonics, and with more. With more
harmonics, a patch is better known. The additional width that edges would need brings every pixel more of its own noise."""

UNKNOWN_OPTICS = np.array([0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
"""Standard deviations that are added, squared, if the field of view is assumed: 15 % of focal length are 30 % of every area."""

UNSEEN_GAMMA = 0.7
"""γ in v ~ E^−γ. If a surface gets weak direct light E, unseen light is a larger share; it is less than in proportion
to 1/E."""

TYPICAL_DIRECT = 1.0 / 9.0
"""Direct light cos θ/d², in m⁻², for which the pattern changes nothing: that of a surface 3 m away."""


def pattern(direct: Float, /) -> Float:
    """Return how a room's state differs from patch to patch by rule, (6, n), from the direct light of the patches, (n,)."""
    rule = np.zeros((len(MEAN), direct.size))
    rule[3] = -UNSEEN_GAMMA * np.log(direct / TYPICAL_DIRECT)
    return rule


def within_room(*, known_optics: bool) -> Float:
    """Return the covariance between the patches of a room, (6, 6)."""
    return np.diag(WITHIN_ROOM**2 + (0.0 if known_optics else UNKNOWN_OPTICS**2))


def between_rooms(*, known_optics: bool) -> Float:
    """Return the covariance between rooms, (6, 6)."""
    covariance = np.diag(BETWEEN_ROOMS**2 + (0.0 if known_optics else UNKNOWN_OPTICS**2))
    for (i, j), correlation in CORRELATIONS.items():
        covariance[i, j] = covariance[j, i] = correlation * BETWEEN_ROOMS[i] * BETWEEN_ROOMS[j]
    return covariance
