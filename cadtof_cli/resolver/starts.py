"""Where the search for paths begins: what the first harmonics say in closed form, and scans over a coarse grid of delays."""

from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.closed_form import fundamental_frame, two_paths
from cadtof_cli.resolver.mixture import Measured, Mixture

DELAYS_PER_HARMONIC = 8
"""Grid delays in a period of the highest harmonic: an eighth of it is well within where the fit converges."""


def closed_form_start(measured: Measured, /) -> Mixture:
    """Return the two paths that the first two harmonics have exactly, which must be 1 and 2."""
    first, second = (measured.re[row] + 1j * measured.im[row] for row in (0, 1))
    two = two_paths(fundamental_frame(first, second))
    return Mixture(np.stack((two.a, two.b)), np.stack((two.cos_x, two.cos_y)), np.stack((two.sin_x, two.sin_y)))


def strongest_path(measured: Measured, /, *, weights: Sequence[float]) -> Mixture:
    """Return the grid's path that explains most of the phasors: the peak of Σ_h w_h·Re(p_h·exp(−i h x))."""
    best = np.full(measured.re.shape[1], -np.inf)
    cos, sin = np.ones_like(best), np.zeros_like(best)
    for phase in _grid(measured.harmonics):
        peak = _matched(measured, weights, phase)
        higher = peak > best
        np.copyto(best, peak, where=higher)
        np.copyto(cos, np.cos(phase), where=higher)
        np.copyto(sin, np.sin(phase), where=higher)
    amplitude = np.maximum(best, 0.0) / sum(weights)
    return Mixture(amplitude[np.newaxis], cos[np.newaxis], sin[np.newaxis])


def best_pair(measured: Measured, /, *, weights: Sequence[float]) -> Mixture:
    """Return the grid's pair of paths that explains most of the phasors, each with an amplitude above 0.

    For delays x and y the best amplitudes solve S·[[1, ρ], [ρ, 1]]·(a, b) = (B(x), B(y)), with B the matched sum of
    `strongest_path`, S = Σ w_h and ρ = Σ w_h·cos h(x − y)/S; they explain a·B(x) + b·B(y).
    """
    grid = _grid(measured.harmonics)
    matched = np.stack([_matched(measured, weights, phase) for phase in grid])
    total, count = sum(weights), measured.re.shape[1]
    best = np.full(count, -np.inf)
    found = np.zeros((6, count))
    for first in range(len(grid)):
        for second in range(first + 1, len(grid)):
            lag = grid[second] - grid[first]
            rho = sum(w * np.cos(h * lag) for w, h in zip(weights, measured.harmonics, strict=True)) / total
            a, b = matched[first] - rho * matched[second], matched[second] - rho * matched[first]
            explained = (a * matched[first] + b * matched[second]) / (1.0 - rho * rho)
            better = (explained > best) & (a > 0.0) & (b > 0.0)
            best = np.where(better, explained, best)
            scale = 1.0 / (total * (1.0 - rho * rho))
            x, y = grid[first], grid[second]
            for row, value in enumerate((a * scale, b * scale, np.cos(x), np.cos(y), np.sin(x), np.sin(y))):
                np.copyto(found[row], value, where=better)
    return Mixture.of_points(found)


def _grid(harmonics: Sequence[int]) -> Float:
    count = DELAYS_PER_HARMONIC * harmonics[-1]
    grid: Float = np.arange(count) * (2.0 * np.pi / count)
    return grid


def _matched(measured: Measured, weights: Sequence[float], phase: float) -> Float:
    total = np.zeros(measured.re.shape[1])
    for h, weight, re, im in zip(measured.harmonics, weights, measured.re, measured.im, strict=True):
        total += (weight * np.cos(h * phase)) * re
        total += (weight * np.sin(h * phase)) * im
    return total
