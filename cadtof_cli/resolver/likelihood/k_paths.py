"""Maximum likelihood for K paths on N harmonics whose noise is known, and its Fisher information."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import powers
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, inverse_diagonal
from cadtof_cli.resolver.likelihood.starts import best_pair, exact_start, strongest_path
from cadtof_cli.resolver.paths import CLOSE_ENOUGH, Fit, Paths, doubt_of_one
from cadtof_cli.resolver.two_path.arctangent import phase_of

SEARCH = LevenbergMarquardt(max_steps=40, absolute=0.1)
"""From a start to a minimum, with white noise: to a third of a standard deviation of the phasors, and a step further."""

POLISH = LevenbergMarquardt(max_steps=40, absolute=0.1, first_damping=1e-6)
"""From there to the maximum of the likelihood with the noise that the found light has, as closely."""

ON_THE_SPOT = LevenbergMarquardt(max_steps=0)
"""No step: cost and matrix where others have ended."""

SUSPECT = 0.01
"""Probability of the misfit below which a minimum is taken for a local one, and other starts are tried too."""

NO_AMPLITUDE = 1e-9
"""Share of the strongest path below which a path is none: where the most likely amplitude is 0 it comes out as rounding."""

EXACT_MISFIT = 1e-2
"""Most misfit of as many paths as harmonics: there is always an answer that leaves none."""


@dataclass(frozen=True)
class LikelyPaths:
    """The most likely K paths of n pixels.

    `sigma_rad`, (K, n), comes from the Fisher information; `chi_squared`, (n,), has 2·(N − K) degrees of freedom where there
    are no more than K paths; `converged` is not set where the maximum was not reached. `fall_off`, (n,), is for one path how much
    its harmonics fall off (`doubt_of_one`), None for more.
    """

    paths: Mixture
    sigma_rad: Float
    chi_squared: Float
    converged: Bool
    fall_off: Float | None = None

    def fit(self) -> Fit:
        """Return them as what a solver gives: paths without an amplitude, or that did not converge, are NaN."""
        amplitude, sigma = self.paths.amplitude, self.sigma_rad
        none = ~(amplitude > NO_AMPLITUDE * amplitude.max(axis=0)) | ~self.converged
        phase = phase_of(self.paths.cos, self.paths.sin)
        parts = [np.where(none, np.nan, part) for part in (amplitude, phase, sigma)]
        if none.any():
            last = np.argsort(none, axis=0, kind="stable")
            parts = [np.take_along_axis(part, last, axis=0) for part in parts]
        if self.fall_off is not None:
            return Fit(Paths(*parts), self.chi_squared, self.converged, doubt_of_one(self.fall_off))
        return Fit(Paths(*parts), self.chi_squared, self.converged, _doubt(self.paths, np.where(none, np.nan, sigma)))


def found_paths(measured: Measured, count: int, /, *, noise: NoiseModel) -> tuple[Mixture, Float]:
    """Return the `count` paths that fit best with white noise, and the misfit that they leave, (n,).

    The search starts from the exact answer of the first harmonics. Where there is none, and where it ends in a misfit that
    noise seldom has, it starts from one path fewer with the one that explains most of what those leave, and for two paths
    from the best pair of a grid.
    """
    white = WhiteFit(measured, tuple(1.0 / harmonic.dark_variance for harmonic in noise.each))
    if count == 1:
        end = SEARCH.solve(white, strongest_path(measured, weights=white.weights).points, samples=noise.samples)
        return Mixture.of_points(end.points), end.cost
    exact = exact_start(measured, paths=count)
    start = exact.points if exact else _greedy_start(measured, count, white.weights, noise)
    end = SEARCH.solve(white, start, samples=noise.samples)
    points, cost = end.points, end.cost
    suspect = np.flatnonzero(cost > _acceptable(measured, count, noise))
    if suspect.size and exact:
        greedy = _greedy_start(measured[suspect], count, white.weights, noise[suspect])
        _improve(white, greedy, suspect, points, cost, noise)
    if suspect.size and count == 2:
        pair = best_pair(measured[suspect], weights=white.weights)
        _improve(white, pair.points, suspect, points, cost, noise)
    return Mixture.of_points(points), cost


def _greedy_start(measured: Measured, count: int, weights: tuple[float, ...], noise: NoiseModel) -> Float:
    fewer, _ = found_paths(measured, count - 1, noise=noise)
    return fewer.joined(strongest_path(measured.without(fewer), weights=weights)).points


def most_likely(measured: Measured, found: Mixture, /, *, noise: NoiseModel) -> LikelyPaths:
    """Return the maximum of the likelihood next to what was found, with the noise that such light has."""
    weighted = WeightedFit.around(measured, found, noise=noise)
    best = POLISH.solve(weighted, found.points, samples=noise.samples)
    paths = Mixture.of_points(best.points)
    fall_off = _fall_off(measured, paths, noise) if len(paths.amplitude) == 1 else None
    return LikelyPaths(paths, _sigma(paths, best.matrix), best.cost, best.converged, fall_off)


def _fall_off(measured: Measured, path: Mixture, noise: NoiseModel) -> Float:
    """Return by how much the phasors fall off along one path with h², over what noise leaves there, squared, with its sign."""
    (amplitude,) = path.amplitude
    rotors = powers((path.cos[0], path.sin[0]), measured.harmonics)
    weights = [1.0 / one.one_path_variances(amplitude)[0] for one in noise.each]
    squares = [float(h * h) for h in measured.harmonics]
    mean = sum(w * h2 for w, h2 in zip(weights, squares, strict=True)) / sum(weights)
    score, variance = np.zeros_like(amplitude), np.zeros_like(amplitude)
    for re, im, (cos, sin), weight, square in zip(measured.re, measured.im, rotors, weights, squares, strict=True):
        score += weight * (mean - square) * (re * cos + im * sin)
        variance += weight * (mean - square) ** 2
    return np.asarray(score * np.abs(score) / variance)


def fisher_fit(measured: Measured, paths: Mixture, /, *, converged: Bool, noise: NoiseModel) -> LikelyPaths:
    """Return paths that another solver found with the likelihood's standard deviations and misfit."""
    at = ON_THE_SPOT.solve(WeightedFit.around(measured, paths, noise=noise), paths.points)
    return LikelyPaths(paths, _sigma(paths, at.matrix), at.cost, converged)


