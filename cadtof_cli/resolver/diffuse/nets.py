"""Surfaces that let light through, inside a room: a net, or a pane that scatters, before a wall that is seen beside it.

A tail can look like any two paths, so a single patch does not tell. But behind a net lies the wall that its neighbours see.
So the tail that is typical of the frame is taken out of every patch's phasors, by division. What is left is resolved as two
paths. If the farther path ends on the plane of such a wall, in several patches side by side, there are two surfaces.
"""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index, median
from cadtof_cli.phasors.rotors import product
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.light import FrameTraits, patch_phasors
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit
from cadtof_cli.resolver.diffuse.patches import LitPatches
from cadtof_cli.resolver.diffuse.records import Nets, Tails
from cadtof_cli.resolver.diffuse.settings import range_from_phase
from cadtof_cli.resolver.diffuse.walls import ON_PLANE, over_neighbours, walls_behind
from cadtof_cli.resolver.paths import FULL_TURN
from cadtof_cli.resolver.two_path.closed_form import TwoPaths
from cadtof_cli.resolver.two_path.decomposition import decomposed

NEAR_SHARE, FAR_SHARE = 0.25, 0.2
"""Least share of the nearer path, and of the farther path, in a patch's light. A smaller share may be an error of the
typical tail."""

APART_NS = (2.0, 18.0)
"""Least and largest delay between the two paths. Closer paths cannot be told apart; later ones have wrapped round the
period."""

ON_WALL_M = 0.15
"""Largest distance of the farther path's end from a wall."""

LEAST_PATCHES = 12
"""Smallest number of patches side by side that must show two paths."""

LEAST_LEFT = 0.2
"""Least amplitude of the farther paths over that of the wall where it is seen freely: the median over a group of
patches. In rendered rooms, .3 to .8 of the amplitude is left behind a net. Paths that a tail only imitates have less,
except in a few rooms, which they hardly harm."""

LARGEST_COVER = 0.4
"""Largest share of the patches that may be covered: the wall behind is known from its parts that are seen beside. Nets
that were rendered or hung cover up to a quarter."""

BESIDE_SHARE = 0.15
"""Least share of the farther path in a patch beside patches that are found, wherever that path ends."""

SAME_NET = 0.06
"""Largest relative difference of range between a patch with two paths and the net beside it to which it belongs."""

STEPS = 3
"""Number of times that the difference between the tails of the two paths is taken away."""

OFF_SHARE, LAG_SHARE = 0.7, 0.2
"""Two standard deviations of the nearer path's phase: one as a share of the distance of the farther paths from the
walls, one as a share of the lag by the tail. Both paths are wrong by the same tail."""


@dataclass(frozen=True, eq=False)
class FreedPaths:
    """Phasors that are freed of tails, (H, …), and the two paths that they are, (…) each.

    `near_rad` is the phase of the nearer path, and `later_rad` how much later the farther path comes, rad. `near_share`
    is the share of the nearer path in the sum of both amplitudes.
    """

    phasors: Complex
    near_rad: Float
    later_rad: Float
    near_share: Float
    far_amplitude: Float


def typical_tail(values: Float, harmonics: tuple[int, ...], /) -> Complex:
    """Return the median H_h, (H,), of patches with the model's values (data + 2, n), in the order of
    `tail.free_of_direct`.
    """
    middle, count = median(values), len(harmonics) - 1
    logarithm = middle[-2] + 1j * middle[-1] * np.array(harmonics)
    logarithm[1:] += middle[:count] + 1j * middle[count : 2 * count]
    tail: Complex = np.exp(logarithm)
    return tail


def freed_paths(phasors: Complex, tails: Tails, /) -> FreedPaths:
    """Resolve phasors (H, …) as two paths, each with its tail, by their first two harmonics.

    The phasors are p_h = a·exp(ihx)·N_h + b·exp(ihy)·F_h. If b·exp(ihy)·(F_h − N_h) is taken away and the rest is
    divided by N_h, the closed form finds the two paths. This is done several times, each time with b and y of the time
    before.
    """
    shape = phasors.shape[1:]
    base = _times(phasors.reshape(len(phasors), -1), 1.0 / tails.near)
    excess = (tails.far - tails.near) / tails.near
    free = base
    with np.errstate(all="ignore"):
        # a patch without light divides zero by zero
        for _ in range(STEPS if excess.any() else 0):
            farther = _farther(decomposed(free[0], free[1]))
            free = base - _times(_at_harmonics(farther, tails.harmonics), excess)
        paths = decomposed(free[0], free[1])
        x, y = paths.phases()
        ahead = np.mod(y - x, FULL_TURN)
        x_near = ahead < np.pi
        near, later = np.where(x_near, x, y), np.where(x_near, ahead, FULL_TURN - ahead)
        far = np.where(x_near, paths.b, paths.a)
        share = 1.0 - far / (paths.a + paths.b)
    near, later, share, far = (part.reshape(shape) for part in (near, later, share, far))
    return FreedPaths(free.reshape(phasors.shape), near, later, share, far)


def _times(phasors: Complex, factors: Complex) -> Complex:
    """Return phasors (H, n) times one factor per harmonic, in real numbers: the same bits wherever a pixel stands."""
    found = np.empty_like(phasors)
    for out, p, factor in zip(found, phasors, factors, strict=True):
        out.real, out.imag = product((p.real, p.imag), (factor.real, factor.imag))
    return found


