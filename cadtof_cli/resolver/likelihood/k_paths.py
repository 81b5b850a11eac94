"""Maximum likelihood for K paths on N harmonics whose noise is known, and its Fisher information."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.phasors.rotors import powers
from cadtof_cli.resolver.likelihood.compiled import Minimum
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, inverse_diagonal
from cadtof_cli.resolver.likelihood.starts import best_pair, exact_start, strongest_path
from cadtof_cli.resolver.paths import CLOSE_ENOUGH, Fit, Paths, doubt_of_one
from cadtof_cli.resolver.two_path.arcsine import phase_of

SEARCH = LevenbergMarquardt(max_steps=40, absolute=0.1)
"""From a start to a minimum, with white noise: to a third of a standard deviation of the phasors, and a step further."""

CLOSE_SEARCH = LevenbergMarquardt(max_steps=40, absolute=1e-3)
"""From a start to a minimum for more than two paths, which lie in long valleys: they need a step or two more."""

EXACT_SEARCH = LevenbergMarquardt(max_steps=40, absolute=1e-12)
"""From a start to a minimum for as many paths as harmonics: they leave nothing at all."""

POLISH = LevenbergMarquardt(max_steps=40, absolute=0.1, first_damping=1e-6)
"""From the minimum that was found to the maximum of the likelihood with the noise that this light has, as closely."""

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
        """Return the paths as the fit that a solver gives: those without an amplitude, or that did not converge, are NaN."""
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

    Where the first search ends in a misfit that noise seldom has, there are other starts: one path fewer, found as carefully,
    with the one that explains most of what those leave; before it, for more than two paths, the exact answer of the first
    harmonics; after it, for two, the best pair of a grid.
    """
    white = WhiteFit(measured, tuple(1.0 / harmonic.dark_variance for harmonic in noise.each))
    end = _first_end(white, count, noise)
    points, cost = end.points, end.cost
    if count == 1:
        return Mixture.of_points(points), cost
    acceptable = _acceptable(measured, count, noise)
    if count > 2 and (suspect := np.flatnonzero(cost > acceptable)).size:
        exact = exact_start(measured[suspect], paths=count)
        if exact:
            _improve(white, exact, suspect, points, cost, noise)
    if (suspect := np.flatnonzero(cost > acceptable)).size:
        fewer, _ = found_paths(measured[suspect], count - 1, noise=noise[suspect])
        _improve(white, _with_another(white[suspect], fewer), suspect, points, cost, noise)
        if count == 2:
            pair = best_pair(measured[suspect], weights=white.weights)
            _improve(white, pair, suspect, points, cost, noise)
    return Mixture.of_points(points), cost


def _with_another(white: WhiteFit, fewer: Mixture) -> Mixture:
    """Return paths and the one that explains most of what they leave."""
    return fewer.joined(strongest_path(white.measured.without(fewer), weights=white.weights))


def _first_end(white: WhiteFit, count: int, noise: NoiseModel) -> Minimum:
    """Return where the search ends that is tried first.

    Two paths start from the exact answer of harmonics 1 and 2; a single one from a grid's; others from one path fewer, found in
    this way, with the one that explains most of what those leave.
    """
    measured, exact = white.measured, exact_start(white.measured, paths=2) if count == 2 else None
    if exact:
        start = exact
    elif count == 1:
        start = strongest_path(measured, weights=white.weights)
    else:
        start = _with_another(white, Mixture.of_points(_first_end(white, count - 1, noise).points))
    return _solver(white, count).solve(white, start.points, samples=noise.samples)


def _solver(white: WhiteFit, count: int) -> LevenbergMarquardt:
    if count == len(white.measured.harmonics):
        return EXACT_SEARCH
    return SEARCH if count <= 2 else CLOSE_SEARCH


def most_likely(measured: Measured, found: Mixture, /, *, noise: NoiseModel) -> LikelyPaths:
    """Return the maximum of the likelihood next to what was found, with the noise that such light has."""
    weighted = WeightedFit.around(measured, found, noise=noise)
    best = POLISH.solve(weighted, found.points, samples=noise.samples)
    paths = Mixture.of_points(best.points)
    fall_off = _fall_off(measured, paths, noise) if len(paths.amplitude) == 1 else None
    return LikelyPaths(paths, _sigma(paths, best.matrix), best.cost, best.converged, fall_off)


def _fall_off(measured: Measured, path: Mixture, noise: NoiseModel) -> Float:
    """Return by how much the phasors fall off along one path with h², over what noise leaves there, squared, with its sign."""
    (amplitude,), (rotor,) = path.amplitude, zip(path.cos, path.sin, strict=True)
    rotors = powers(rotor, measured.harmonics)
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


def _improve(white: WhiteFit, starts: Mixture, of: Index, points: Float, cost: Float, noise: NoiseModel) -> None:
    other = _solver(white, len(starts.amplitude)).solve(white[of], starts.points, samples=noise[of].samples)
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
