"""Which way two harmonics lean: by which share of itself a fitted lag is too small on average in views like this one.

Early light hardly changes the ratio of two harmonics, but the lag; how much of it there is depends on what kind of room a view
shows, and the fit does not know kinds of rooms: alone, it puts rooms seen from near too near, and those of which nothing near is
seen too far; and so on for what else a view shows. The slopes are those of a regression over 294 rendered rooms. What is left no
number of a view was found to tell. Three harmonics see early light.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.quantiles import median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.planes import Surfaces

NEAREST, FARTHEST = 0.1, 0.9
"""Shares of the patches below which the nearest and the farthest range of a view lie."""

LEAST_CONTRAST = 0.05
"""Scatter of the logarithms of the patches' amplitudes below which a view is of one even surface, and no room: all rooms have
more than .07."""

ENOUGH_MORE = 0.27
"""Share of itself by which the lag must exceed what two paths make of it for all of the missed share to count. Below that it
counts in proportion, and where two paths say what the tail says, as in a plain corner, nothing is missed. Of forty rooms one has
less."""

SLOWER_LESS = 0.06
"""By how much less of the lag is missed per unit of slowness beyond 1: a slow modulation hardly tells how late light is, and the
fit goes to what is usual of rooms, more than is there. Chosen with 24 rooms at periods of 60 and 100 ns."""

LEFT_NS, ENOUGH_NS = 0.115, 0.067
"""Standard deviation of what is left of the lag of a frame whose MPI is a tail, 1.7 cm; and by how much the lag exceeds what two
paths make of it where it is half of that: where they say the same as the tail, there is less that could be missed. Both are
of a phase, and grow with slowness."""


@dataclass(frozen=True)
class ViewNumbers:
    """What kind of a view a frame has.

    Attributes:
        near: logarithm of the nearest range, in m.
        contrast: logarithm of how much the logarithms of the patches' amplitudes scatter.
        more: share of the lag that is more than what two paths make of it.
        deep: logarithm of farthest over nearest range.
        facing: mean square of the cosines between the patches' normals and the direction that most of them face.
        albedo: ln s of the room.
        seen: share of the lag that is put down to surfaces in the view.
        decay: ln τ of the room.
    """

    near: float
    contrast: float
    more: float
    deep: float
    facing: float
    albedo: float
    seen: float
    decay: float


MEAN = 0.038
"""Share of the lag that is missed by a view whose numbers are those of `MIDDLE`."""

MIDDLE = ViewNumbers(near=0.405, contrast=-1.386, more=0.42, deep=0.693, facing=0.55, albedo=-0.45, seen=0.0, decay=2.6)
"""Numbers of a view from which the slopes count: its nearest surfaces 1.5 m away, the farthest twice that."""

SLOPES = ViewNumbers(
    near=0.068, contrast=-0.026, more=-0.195, deep=0.023, facing=0.105, albedo=-0.045, seen=-0.128, decay=0.024
)
"""How the share changes with each of them. Near rooms keep their light for less long than the prior has it, and are lit by it
from nearer: there is less to add. Where all that is seen is alike or faces one way, more of the room is unseen; where the albedo
is fitted low, early light was taken for none. They are three quarters of what the regression says."""

LEAST = ViewNumbers(near=-0.6, contrast=-1.0, more=-0.15, deep=-0.5, facing=-0.2, albedo=-0.5, seen=0.0, decay=-0.7)
MOST = ViewNumbers(near=0.3, contrast=0.7, more=0.15, deep=0.7, facing=0.4, albedo=0.5, seen=0.45, decay=0.9)
"""Departures from the middle that count at the most: nineteen of twenty rooms have less. Nearest surfaces 2 m away and more are
alike."""


@dataclass(frozen=True)
class Leaning:
    """What all patches of a frame have in common: the share of the lag that the fit misses, and the standard deviation of the lag
    that remains when this is added, in rad.
    """

    share: float
    left_rad: float


def missed_share(view: ViewNumbers, /, *, slowness: float) -> float:
    """Return the share of the lag that is missed on average in such views; `slowness` is that of `DiffuseSettings`."""
    share = MEAN - SLOWER_LESS * (slowness - 1.0)
    rows = (vars(numbers).values() for numbers in (view, MIDDLE, SLOPES, LEAST, MOST))
    for value, middle, slope, least, most in zip(*rows, strict=True):
        share += slope * min(max(value - middle, least), most)
    return share * min(max(view.more / ENOUGH_MORE, 0.0), 1.0)


def left_rad(lag_rad: Float, two_path_rad: Float, /, *, rad_per_ns: float, slowness: float) -> float:
    """Return the standard deviation of what is left of the lag that n patches have, (n,), and two paths would."""
    more_ns = abs(float(median(lag_rad - two_path_rad))) / rad_per_ns
    return rad_per_ns * (slowness * LEFT_NS) * more_ns / (more_ns + slowness * ENOUGH_NS)


def view_numbers(
    room: Float, surfaces: Surfaces, amplitude: Float, /, *, lag_rad: Float, seen_rad: Float, two_path_rad: Float
) -> ViewNumbers | None:
    """Return the numbers of a view of n patches; None where they do not lag, or are alike as those of no room are.

    Args:
        room: the frame's state, (6,).
        surfaces: what the patches show.
        amplitude: of their first phasors, (n,).
        lag_rad: their lags, (n,).
        seen_rad: how much of them is put down to surfaces in the view, (n,).
        two_path_rad: what two paths make of them, (n,).
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
        more=float(median(lag_rad - two_path_rad)) / lag,
        deep=float(np.log(farthest / nearest)),
        facing=float(np.linalg.eigvalsh(among)[-1]),
        albedo=float(room[0]),
        seen=float(median(seen_rad)) / lag,
        decay=float(room[4]),
    )
