"""Maximum likelihood for K paths on N harmonics with known noise, and its Fisher information."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt, Minimum, PathsProblem
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, WhiteFit
from cadtof_cli.resolver.likelihood.normal_equations import cholesky, inverse_diagonal
from cadtof_cli.resolver.likelihood.starts import best_pair, exact_start, strongest_path
from cadtof_cli.resolver.paths import CLOSE_ENOUGH, Fit, Paths, doubt_of_one
from cadtof_cli.resolver.two_path.arcsine import phase_of

SEARCH = LevenbergMarquardt(max_steps=40, absolute=0.1)
"""Search for a minimum with white noise: to a third of a standard deviation of the phasors, then one step more."""

CLOSE_SEARCH = LevenbergMarquardt(max_steps=40, absolute=1e-3)
"""Search for more than two paths, whose minima lie in long valleys: it takes a step or two more."""

EXACT_SEARCH = LevenbergMarquardt(max_steps=40, absolute=1e-12)
"""Search for as many paths as harmonics, which fit exactly."""

POLISH = LevenbergMarquardt(max_steps=40, absolute=0.1, first_damping=1e-6)
"""Search from the minimum with white noise to the maximum of the likelihood with the noise of this light, as closely as
`SEARCH`."""

ON_THE_SPOT = LevenbergMarquardt(max_steps=0)
"""No step: only the cost and the matrix at paths that another solver found."""

SUSPECT = 0.01
"""Other starts are tried if noise alone exceeds the misfit with less probability than this: the minimum may be local."""

NO_AMPLITUDE = 1e-9
"""A path below this share of the strongest one counts as no path, because an amplitude of 0 comes out as rounding."""

EXACT_MISFIT = 1e-2
"""Largest acceptable misfit of as many paths as harmonics, for which an exact answer always exists."""


class WeightedProblem(PathsProblem, Protocol):
    """The fit of paths with the full noise."""

    def strengths(self, path: Mixture, /) -> Iterator[tuple[Float, Float | float]]:
        """Yield, for each harmonic, the amplitude along one path, (n,), and the square of its answer to amplitude 1."""


@dataclass(frozen=True)
class LikelyPaths:
    """The most likely K paths of n pixels.

    `sigma_rad`, (K, n), comes from the Fisher information. `chi_squared`, (n,), has 2·(N − K) degrees of freedom if the
    light has at most K paths. `converged` is False where the maximum was not reached. `fall_off`, (n,), is how much the
    harmonics of one path fall off (`doubt_of_one`); None for more than one path.
    """

    paths: Mixture
    sigma_rad: Float
    chi_squared: Float
    converged: Bool
    fall_off: Float | None = None

    def fit(self) -> Fit:
        """Return the paths as a `Fit`; paths without an amplitude, or that did not converge, become NaN and come last."""
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
    """Return the `count` paths that fit best with white noise, and their misfit, (n,).

    If the first search ends with a misfit that noise seldom gives, other starts are tried, in this order. For more than
    two paths: the exact answer of the first harmonics. For any number: one path fewer, found by this function, plus the
    path that explains most of the rest. For two paths: the best pair of a grid, and without harmonics 1 and 2 that of a
    fine grid. For three paths without harmonics 1, 2 and 3: the strongest path, or half of it, plus the best pair.
    """
    white = WhiteFit(measured, tuple(1.0 / harmonic.dark_variance for harmonic in noise.each))
    end = _first_end(white, count, noise)
    points, cost = end.points, end.cost
    if count == 1:
        return Mixture.of_points(points), cost
    acceptable = acceptable_misfit(count, noise)
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
    # without harmonics 1 and 2 there is no exact start, and minima may lie nearer to each other than delays of the grid
    if count == 2 and measured.harmonics[:2] != (1, 2) and (suspect := np.flatnonzero(cost > acceptable)).size:
        pair = best_pair(measured[suspect], weights=white.weights, fine=True)
        _improve(white, pair, suspect, points, cost, noise)
    if count == 3 and measured.harmonics[:3] != (1, 2, 3):
        for share in (1.0, 0.5):
            suspect = np.flatnonzero(cost > acceptable)
            _improve(white, _with_a_pair(white[suspect], share), suspect, points, cost, noise)
    return Mixture.of_points(points), cost


def acceptable_misfit(count: int, noise: NoiseModel, /) -> Float | float:
    """Return the misfit of `count` paths, a number or (n,), above which a minimum is suspected to be a local one."""
    pairs = len(noise.each) - count
    acceptable = chi_squared_threshold(SUSPECT, pairs=pairs) if pairs else EXACT_MISFIT
    return acceptable if noise.samples is None else acceptable / noise.samples


def _with_a_pair(white: WhiteFit, share: float) -> Mixture:
    """Return a share of the strongest path, and the pair that explains most of the rest."""
    path = strongest_path(white.measured, weights=white.weights)
    path = replace(path, amplitude=share * path.amplitude)
    return path.joined(best_pair(white.measured.without(path), weights=white.weights))


def _with_another(white: WhiteFit, fewer: Mixture) -> Mixture:
    """Return the given paths plus the path that explains most of the rest."""
    return fewer.joined(strongest_path(white.measured.without(fewer), weights=white.weights))


def _first_end(white: WhiteFit, count: int, noise: NoiseModel) -> Minimum:
    """Return the end of the first search.

    Two paths start from the exact answer of harmonics 1 and 2, if both were recorded. One path starts from the best
    delay of a grid. All other searches start from one path fewer, found by this function, plus the path that explains
    most of the rest.
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
    """Return the maximum of the likelihood next to the paths `found`, with the noise of the light of these paths."""
    return likely_paths(WeightedFit.around(measured, found, noise=noise), found, noise=noise)


