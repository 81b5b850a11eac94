"""Which path is called direct: the first, strongest or last return."""

import numpy as np

from cadtof_cli.resolver.paths import FULL_TURN, Paths
from cadtof_cli.resolver.settings import ResolverSettings

ECHO_RATIO = 0.5
"""A path is an echo that wraps round the unambiguous range if its amplitude is below this share of the other path's
amplitude and it seems to arrive more than half a turn before the other path."""


def direct_first(paths: Paths, settings: ResolverSettings, /) -> Paths:
    """Return the direct path in row 0, then the other paths in falling amplitude; NaN in the last rows stays there.

    The direct path is the first or the last path that is strong enough, or the strongest path, as the settings say.
    Phases repeat after a full turn, so a late echo of a far wall can seem to arrive before the wall itself. But light
    on a longer way is weaker. So a path is put behind the strongest path if its amplitude is less than half the
    strongest amplitude and it seems to arrive more than half a turn before the strongest path. If such a path is not
    the direct path, its phase lies beyond 2π.
    """
    if len(paths) == 1:
        return paths
    return _pair(paths, settings) if len(paths) == 2 else _several(paths, settings)


def _pair(paths: Paths, settings: ResolverSettings) -> Paths:
    """Arrange two paths as `_several` does, but in fewer operations."""
    x, y = paths.amplitude
    lead = paths.phase_rad[1] - paths.phase_rad[0]
    x_wraps = (lead > 0.5 * FULL_TURN) & (x < ECHO_RATIO * y)
    y_wraps = (lead < -0.5 * FULL_TURN) & (y < ECHO_RATIO * x)
    if settings.returns == "strongest":
        x_chosen = ~(x < y)
    else:
        x_before = ((lead >= 0.0) & ~x_wraps) | y_wraps
        x_wanted = x_before if settings.returns == "first" else ~x_before
        x_strong = x >= settings.min_return_ratio * y
        y_strong = y >= settings.min_return_ratio * x
        x_chosen = (x_wanted & x_strong) | ~y_strong
    parts = (paths.amplitude, paths.phase_rad, paths.sigma_rad)
    amplitude, phase_rad, sigma_rad = (np.where(x_chosen, part, part[::-1]) for part in parts)
    np.add(phase_rad[1], FULL_TURN, out=phase_rad[1], where=np.where(x_chosen, y_wraps, x_wraps))
    return Paths(amplitude, phase_rad, sigma_rad)


def _several(paths: Paths, settings: ResolverSettings) -> Paths:
    amplitude = np.where(np.isnan(paths.amplitude), -np.inf, paths.amplitude)
    strongest = amplitude.argmax(axis=0)[np.newaxis]
    most = np.take_along_axis(amplitude, strongest, axis=0)
    lead = paths.phase_rad - np.take_along_axis(paths.phase_rad, strongest, axis=0)
    wraps = (lead < -0.5 * FULL_TURN) & (amplitude < ECHO_RATIO * most)
    added_rad = np.where(wraps, FULL_TURN, 0.0)
    direct = strongest
    if settings.returns != "strongest":
        strong = (amplitude >= settings.min_return_ratio * most) & (amplitude > 0.0)
        sign = 1.0 if settings.returns == "first" else -1.0
        direct = np.where(strong, sign * (lead + added_rad), np.inf).argmin(axis=0)[np.newaxis]
    np.put_along_axis(amplitude, direct, np.inf, axis=0)
    np.put_along_axis(added_rad, direct, 0.0, axis=0)
    order = np.argsort(-amplitude, axis=0, kind="stable")
    parts = (paths.amplitude, paths.phase_rad + added_rad, paths.sigma_rad)
    amplitude, phase_rad, sigma_rad = (np.asarray(np.take_along_axis(part, order, axis=0)) for part in parts)
    return Paths(amplitude, phase_rad, sigma_rad)
