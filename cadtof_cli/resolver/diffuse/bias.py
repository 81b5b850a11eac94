"""The bias of two harmonics: the share of itself by which a fitted lag is too small on average in views like this one.

Early light hardly changes the ratio of two harmonics, but it changes the lag. How much early light there is depends on the
kind of room that a view shows, and the fit knows no kinds of rooms. Alone, it puts rooms that are seen from near too near,
and rooms of which nothing near is seen too far. Other numbers of a view matter in the same way. The slopes are those of a
regression over 294 rendered rooms. No number of a view was found that tells the rest. Three harmonics see early light.
"""

import numpy as np

from cadtof_cli.arrays import Float, median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.planes import Surfaces

NEAREST, FARTHEST = 0.1, 0.9
"""Quantiles of the patches' ranges that count as the nearest and as the farthest range of a view."""

LEAST_CONTRAST = 0.05
"""Scatter of the logarithms of the patches' amplitudes below which a view shows one even surface, and no room. All
rooms have more than .07."""

ENOUGH_EXCESS = 0.27
"""Share of itself by which the lag must exceed that of two paths for all of the missed share to count. Below it, the
missed share counts in proportion. If two paths say what the tail says, as in a plain corner, nothing is missed. One
room in forty has less."""

SLOWER_LESS = 0.06
"""By how much the missed share of the lag falls per unit of slowness beyond 1. A slow modulation hardly tells how late light
is. So the fit goes to what is usual of rooms, which is more than is there. Chosen with 24 rooms at periods of 60 and 100 ns."""

LEFT_NS, ENOUGH_NS = 0.115, 0.067
"""Standard deviation of what is left of the lag of a frame whose MPI is a tail, 1.7 cm; and the difference of the lag
from that of two paths at which half of it counts. If two paths say the same as the tail, less can be missed. Both are
of a phase, and grow with slowness."""


@dataclass(frozen=True)
class ViewNumbers:
    """What kind of a view a frame has.

    Attributes:
        near: logarithm of the nearest range, in m.
        contrast: logarithm of the scatter of the logarithms of the patches' amplitudes.
        excess: share of the lag by which it exceeds that of two paths.
        deep: logarithm of the farthest range over the nearest.
        facing: mean square of the cosines between the patches' normals and the direction that most of them face.
        albedo: ln s of the room.
        seen: share of the lag by surfaces in the view.
        decay: ln τ of the room.
    """

    near: float
    contrast: float
    excess: float
    deep: float
    facing: float
    albedo: float
    seen: float
    decay: float


MEAN = 0.038
"""Share of the lag that is missed in a view with the numbers `MIDDLE`."""

MIDDLE = ViewNumbers(
    near=0.405, contrast=-1.386, excess=0.42, deep=0.693, facing=0.55, albedo=-0.45, seen=0.0, decay=2.6
)
"""Numbers of a view from which the slopes count: its nearest surfaces are 1.5 m away, its farthest twice that."""

SLOPES = ViewNumbers(
    near=0.068, contrast=-0.026, excess=-0.195, deep=0.023, facing=0.105, albedo=-0.045, seen=-0.128, decay=0.024
)
"""How the missed share changes with each number. Near rooms keep their light for a shorter time than the prior has it, and
it comes to them from nearer: less is missed. If all that is seen is alike or faces one way, more of the room is unseen. If
the albedo is fitted low, early light was taken for none. The slopes are three quarters of those of the regression."""

LEAST = ViewNumbers(near=-0.6, contrast=-1.0, excess=-0.15, deep=-0.5, facing=-0.2, albedo=-0.5, seen=0.0, decay=-0.7)
MOST = ViewNumbers(near=0.3, contrast=0.7, excess=0.15, deep=0.7, facing=0.4, albedo=0.5, seen=0.45, decay=0.9)
"""Least and largest departure from the middle that counts. Nineteen of twenty rooms are within. Nearest surfaces at 2 m
and more count alike."""


@dataclass(frozen=True)
class Bias:
    """What all patches of a frame have in common.

    `share` is the share of the lag that the fit misses. `sigma_rad` is the standard deviation of the lag, in rad, once
    this share is added.
    """

    share: float
    sigma_rad: float


def missed_share(view: ViewNumbers, /, *, slowness: float) -> float:
    """Return the share of the lag that is missed on average in such views; `slowness` is that of `DiffuseSettings`."""
    share = MEAN - SLOWER_LESS * (slowness - 1.0)
    rows = (vars(numbers).values() for numbers in (view, MIDDLE, SLOPES, LEAST, MOST))
    for value, middle, slope, least, most in zip(*rows, strict=True):
        share += slope * min(max(value - middle, least), most)
    return share * min(max(view.excess / ENOUGH_EXCESS, 0.0), 1.0)


def remaining_sigma_rad(lag_rad: Float, two_path_rad: Float, /, *, rad_per_ns: float, slowness: float) -> float:
    """Return the standard deviation of what is left of the lag, from the lags of n patches and those of two paths, (n,)."""
    difference_ns = abs(float(median(lag_rad - two_path_rad))) / rad_per_ns
    return rad_per_ns * (slowness * LEFT_NS) * difference_ns / (difference_ns + slowness * ENOUGH_NS)


def view_numbers(
    room: Float, surfaces: Surfaces, amplitude: Float, /, *, lag_rad: Float, seen_rad: Float, two_path_rad: Float
) -> ViewNumbers | None:
    """Return the numbers of a view of n patches; None if the patches do not lag, or are too much alike for a room.

    Args:
        room: state of the frame, (6,).
        surfaces: surfaces of the patches.
        amplitude: amplitude of their first phasors, (n,).
        lag_rad: their lags, (n,).
        seen_rad: the part of these lags by surfaces in the view, (n,).
        two_path_rad: their lags by two paths, (n,).
    """
    lag, contrast = float(median(lag_rad)), float(np.std(np.log(amplitude)))
    if lag <= 0.0 or contrast < LEAST_CONTRAST:
        return None
    ordered = np.sort(surfaces.range_m)
    nearest, farthest = (float(ordered[int(share * (ordered.size - 1))]) for share in (NEAREST, FARTHEST))
    among = surfaces.normal @ surfaces.normal.T / ordered.size
    return ViewNumbers(
        near=float(np.log(nearest)),
        contrast=float(np.log(contrast)),
        excess=float(median(lag_rad - two_path_rad)) / lag,
        deep=float(np.log(farthest / nearest)),
        facing=float(np.linalg.eigvalsh(among)[-1]),
        albedo=float(room[0]),
        seen=float(median(seen_rad)) / lag,
        decay=float(room[4]),
    )