def likely_paths(problem: WeightedProblem, found: Mixture, /, *, noise: NoiseModel) -> LikelyPaths:
    """Return the maximum of the likelihood of a problem next to the paths `found`."""
    best = POLISH.solve(problem, found.points, samples=noise.samples)
    paths = Mixture.of_points(best.points)
    fall_off = _fall_off(problem, paths, noise) if len(paths.amplitude) == 1 else None
    return LikelyPaths(paths, _sigma(paths, best.matrix), best.cost, best.converged, fall_off)


def _fall_off(problem: WeightedProblem, path: Mixture, noise: NoiseModel) -> Float:
    """Return z·|z|: z is how much the phasors fall off with h² along one path, in standard deviations of the noise."""
    (amplitude,), strengths, weights = path.amplitude, [], []
    for one, (strength, power) in zip(noise.each, problem.strengths(path), strict=True):
        strengths.append(strength)
        weights.append(power / one.one_path_variances(amplitude)[0])
    squares = [float(h * h) for h in noise.harmonics]
    mean = sum(w * h2 for w, h2 in zip(weights, squares, strict=True)) / sum(weights)
    score, variance = np.zeros_like(amplitude), np.zeros_like(amplitude)
    for strength, weight, square in zip(strengths, weights, squares, strict=True):
        score += weight * (mean - square) * strength
        variance += weight * (mean - square) ** 2
    return np.asarray(score * np.abs(score) / variance)


def fisher_fit(measured: Measured, paths: Mixture, /, *, converged: Bool, noise: NoiseModel) -> LikelyPaths:
    """Return paths that another solver found, with standard deviations and misfit from the likelihood."""
    end = ON_THE_SPOT.solve(WeightedFit.around(measured, paths, noise=noise), paths.points)
    return LikelyPaths(paths, _sigma(paths, end.matrix), end.cost, converged)


def _sigma(paths: Mixture, matrix: Float) -> Float:
    """Return the standard deviations of the phases, from the inverse of the Fisher information in (da, a·dx)."""
    count = len(paths.amplitude)
    variance = inverse_diagonal(cholesky(matrix, 2 * count), 2 * count)[count:]
    return np.sqrt(variance) / paths.amplitude


def _improve(white: WhiteFit, starts: Mixture, pixels: Index, points: Float, cost: Float, noise: NoiseModel) -> None:
    """Search some pixels again from other starts, and overwrite their points and cost where the cost is lower."""
    end = _solver(white, len(starts.amplitude)).solve(white[pixels], starts.points, samples=noise[pixels].samples)
    better = end.cost < cost[pixels]
    points[:, pixels[better]], cost[pixels[better]] = end.points[:, better], end.cost[better]


def _doubt(paths: Mixture, sigma: Float) -> Float:
    """Return the largest standard deviation over a quarter of the distance of two paths (the sine of half of it)."""
    doubt = np.zeros(sigma.shape[1])
    for i in range(len(sigma)):
        for j in range(i):
            cos = paths.cos[i] * paths.cos[j] + paths.sin[i] * paths.sin[j]
            half = np.sqrt(np.maximum(0.5 * (1.0 - cos), 0.0))
            doubt = np.fmax(doubt, np.maximum(sigma[i], sigma[j]) / (CLOSE_ENOUGH * half))
    return doubt
