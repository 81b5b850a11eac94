"""What rooms are like before their data are seen: the state's mean, its spread between rooms, and its pattern within one.

The components are those of `tail.STATE`. The numbers are medians and spreads over a dozen rendered rooms, and
hold for rooms that were rendered afterwards.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.units import C_M_PER_NS

MEAN = np.array([np.log(0.85), 0.0, np.log(0.05), np.log(12.0), 1.0])
"""Mean albedo .85 as the radiosity sees it (the view is open where rooms are closed), later bounces as they come, unseen light
that starts at .05 of the direct light, decays with 12 ns, and starts 1 ns after `tail.EARLIEST_NS`."""

BETWEEN_ROOMS = np.array([0.3, 0.5, 1.75, 0.6, 2.5])
"""Standard deviations between rooms: ln s, ln u, ln v, ln τ, and ns. What the view does not show varies most."""

WITHIN_ROOM = 0.7 * BETWEEN_ROOMS
"""Standard deviations between the patches of one room."""

WITHIN_PATCH = 0.5 * WITHIN_ROOM
"""Standard deviations between a pixel and its patch."""

UNKNOWN_OPTICS = np.array([0.3, 0.3, 0.0, 0.0, 0.0])
"""Standard deviations that come on top where the field of view is assumed: 15 % of focal length are 30 % of every area."""

UNSEEN_GAMMA = 0.7
"""v ~ E^−γ: where a surface gets weak direct light E, unseen light is more of the whole; less than in proportion."""

DECAY_GAMMA = 0.2
"""τ ~ E^−γ: weakly lit surfaces are far, in larger spaces."""

START_SHARE = 0.2
"""t falls by this share of a surface's own delay: walls behind the camera are late, but those near a far surface are early."""

TYPICAL_DIRECT = 1.0 / 9.0
"""Direct light cos θ/d² for which the pattern changes nothing: a surface 3 m away, m⁻²."""

TYPICAL_DELAY_NS = 20.0
"""Delay for which the pattern changes nothing: 3 m."""


def pattern(range_m: Float, direct: Float, /) -> Float:
    """Return how a room's state differs from patch to patch by rule, (5, n), from their ranges and direct light, (n,)."""
    light = np.log(direct / TYPICAL_DIRECT)
    early = TYPICAL_DELAY_NS - 2.0 * range_m / C_M_PER_NS
    nothing = np.zeros_like(light)
    return np.stack([nothing, nothing, -UNSEEN_GAMMA * light, -DECAY_GAMMA * light, START_SHARE * early])


def within_room(*, known_optics: bool) -> Float:
    """Return the standard deviations between the patches of a room."""
    return WITHIN_ROOM if known_optics else np.hypot(WITHIN_ROOM, UNKNOWN_OPTICS)


def between_rooms(*, known_optics: bool) -> Float:
    """Return the standard deviations between rooms."""
    return BETWEEN_ROOMS if known_optics else np.hypot(BETWEEN_ROOMS, UNKNOWN_OPTICS)
