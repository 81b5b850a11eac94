"""Where the search for paths begins: what the first harmonics say in closed form, and scans over a coarse grid of delays."""

from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Float, Index
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture
from cadtof_cli.resolver.likelihood.pisarenko import pisarenko, strongest_of
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths

DELAYS_PER_HARMONIC = 8
"""Grid delays in a period of the highest harmonic: an eighth of it is well within where the fit converges."""


PAIR_PIXELS = 512
"""Pixels at a time in the scan over pairs, of which there are hundreds."""


def exact_start(measured: Measured, /, *, paths: int) -> Mixture | None:
    """Return the paths that the first harmonics have exactly; None where these are not 1, 2, … without a gap.

    For two paths it is the closed form of harmonics 1 and 2. For more, Carathéodory's decomposition of as many harmonics as
    follow each other has a path for each, of which the strongest are taken.
    """
    run = next((i for i, h in enumerate(measured.harmonics) if h != i + 1), len(measured.harmonics))
    if run < paths:
        return None
    if paths == 2:
        first, second = (measured.re[row] + 1j * measured.im[row] for row in (0, 1))
        two = two_paths(fundamental_frame(first, second))
        return Mixture(np.stack((two.a, two.b)), np.stack((two.cos_x, two.cos_y)), np.stack((two.sin_x, two.sin_y)))
    return strongest_of(pisarenko(measured.re[:run] + 1j * measured.im[:run]), paths)


def strongest_path(measured: Measured, /, *, weights: Sequence[float]) -> Mixture:
    """Return the grid's path that explains most of the phasors: the peak of Σ_h w_h·Re(p_h·exp(−i h x))."""
    grid = _grid(measured.harmonics)
    matched = np.stack([_matched(measured, weights, phase) for phase in grid])
    peak = matched.argmax(axis=0)
    amplitude = np.maximum(matched.max(axis=0), 0.0) / sum(weights)
    return Mixture(amplitude[np.newaxis], np.cos(grid)[np.newaxis, peak], np.sin(grid)[np.newaxis, peak])


def best_pair(measured: Measured, /, *, weights: Sequence[float]) -> Mixture:
    """Return the grid's pair of paths that explains most of the phasors, each with an amplitude above 0.

    For delays x and y the best amplitudes solve S·[[1, ρ], [ρ, 1]]·(a, b) = (B(x), B(y)), with B the matched sum of
    `strongest_path`, S = Σ w_h and ρ = Σ w_h·cos h(x − y)/S; they explain a·B(x) + b·B(y). All pairs a lag apart have one ρ.
    """
    grid = _grid(measured.harmonics)
    count, pixels = len(grid), measured.re.shape[1]
    cosines = [
        np.array([w * np.cos(h * lag) for w, h in zip(weights, measured.harmonics, strict=True)]) for lag in grid
    ]
    parts: list[Float] = []
    for begin in range(0, pixels, PAIR_PIXELS):
        some = measured[np.arange(begin, min(begin + PAIR_PIXELS, pixels))]
        matched: Float = np.stack([_matched(some, weights, phase) for phase in grid])
        # the grid goes round: the second path of a pair lies `lag` places behind the first
        around = np.concatenate((matched, matched))
        squares = around * around
        most, lags = np.full(matched.shape, -np.inf), np.ones(matched.shape, np.intp)
        for lag in range(1, count // 2 + 1):
            rho = float(cosines[lag].sum()) / sum(weights)
            there = around[lag : lag + count]
            explained = matched * there
            explained *= -2.0 * rho
            explained += squares[:count]
            explained += squares[lag : lag + count]
            explained *= 1.0 / (1.0 - rho * rho)
            better = explained > most
            better &= matched > rho * there
            better &= there > rho * matched
            np.copyto(most, explained, where=better)
            np.copyto(lags, lag, where=better)
        first = most.argmax(axis=0)
        second = (first + np.take_along_axis(lags, first[np.newaxis], 0)[0]) % count
        parts.append(_amplitudes_of_pairs(matched, first, second, grid, cosines, sum(weights)))
    return Mixture.of_points(np.concatenate(parts, axis=1))


def _amplitudes_of_pairs(
    matched: Float, first: Index, second: Index, grid: Float, cosines: Sequence[Float], total: float
) -> Float:
    """Return pairs of the grid's delays as points, with the amplitudes that explain most, not below 0."""
    rho = np.array([float(one.sum()) / total for one in cosines])[np.abs(second - first)]
    pair = np.stack((first, second))
    b_first, b_second = np.take_along_axis(matched, pair, 0)
    scale = 1.0 / (total * (1.0 - rho * rho))
    amplitudes = np.maximum(np.stack(((b_first - rho * b_second) * scale, (b_second - rho * b_first) * scale)), 0.0)
    return np.concatenate((amplitudes, np.cos(grid)[pair], np.sin(grid)[pair]))


def _grid(harmonics: Sequence[int]) -> Float:
    count = DELAYS_PER_HARMONIC * harmonics[-1]
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def _matched(measured: Measured, weights: Sequence[float], phase: float) -> Float:
    total = np.zeros(measured.re.shape[1])
    for h, weight, re, im in zip(measured.harmonics, weights, measured.re, measured.im, strict=True):
        total += (weight * np.cos(h * phase)) * re
        total += (weight * np.sin(h * phase)) * im
    return total
