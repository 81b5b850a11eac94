"""Starts of the search for paths: the exact answer of the first harmonics, and scans over a coarse grid of delays.

`_starts.h` is the compiled twin of the scans, and this module is its front.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Float, Index, Int64
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous
from cadtof_cli.resolver.likelihood.kernel import compiled_search
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture
from cadtof_cli.resolver.likelihood.pisarenko import pisarenko, strongest_of
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, two_paths

DELAYS_PER_HARMONIC = 8
"""Delays of the grid per period of the highest harmonic. From an eighth of a period away, the fit converges safely."""

MOST_PLACES = 128
"""Largest number of delays of a fine grid: the compiled scan has room for so many."""

ALIKE = 1.0 - 1e-9
"""If ρ of two paths is at least this, the phasors cannot tell the paths apart."""

SCANNED_PIXELS = 512
"""Pixels per block of a scan by numpy, which goes over hundreds of pairs."""


@dataclass(frozen=True)
class Scanned:
    """The best delays of a grid for n pixels, (n,) each.

    `first` is the place of the path in the grid, `peak` its matched sum. For a pair, the other path lies `lag` places
    later, and `other` is its matched sum.
    """

    first: Int64
    lag: Int64
    peak: Float
    other: Float


def exact_start(measured: Measured, /, *, paths: int) -> Mixture | None:
    """Return paths that have exactly the phasors of the first harmonics; None unless these are 1, 2, … without a gap.

    Two paths come from the closed form of harmonics 1 and 2. For more paths, Carathéodory's decomposition takes all
    harmonics up to the first gap and gives one path for each of them; the strongest of these are returned.
    """
    run = next((i for i, h in enumerate(measured.harmonics) if h != i + 1), len(measured.harmonics))
    if run < paths:
        return None
    if paths == 2:
        two = two_paths(fundamental_frame(*measured.phasors(2)))
        return Mixture(two.amplitude, np.stack((two.cos_x, two.cos_y)), np.stack((two.sin_x, two.sin_y)))
    return strongest_of(pisarenko(measured.phasors(run)), paths)


def strongest_path(measured: Measured, /, *, weights: Sequence[float]) -> Mixture:
    """Return the path of the grid that explains most of the phasors: the maximum of Σ_h w_h·Re(p_h·exp(−i h x))."""
    grid = _grid(_coarse(measured.harmonics))
    found = scanned(measured, weights=weights, pairs=False)
    amplitude = np.maximum(found.peak, 0.0) / sum(weights)
    return Mixture(amplitude[np.newaxis], np.cos(grid)[np.newaxis, found.first], np.sin(grid)[np.newaxis, found.first])


def best_pair(measured: Measured, /, *, weights: Sequence[float], fine: bool = False) -> Mixture:
    """Return the pair of paths of the grid that explains most of the phasors; both amplitudes are above 0.

    For delays x and y the best amplitudes solve S·[[1, ρ], [ρ, 1]]·(a, b) = (B(x), B(y)). Here B is the matched sum
    that `strongest_path` maximises, S = Σ w_h and ρ = Σ w_h·cos h(x − y)/S. The pair explains a·B(x) + b·B(y). All
    pairs with the same lag have the same ρ. A `fine` grid has twice as many delays.
    """
    coarse = _coarse(measured.harmonics)
    places = max(coarse, min(2 * coarse, MOST_PLACES)) if fine else coarse
    grid = _grid(places)
    found = scanned(measured, weights=weights, pairs=True, places=places)
    pair = np.stack((found.first, (found.first + found.lag) % len(grid)))
    rho = _lags(measured.harmonics, tuple(weights), places)[found.lag - 1, 0]
    scale = 1.0 / (sum(weights) * (1.0 - rho * rho))
    amplitudes = np.stack(((found.peak - rho * found.other) * scale, (found.other - rho * found.peak) * scale))
    return Mixture(np.maximum(amplitudes, 0.0), np.cos(grid)[pair], np.sin(grid)[pair])


def scanned(measured: Measured, /, *, weights: Sequence[float], pairs: bool, places: int | None = None) -> Scanned:
    """Return the path, or the pair, of the grid that explains most; all kernels give the same bits.

    The grid has so many `places`, or as many as its coarse form.
    """
    harmonics, count = measured.harmonics, measured.re.shape[1]
    places = places or _coarse(harmonics)
    factors, lags = _factors(harmonics, tuple(weights), places), _lags(harmonics, tuple(weights), places)
    found = Scanned(np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count), np.empty(count))
    if (compiled := compiled_search(harmonics, paths=1 + pairs)) is not None:
        sizes, answers = (len(harmonics), len(factors), pairs), (found.first, found.lag, found.peak, found.other)
        compiled.scan(chosen_kernel(), *sizes, factors, lags, *contiguous(measured.re, measured.im), *answers)
        return found
    for begin in range(0, count, SCANNED_PIXELS):
        block = slice(begin, begin + SCANNED_PIXELS)
        matched = np.stack([_matched(measured, factor, block) for factor in factors])
        first, lag = (
            _best_lags(matched, lags) if pairs else (matched.argmax(axis=0), np.ones(matched.shape[1], np.intp))
        )
        found.first[block], found.lag[block] = first, lag
        found.peak[block] = np.take_along_axis(matched, first[np.newaxis], 0)[0]
        found.other[block] = np.take_along_axis(matched, (first[np.newaxis] + lag) % len(factors), 0)[0]
    return found


def _best_lags(matched: Float, lags: Float) -> tuple[Index, Index]:
    """Return the place of the first path of the best pair, and how many places later the other path lies, (n,) each."""
    count = len(matched)
    # the grid is periodic: the second path of a pair lies `lag` places after the first
    around = np.concatenate((matched, matched))
    squares = around * around
    most, best = np.full(matched.shape, -np.inf), np.ones(matched.shape, np.intp)
    for lag, (rho, twice, scale) in enumerate(lags, start=1):
        there = around[lag : lag + count]
        explained = matched * there
        explained *= twice
        explained += squares[:count]
        explained += squares[lag : lag + count]
        explained *= scale
        better = explained > most
        better &= matched > rho * there
        better &= there > rho * matched
        np.copyto(most, explained, where=better)
        np.copyto(best, lag, where=better)
    first = most.argmax(axis=0)
    return first, np.take_along_axis(best, first[np.newaxis], 0)[0]


def _coarse(harmonics: Sequence[int]) -> int:
    return DELAYS_PER_HARMONIC * harmonics[-1]


def _grid(places: int) -> Float:
    return np.linspace(0.0, 2.0 * np.pi, places, endpoint=False)


@lru_cache(maxsize=8)
def _factors(harmonics: tuple[int, ...], weights: tuple[float, ...], places: int) -> Float:
    """Return the weight of every harmonic times cosine and sine at the delays of the grid, (places, N, 2)."""
    pairs = list(zip(harmonics, weights, strict=True))
    return np.array([[(w * np.cos(h * x), w * np.sin(h * x)) for h, w in pairs] for x in _grid(places)])


@lru_cache(maxsize=8)
def _lags(harmonics: tuple[int, ...], weights: tuple[float, ...], places: int) -> Float:
    """Return ρ, −2ρ and 1/(1 − ρ²) of two paths one, two, … places apart, up to half the grid.

    The last value is 0 if the phasors cannot tell the two paths apart, such as two paths half a turn apart if all
    harmonics are odd.
    """
    grid = _grid(places)
    lags = grid[1 : len(grid) // 2 + 1]
    rhos = [
        sum(w * float(np.cos(h * lag)) for h, w in zip(harmonics, weights, strict=True)) / sum(weights) for lag in lags
    ]
    return np.array([(rho, -2.0 * rho, 1.0 / (1.0 - rho * rho) if abs(rho) < ALIKE else 0.0) for rho in rhos])


def _matched(measured: Measured, factor: Float, block: slice) -> Float:
    total = np.zeros(measured.re[0, block].size)
    for (cos, sin), re, im in zip(factor, measured.re, measured.im, strict=True):
        total += cos * re[block]
        total += sin * im[block]
    return total
