"""Surfaces that let light through, inside a room: a net, or a pane that scatters, before a wall that is seen beside it.

A tail can look like any two paths, so no patch alone tells. But behind a net lies the wall that its neighbours see. So the tail
that is typical of the frame is taken out of every patch's phasors, by division; what is left is resolved as two paths; and
where the farther one ends on the plane of such a wall, in patch beside patch, there are two surfaces.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.records import SeenThrough, range_from_phase
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.diffuse.walls import over_neighbours, walls_behind
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths

NEAR_SHARE, FAR_SHARE = 0.25, 0.2
"""Least share of the nearer and of the farther path in a patch's light: below, it may be what the typical tail is wrong by."""

APART_NS = (2.0, 18.0)
"""Least and largest delay between the two: closer ones cannot be told, and later ones come from round the period."""

ON_WALL_M = 0.15
"""How far from a wall the farther path may end."""

LEAST_PATCHES = 10
"""Patches side by side that must say the same: at most 8 do in rendered rooms without a net."""

SAME_NET = 0.06
"""Relative difference of range within which a patch with two paths belongs to the net beside it."""

FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class FreedPaths:
    """Two paths freed of a tail: phase of the nearer, how much later the farther comes, rad, and the nearer's share of the light."""

    near_rad: Float
    later_rad: Float
    near_share: Float


def typical_tail(values: Float, harmonics: tuple[int, ...], /) -> Complex:
    """Return the median H_h, (H,), of patches with the model's values (data + 2, n), in the order of `tail.free_of_direct`."""
    middle, count = np.median(values, axis=1), len(harmonics) - 1
    size = np.append(0.0, middle[:count]) + middle[-2]
    phase = np.append(0.0, middle[count : 2 * count]) + np.array(harmonics) * middle[-1]
    tail: Complex = np.exp(size + 1j * phase)
    return tail


def freed(phasors: Complex, tail: Complex, /) -> Complex:
    """Return phasors (H, …) divided by a tail's H_h, (H,)."""
    free = np.empty_like(phasors)
    for out, p, h in zip(free, phasors, 1.0 / tail, strict=True):
        # in real numbers, so that a pixel gets the same bits wherever it stands
        out.real, out.imag = p.real * h.real - p.imag * h.imag, p.real * h.imag + p.imag * h.real
    return free


def freed_paths(phasors: Complex, tail: Complex, /) -> FreedPaths:
    """Resolve phasors (H, …), freed of a tail, as two paths, by their first two harmonics."""
    first, second = freed(phasors[:2], tail[:2]).reshape(2, -1)
    with np.errstate(all="ignore"):
        # without light, zero is divided by zero
        paths = two_paths(fundamental_frame(first, second))
        x, y = paths.phases()
        ahead = np.mod(y - x, FULL_TURN)
        x_near = ahead < np.pi
        near, later = np.where(x_near, x, y), np.where(x_near, ahead, FULL_TURN - ahead)
        share = np.where(x_near, paths.a, paths.b) / (paths.a + paths.b)
    shape = phasors.shape[1:]
    return FreedPaths(near.reshape(shape), later.reshape(shape), share.reshape(shape))


def seen_through(
    phasors: Complex, range_m: Float, valid: Bool, tail: Complex, /, *, grid: PatchGrid, settings: DiffuseSettings
) -> SeenThrough | None:
    """Return what lets light through; None where nothing does.

    Args:
        phasors: of the patches, (H, rows, columns).
        range_m: of their surfaces where a tail is all their MPI, (rows, columns).
        valid: patches that count, (rows, columns).
        tail: H_h that is typical of the frame, (H,).
        grid: where the patches lie.
        settings: how phases become metres.
    """
    paths = freed_paths(phasors, tail)
    apart_ns = paths.later_rad / settings.rad_per_ns
    two: Bool = valid & (paths.near_share > NEAR_SHARE) & (paths.near_share < 1.0 - FAR_SHARE)
    two &= (apart_ns > APART_NS[0]) & (apart_ns < APART_NS[1])
    if two.sum() < LEAST_PATCHES:
        return None
    near_m = range_from_phase(paths.near_rad, settings)
    far_m = near_m + paths.later_rad * settings.m_per_rad
    missed = np.abs(walls_behind(range_m, valid & ~two, grid) - far_m).min(axis=0, initial=np.inf)
    on_wall = two & (missed < ON_WALL_M)
    found = _together(on_wall)
    if not found.any():
        return None
    off = np.median(missed[found]) / settings.m_per_rad
    return SeenThrough(found, _with_surroundings(near_m, found), tail, float(off**2))


def _with_surroundings(near_m: Float, found: Bool) -> Float:
    """Return ranges where found, their means over neighbours in the patches around, and NaN elsewhere."""
    count, total = over_neighbours(found.astype(np.float64)), over_neighbours(np.where(found, near_m, 0.0))
    around = np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan)
    return np.where(found, near_m, around)


def _together(patches: Bool) -> Bool:
    """Return those of the patches that lie side by side, corners included, with enough others."""
    left = {(int(row), int(column)) for row, column in np.argwhere(patches)}
    found = np.zeros_like(patches)
    while left:
        group, edge = [], [left.pop()]
        while edge:
            row, column = here = edge.pop()
            group.append(here)
            beside = {(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & left
            left -= beside
            edge.extend(beside)
        if len(group) >= LEAST_PATCHES:
            found[tuple(np.array(group).T)] = True
    return found
