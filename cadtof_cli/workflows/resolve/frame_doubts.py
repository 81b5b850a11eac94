"""What is likely wrong with a single frame of a run, in words. Nearly all frames are told to be sound in microseconds."""

import numpy as np

from cadtof_cli.arrays import Bool, Stored
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA, MISFIT
from cadtof_cli.phasors.doubts import doubt_of_planes
from cadtof_cli.phasors.plausible import FEWEST, stuck_bit
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.resolver.status import StatusCounts
from cadtof_cli.units import unambiguous_range_m

UNEXPLAINED = 8.0
"""How far the median χ² of a frame may exceed the number of values that two paths leave over. Where paths explain the light,
it is about this number."""

FEW_OF_ONE_PATH = 0.125
"""Planes of a frame are looked at if no more of its answers than this share are one path: wrong planes leave hardly any."""

AT_THE_END, KNOWN = 0.02, 0.01
"""Neighbours lie on both sides of the end of the range if they are nearer to it than the first share of the range, and if both
have a sigma below the second: pixels without light have a larger one."""


def frame_doubts(stored: Stored | None, maps: DepthMaps, counts: StatusCounts, plan: FramePlan, /) -> tuple[str, ...]:
    """Return in words what is likely wrong with the maps of a frame, (H, 2, Y, X); `stored` is None for a mean of frames."""
    answers, planes = counts.one_path + counts.two_paths + counts.diffuse, None
    stuck = None if stored is None else stuck_bit(stored, plan.metadata)
    several = plan.resolver.order == "auto" and counts.one_path <= FEW_OF_ONE_PATH * answers
    if stored is not None and several and not stuck:
        # a calibration shows that the planes are in order
        planes = doubt_of_planes(stored, plan.metadata, of_order=plan.calibration is None)
    return tuple(told for told in (_wrapped_in_words(maps, plan), _misfit_in_words(maps, plan), stuck, planes) if told)


def _misfit_in_words(maps: DepthMaps, plan: FramePlan) -> str | None:
    """Return in words that the paths of a frame do not explain its light; None: they do, or one path was asked for."""
    if MISFIT not in maps.names or plan.resolver.max_paths < 2:
        return None
    layer, most = maps.layer(MISFIT), UNEXPLAINED + 2 * (len(plan.metadata.modulation.harmonics) - 2)
    misfit = layer[np.isfinite(layer)]
    # counted, not sorted: a median takes longer than many a frame
    if misfit.size < FEWEST or 2 * np.count_nonzero(misfit > most) <= misfit.size:
        return None
    return f"its paths do not explain the light (median chi_squared above {most:.0f}), so errors are larger than sigma"


def _wrapped_in_words(maps: DepthMaps, plan: FramePlan) -> str | None:
    """Return in words that surfaces go on beyond the range, as many neighbours at 0 and at its end show; else None."""
    end = unambiguous_range_m(plan.metadata.modulation.periods_ns[0])
    depth, sigma = maps.layer(DIRECT_DEPTH), maps.layer(DIRECT_SIGMA)
    near = depth < AT_THE_END * end
    # nearly all frames end here: no view shows much that is so near
    if np.count_nonzero(near) < FEWEST:
        return None
    known = sigma < KNOWN * end
    near, far = near & known, (depth > (1.0 - AT_THE_END) * end) & known
    if sum(_beside(*pair) for pair in ((near, far), (far, near), (near.T, far.T), (far.T, near.T))) < FEWEST:
        return None
    return (
        f"depths go on at 0 where surfaces are {end:.3g} m away, the range of periods_ns: what is farther comes out "
        f"{end:.3g} m too near"
    )


def _beside(left: Bool, right: Bool) -> int:
    """Return how many pixels of one mask, (Y, X), lie to the left of one of the other."""
    return int(np.count_nonzero(left[:, :-1] & right[:, 1:]))