def _farther(paths: TwoPaths) -> tuple[Float, Float, Float]:
    """Return amplitude, cosine and sine of the farther of two paths that are less than half a turn apart."""
    # sin(y − x) > 0: y is behind x
    y_far = paths.sin_y * paths.cos_x - paths.cos_y * paths.sin_x > 0.0
    return (
        np.where(y_far, paths.b, paths.a),
        np.where(y_far, paths.cos_y, paths.cos_x),
        np.where(y_far, paths.sin_y, paths.sin_x),
    )


def _at_harmonics(path: tuple[Float, Float, Float], harmonics: tuple[int, ...]) -> Complex:
    """Return the phasors of a path at every harmonic, (H, n)."""
    amplitude, cosine, sine = path
    phasors = np.empty((len(harmonics), amplitude.size), np.complex128)
    phasor, power = (amplitude, np.zeros_like(amplitude)), 0
    for out, h in zip(phasors, harmonics, strict=True):
        for _ in range(power, h):
            phasor = product(phasor, (cosine, sine))
        power, (out.real, out.imag) = h, phasor
    return phasors


def find_nets(patches: LitPatches, fit: PatchFit, frame: FrameTraits, uncovered: Bool | None = None, /) -> Nets | None:
    """Return the surface that lets light through in a frame; None if there is none.

    By default, both paths get the tail that is typical of the frame. With `uncovered`, (n,), the nearer path gets the
    tail that is typical of the covered patches, and the farther path that of the uncovered ones.
    """
    settings, valid = frame.settings, patches.valid
    far = typical_tail(fit.posterior if uncovered is None else fit.posterior[:, uncovered], settings.harmonics)
    near = far if uncovered is None else typical_tail(fit.posterior[:, ~uncovered], settings.harmonics)
    tails, phasors = Tails(near, far, settings.harmonics), patch_phasors(patches.means, harmonics=settings.harmonics)
    paths = freed_paths(phasors, tails)
    apart_ns = paths.later_rad / settings.rad_per_ns
    two_paths: Bool = valid & (paths.near_share > NEAR_SHARE) & (paths.near_share < 1.0 - FAR_SHARE)
    two_paths &= (apart_ns > APART_NS[0]) & (apart_ns < APART_NS[1])
    if not _large_groups(two_paths):
        return None
    phase_rad = np.angle(phasors[0])
    phase_rad[valid] -= fit.posterior[-1]
    range_m = range_from_phase(phase_rad, settings)
    near_m = range_from_phase(paths.near_rad, settings)
    far_m = near_m + paths.later_rad * settings.m_per_rad
    wall_amplitude, off_wall_m = _nearest_wall(
        far_m, range_m, np.abs(phasors[0] / tails.far[0]), valid & ~two_paths, frame.grid
    )
    with np.errstate(invalid="ignore"):
        amplitude_left = paths.far_amplitude / wall_amplitude
    found = np.zeros_like(two_paths)
    for group in _large_groups(two_paths & (off_wall_m < ON_WALL_M)):
        found[group] = np.median(amplitude_left[group]) >= LEAST_LEFT
    if not found.any():
        return None
    off_rad = float(np.median(off_wall_m[found])) / settings.m_per_rad
    typical_rad = float(np.angle(tails.far[0]))
    more = valid & (paths.near_share > NEAR_SHARE) & (paths.near_share < 1.0 - BESIDE_SHARE) & (apart_ns > APART_NS[0])
    found = _grown(found, more, near_m)
    if found.sum() > LARGEST_COVER * valid.sum():
        return None
    variance = (OFF_SHARE * off_rad) ** 2 + (LAG_SHARE * typical_rad) ** 2
    return Nets(found, _with_surroundings(near_m, found), tails, variance)


def _with_surroundings(near_m: Float, found: Bool) -> Float:
    """Return the ranges of the patches found, their mean over the neighbours in the patches around, and NaN elsewhere."""
    count, total = over_neighbours(found.astype(np.float64)), over_neighbours(np.where(found, near_m, 0.0))
    with np.errstate(invalid="ignore"):
        return np.where(found, near_m, total / count)


def _grown(found: Bool, more: Bool, near_m: Float) -> Bool:
    """Return the patches found, and patches of `more` that join them, directly or by others, at nearly the same range."""
    while True:
        around = _with_surroundings(near_m, found)
        grown = found | (more & (np.abs(near_m - around) < SAME_NET * near_m))
        if (grown == found).all():
            return found
        found = grown


def _nearest_wall(far_m: Float, range_m: Float, amplitude: Float, among: Bool, grid: PatchGrid) -> tuple[Float, Float]:
    """Return the amplitude of the wall nearest to each range `far_m`, and the distance from that range to the wall.

    The amplitude is that of the patches `among` on the wall. All are (rows, columns); infinite if `among` sees no wall.
    """
    walls = walls_behind(range_m, among, grid)
    if not len(walls):
        return np.full(far_m.shape, np.inf), np.full(far_m.shape, np.inf)
    on_wall = among & (np.abs(walls - range_m) < ON_PLANE * range_m)
    amplitudes = np.array([median(amplitude[members]) if members.any() else np.inf for members in on_wall])
    distance_m = np.abs(walls - far_m)
    return amplitudes[distance_m.argmin(axis=0)], distance_m.min(axis=0)


def _large_groups(patches: Bool) -> list[tuple[Index, ...]]:
    """Return the groups of at least `LEAST_PATCHES` patches side by side, corners included, as (rows, columns) each."""
    waiting = {(int(row), int(column)) for row, column in np.argwhere(patches)}
    groups = []
    while waiting:
        group, edge = [], [waiting.pop()]
        while edge:
            row, column = here = edge.pop()
            group.append(here)
            beside = {(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & waiting
            waiting -= beside
            edge.extend(beside)
        if len(group) >= LEAST_PATCHES:
            groups.append(tuple(np.array(group).T))
    return groups