def _sigma(paths: Mixture, matrix: Float) -> Float:
    """Return the standard deviations of the phases, from the inverse of the Fisher information in (da, a·dx)."""
    count = len(paths.amplitude)
    variance = inverse_diagonal(cholesky(matrix, 2 * count), 2 * count)[count:]
    return np.sqrt(variance) / paths.amplitude


def _acceptable(measured: Measured, count: int, noise: NoiseModel) -> Float | float:
    pairs = len(measured.harmonics) - count
    misfit = chi_squared_threshold(SUSPECT, pairs=pairs) if pairs else EXACT_MISFIT
    return misfit if noise.samples is None else misfit / noise.samples


def _improve(white: WhiteFit, starts: Float, of: Index, points: Float, cost: Float, noise: NoiseModel) -> None:
    other = SEARCH.solve(white[of], starts, samples=noise[of].samples)
    better = other.cost < cost[of]
    points[:, of[better]], cost[of[better]] = other.points[:, better], other.cost[better]


def _doubt(paths: Mixture, sigma: Float) -> Float:
    """Return the largest standard deviation over a quarter of the distance of two paths (by the sine of half of it)."""
    doubt = np.zeros(sigma.shape[1])
    for i in range(len(sigma)):
        for j in range(i):
            cos = paths.cos[i] * paths.cos[j] + paths.sin[i] * paths.sin[j]
            half = np.sqrt(np.maximum(0.5 * (1.0 - cos), 0.0))
            doubt = np.fmax(doubt, np.maximum(sigma[i], sigma[j]) / (CLOSE_ENOUGH * half))
    return doubt
