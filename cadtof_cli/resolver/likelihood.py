"""Maximum likelihood for K paths on N harmonics whose noise is known, and its Fisher information."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.resolver.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.normal_equations import cholesky, inverse_diagonal
from cadtof_cli.resolver.order import chi_squared_threshold
from cadtof_cli.resolver.starts import best_pair, closed_form_start, strongest_path

SEARCH = LevenbergMarquardt(max_steps=40, absolute=1e-3)
"""From a start to a minimum, with white noise: to a thirtieth of a standard deviation."""

POLISH = LevenbergMarquardt(max_steps=8, relative=1e-12, absolute=1e-12, first_damping=1e-6)
"""From there to the maximum of the likelihood with the noise that the found light has."""

SUSPECT = 0.1
"""Probability of the misfit below which a minimum is taken for a local one, and the grid of pairs is searched too."""


@dataclass(frozen=True)
class Fit:
    """The most likely K paths of n pixels.

    `sigma_rad`, (K, n), comes from the Fisher information; `chi_squared`, (n,), has 2·(N − K) degrees of freedom where there
    are no more than K paths; `converged` is not set where the maximum was not reached.
    """

    paths: Mixture
    sigma_rad: Float
    chi_squared: Float
    converged: Bool

    def taken(self, chosen: Index, /) -> "Fit":
        """Return the fits of the given pixels."""
        return Fit(
            self.paths.taken(chosen), self.sigma_rad[:, chosen], self.chi_squared[chosen], self.converged[chosen]
        )


def fitted(measured: Measured, /, *, fewer: Fit | None, noise: NoiseModel) -> Fit:
    """Return the most likely paths, one more than in the fit with `fewer`, or one."""
    white = WhiteFit(measured, tuple(1.0 / harmonic.dark_variance for harmonic in noise.harmonics))
    rest = measured if fewer is None else measured.without(fewer.paths)
    more = strongest_path(rest, weights=white.weights)
    if fewer is not None:
        more = fewer.paths.joined(more)
    found = SEARCH.solve(white, more.points)
    points, cost = found.points, found.cost
    if fewer is not None and len(more.amplitude) == 2:
        if measured.harmonics[:2] == (1, 2):
            _improve(white, closed_form_start(measured), np.arange(cost.size), points, cost)
        dof_pairs = len(measured.harmonics) - 2
        limit = chi_squared_threshold(SUSPECT, pairs=dof_pairs) if dof_pairs else 1e-3
        suspect = np.flatnonzero(cost > limit)
        if suspect.size:
            start = best_pair(measured.taken(suspect), weights=white.weights)
            _improve(white, start, suspect, points, cost)
    return _polished(measured, Mixture.of_points(points), noise)


def _improve(white: WhiteFit, start: Mixture, of: Index, points: Float, cost: Float) -> None:
    other = SEARCH.solve(white.taken(of), start.points)
    better = other.cost < cost[of]
    points[:, of[better]], cost[of[better]] = other.points[:, better], other.cost[better]


def _polished(measured: Measured, paths: Mixture, noise: NoiseModel) -> Fit:
    weighted = WeightedFit.around(measured, paths, noise=noise)
    best = POLISH.solve(weighted, paths.points)
    k = len(paths.amplitude)
    found = Mixture.of_points(best.points)
    variance = inverse_diagonal(cholesky(weighted.linearised(best.points).matrix))[k:]
    return Fit(found, np.sqrt(variance) / found.amplitude, best.cost, best.converged)


def measured_phasors(phasors: Complex, /, *, noise: NoiseModel) -> Measured:
    """Return phasors, complex128 (N, n), with the harmonics that their noise is of."""
    return Measured.of_phasors(phasors, harmonics=tuple(h.harmonic for h in noise.harmonics))
