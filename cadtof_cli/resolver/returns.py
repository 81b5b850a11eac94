"""Which path is called direct: the first, strongest or last return."""

import numpy as np

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.paths import Path, PathSet
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import FULL_TURN

ECHO_RATIO = 0.5
"""A path below this share of the other's amplitude, and over half a turn ahead of it, is its echo, wrapped round the range."""


def direct_and_mpi(x: Path, y: Path, settings: ResolverSettings, /) -> tuple[Path, Path]:
    """Call one of two paths direct: the first or last that is strong enough, or the strongest.

    Phases repeat after a full turn, so a late echo of a far wall shows up ahead of it. Light that took the long way is the
    weaker: a path of less than half the other's amplitude that seems to come over half a turn before it is therefore put
    behind it, and its phase as the MPI path's goes on beyond 2π.
    """
    x_chosen: Bool
    lead = y.phase_rad - x.phase_rad
    x_wraps = (lead > 0.5 * FULL_TURN) & (x.amplitude < ECHO_RATIO * y.amplitude)
    y_wraps = (lead < -0.5 * FULL_TURN) & (y.amplitude < ECHO_RATIO * x.amplitude)
    if settings.returns == "strongest":
        x_chosen = x.amplitude >= y.amplitude
    else:
        x_before = ((lead >= 0.0) & ~x_wraps) | y_wraps
        x_wanted = x_before if settings.returns == "first" else ~x_before
        x_strong = x.amplitude >= settings.min_return_ratio * y.amplitude
        y_strong = y.amplitude >= settings.min_return_ratio * x.amplitude
        x_chosen = (x_wanted & x_strong) | ~y_strong
    direct, mpi = choose(x_chosen, x, y), choose(x_chosen, y, x)
    np.add(mpi.phase_rad, FULL_TURN, out=mpi.phase_rad, where=(x_wraps & ~x_chosen) | (y_wraps & x_chosen))
    return direct, mpi


def arranged(paths: PathSet, settings: ResolverSettings, /) -> tuple[Path, ...]:
    """Return the direct path by the rule of `direct_and_mpi`, then the others in falling amplitude.

    Among several paths, those put behind are the ones that seem to come over half a turn before the strongest, with less
    than half its amplitude.
    """
    amplitude = np.where(np.isnan(paths.amplitude), -np.inf, paths.amplitude)
    strongest = amplitude.argmax(axis=0)[np.newaxis]
    most = np.take_along_axis(amplitude, strongest, axis=0)
    lead = paths.phase_rad - np.take_along_axis(paths.phase_rad, strongest, axis=0)
    wraps = (lead < -0.5 * FULL_TURN) & (amplitude < ECHO_RATIO * most)
    behind = np.where(wraps, FULL_TURN, 0.0)
    direct = strongest
    if settings.returns != "strongest":
        strong = (amplitude >= settings.min_return_ratio * most) & (amplitude > 0.0)
        sign = 1.0 if settings.returns == "first" else -1.0
        direct = np.where(strong, sign * (lead + behind), np.inf).argmin(axis=0)[np.newaxis]
    np.put_along_axis(amplitude, direct, np.inf, axis=0)
    np.put_along_axis(behind, direct, 0.0, axis=0)
    order = np.argsort(-amplitude, axis=0, kind="stable")
    parts = (paths.amplitude, paths.phase_rad + behind, paths.sigma_rad)
    rows = (np.take_along_axis(part, order, axis=0) for part in parts)
    return tuple(Path(*path) for path in zip(*rows, strict=True))


def choose(chosen: Bool, first: Path, second: Path, /) -> Path:
    """Return the first path where chosen, else the second."""
    return Path(
        np.where(chosen, first.amplitude, second.amplitude),
        np.where(chosen, first.phase_rad, second.phase_rad),
        np.where(chosen, first.sigma_rad, second.sigma_rad),
    )
