"""Surfaces that become smooth once two paths are taken out.

Second paths that change from pixel to pixel, or from place to place, bend the surfaces that are seen, by as much as
they add to the depth. Without them, surfaces have their own shape. Most are flat, and 1/z of a flat surface is even
over the view. A tail is smooth itself. So little of the bends in a room comes from the tail, and two paths, which do
not explain the tail, leave most of the bends.
"""

import math

import numpy as np

from cadtof_cli.arrays import Bool, Float, median
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchLight, PatchMeans
from cadtof_cli.resolver.diffuse.second_paths import two_path_lag
from cadtof_cli.resolver.diffuse.settings import NEAREST_M, range_from_phase
from cadtof_cli.resolver.diffuse.tail import wrapped

LARGEST_LEFT = {1: 0.08, 2: 0.04}
"""Threshold on the median square of the bends of 1/z that two paths leave, over that before; by the distance of the
patches. Below it, there are two paths. Rendered rooms have .14 and .07 or more, corners that fill the view .23 and .047."""

LARGEST_LEFT_WITHIN = 0.1
"""The same threshold for the bends of the phase from pixel to pixel within patches. Rooms have .24 and more."""

LEAST_BENDS = 64
"""Smallest number of bends that must be seen: fewer do not tell."""


def are_smoothed_by_two_paths(light: PatchLight, means: PatchMeans, lit: Bool, frame: FrameTraits, /) -> bool:
    """Return whether surfaces are smooth, apart from noise, once two paths are taken out of a frame's light.

    `means` are those of the frame's patches; `lit`, (rows, columns), are the patches that count. Field curvature stays
    in the surfaces before and after: it makes nothing smoother.
    """
    with np.errstate(all="ignore"):
        # if there is one path, the delay of the other is NaN
        return _smoothed_between_patches(means, lit, frame) or _smoothed_within_patches(light, lit)


def _smoothed_between_patches(means: PatchMeans, lit: Bool, frame: FrameTraits) -> bool:
    """Return whether two paths make 1/z smooth from patch to patch."""
    lag = two_path_lag(means.ratios[0])
    seen = lit & np.isfinite(lag)
    recorded, direct = (_inverse_depth(phase, frame) for phase in (means.phase_rad, means.phase_rad - lag))
    return any(
        _are_smoother(_bends(direct, seen, distance), _bends(recorded, seen, distance), limit)
        for distance, limit in LARGEST_LEFT.items()
    )


def _smoothed_within_patches(light: PatchLight, lit: Bool) -> bool:
    """Return whether two paths make the phases along the middle row of each patch smooth."""
    side = math.isqrt(len(light.seen))
    row = slice(side // 2 * side, (side // 2 + 1) * side)
    power, _, _, re, im = light.weighted[:5, row]
    ratio = np.empty(power.shape, np.complex128)
    ratio.real, ratio.imag = re / power, im / power
    lag = two_path_lag(ratio)
    seen = light.seen[row] & lit & np.isfinite(lag)
    phase = light.phase_rad[row].astype(np.float64)
    direct, recorded = (wrapped(_bends_along(one, seen, 1)) for one in (phase - lag, phase))
    return _are_smoother(direct, recorded, LARGEST_LEFT_WITHIN)


def _are_smoother(direct: Float, recorded: Float, limit: float) -> bool:
    """Return whether at most this share of the median square of the bends is left; enough of them must be seen."""
    return direct.size >= LEAST_BENDS and float(median(direct * direct)) < limit * float(median(recorded * recorded))


def _inverse_depth(phase_rad: Float, frame: FrameTraits) -> Float:
    """Return 1/z of patches, in 1/m, from their phases."""
    return np.asarray(1.0 / (np.maximum(range_from_phase(phase_rad, frame.settings), NEAREST_M) * frame.grid.ray[2]))


def _bends(image: Float, seen: Bool, distance: int) -> Float:
    """Return the second differences of an image over this distance, down and across, where it is seen."""
    return np.concatenate([_bends_along(image, seen, distance), _bends_along(image.T, seen.T, distance)])


def _bends_along(values: Float, seen: Bool, distance: int) -> Float:
    """Return the second differences along the first axis, where all three values are seen."""
    before, middle, after = slice(-2 * distance), slice(distance, -distance), slice(2 * distance, None)
    bends: Float = values[after] - 2.0 * values[middle] + values[before]
    return bends[seen[after] & seen[middle] & seen[before]]
