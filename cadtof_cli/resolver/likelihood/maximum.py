"""Maximum likelihood for K paths on N harmonics whose noise is known, and its Fisher information."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, inverse_diagonal
from cadtof_cli.resolver.likelihood.starts import best_pair, exact_start, strongest_path

SEARCH = LevenbergMarquardt(max_steps=40, absolute=0.1)
"""From a start to a minimum, with white noise: to a third of a standard deviation, and a step further."""

POLISH = LevenbergMarquardt(max_steps=40, absolute=0.1, first_damping=1e-6)
"""From there to the maximum of the likelihood with the noise that the found light has, as closely."""

SUSPECT = 0.01
"""Probability of the misfit below which a minimum is taken for a local one, and other starts are tried too."""

EXACT_MISFIT = 1e-2
"""Most misfit of as many paths as harmonics: there is always an answer that leaves none."""


@dataclass(frozen=True)
class Found:
    """K paths of n pixels where the search with white noise ended, and the misfit it leaves, (n,)."""

    paths: Mixture
    chi_squared: Float

    def taken(self, chosen: Index, /) -> "Found":
        """Return what was found for the given pixels."""
        return Found(self.paths.taken(chosen), self.chi_squared[chosen])


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


def found_paths(measured: Measured, count: int, /, *, noise: NoiseModel) -> Found:
    """Return the `count` paths that fit best with white noise.

    The search starts from the exact answer of the first harmonics. Where there is none, and where it ends in a misfit that
    noise seldom has, it starts from one path fewer with the one that explains most of what those leave, and for two paths
    from the best pair of a grid.
    """
    white = WhiteFit(measured, tuple(1.0 / harmonic.dark_variance for harmonic in noise.harmonics))
    if count == 1:
        end = SEARCH.solve(white, strongest_path(measured, weights=white.weights).points)
        return Found(Mixture.of_points(end.points), end.cost)
    exact = exact_start(measured, paths=count)
    start = exact.points if exact else _greedy_start(measured, count, white.weights, noise)
    end = SEARCH.solve(white, start)
    points, cost = end.points, end.cost
    suspect = np.flatnonzero(cost > _acceptable(measured, count))
    if suspect.size and exact:
        _improve(white, _greedy_start(measured.taken(suspect), count, white.weights, noise), suspect, points, cost)
    if suspect.size and count == 2:
        pair = best_pair(measured.taken(suspect), weights=white.weights)
        _improve(white, pair.points, suspect, points, cost)
    return Found(Mixture.of_points(points), cost)


def _greedy_start(measured: Measured, count: int, weights: tuple[float, ...], noise: NoiseModel) -> Float:
    fewer = found_paths(measured, count - 1, noise=noise).paths
    return fewer.joined(strongest_path(measured.without(fewer), weights=weights)).points


def most_likely(measured: Measured, found: Found, /, *, noise: NoiseModel) -> Fit:
    """Return the maximum of the likelihood next to what was found, with the noise that such light has."""
    weighted = WeightedFit.around(measured, found.paths, noise=noise)
    best = POLISH.solve(weighted, found.paths.points)
    paths = Mixture.of_points(best.points)
    return Fit(paths, _sigma(paths, best.matrix), best.cost, best.converged)


def fisher_fit(measured: Measured, paths: Mixture, /, *, converged: Bool, noise: NoiseModel) -> Fit:
    """Return paths that another solver found with the likelihood's standard deviations and misfit."""
    at = WeightedFit.around(measured, paths, noise=noise).linearised(paths.points)
    return Fit(paths, _sigma(paths, at.matrix), at.cost, converged)


def _sigma(paths: Mixture, matrix: Float) -> Float:
    """Return the standard deviations of the phases, from the inverse of the Fisher information in (da, a·dx)."""
    count = len(paths.amplitude)
    variance = inverse_diagonal(cholesky(matrix, 2 * count), 2 * count)[count:]
    return np.sqrt(variance) / paths.amplitude


def _acceptable(measured: Measured, count: int) -> float:
    pairs = len(measured.harmonics) - count
    return chi_squared_threshold(SUSPECT, pairs=pairs) if pairs else EXACT_MISFIT


def _improve(white: WhiteFit, starts: Float, of: Index, points: Float, cost: Float) -> None:
    other = SEARCH.solve(white.taken(of), starts)
    better = other.cost < cost[of]
    points[:, of[better]], cost[of[better]] = other.points[:, better], other.cost[better]
