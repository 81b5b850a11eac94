"""The Python front of the compiled search and scans, which give the same bits as `levenberg_marquardt` and `starts`."""

from types import ModuleType

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.records import dataclass

WHITE, WEIGHTED = range(2)
"""Kinds of problems, numbered as in `enum kind` of `_levenberg_marquardt.h`."""

MOST_PATHS, MOST_ROWS, MOST_HARMONIC = 4, 8, 16
"""Largest sizes that the compiled search has room for; numpy solves larger problems."""


@dataclass(frozen=True)
class Planes:
    """n problems in the form that the compiled search takes.

    Attributes:
        kind: `WHITE` or `WEIGHTED`.
        paths: number of paths, K.
        harmonics: numbers of the N harmonics.
        re, im: parts of the measured phasors, (N, n).
        weights: (N,) for `WHITE`, (3, N, n) for `WEIGHTED`.
    """

    kind: int
    paths: int
    harmonics: tuple[int, ...]
    re: Float
    im: Float
    weights: Float


@dataclass(frozen=True)
class Minimum:
    """Ends of n searches: points (P, n), cost (n,), triangle of JᵀWJ, whether they converged, numbers of steps."""

    points: Float
    cost: Float
    matrix: Float
    converged: Bool
    steps: Index


def compiled_search(harmonics: tuple[int, ...], /, *, paths: int) -> ModuleType | None:
    """Return the extension module; None if it was not built or has no room for these paths and harmonics."""
    if not (0 < len(harmonics) <= MOST_ROWS and max(harmonics) <= MOST_HARMONIC and 0 < paths <= MOST_PATHS):
        return None
    try:
        from cadtof_cli.resolver.likelihood import _likelihood
    except ImportError:
        return None
    return _likelihood


def compiled_ends(
    planes: Planes,
    starts: Float,
    /,
    *,
    worth: Float,
    most_steps: int,
    relative: float,
    first_damping: float,
    kernel: str,
) -> Minimum | None:
    """Minimise n problems from their starts, (P, n); None if numpy must do it. Options: see `LevenbergMarquardt`."""
    compiled = compiled_search(planes.harmonics, paths=planes.paths)
    if compiled is None:
        return None
    count, size = starts.shape[1], 2 * planes.paths
    ends = Minimum(
        np.empty_like(starts, order="C"),
        np.empty(count),
        np.empty((size * (size + 1) // 2, count)),
        np.empty(count, np.bool_),
        np.empty(count, np.intp),
    )
    given = (planes.re, planes.im, planes.weights, starts, worth)
    compiled.solve(
        kernel,
        planes.kind,
        planes.paths,
        most_steps,
        relative,
        first_damping,
        np.array(planes.harmonics, np.int64),
        *(np.ascontiguousarray(part) for part in given),
        ends.points,
        ends.cost,
        ends.matrix,
        ends.converged,
        ends.steps,
    )
    return ends


def compiled_weights(points: Float, /, *, harmonics: tuple[int, ...], noise: Float, kernel: str) -> Float | None:
    """Return the entries of the inverse covariances of n pixels, (3, N, n), for light of the paths in points (3·K, n).

    Return None if numpy must do it. `noise`, (N, 3), holds level, double and averaging of each harmonic
    (`HarmonicNoise.covariance_terms`).
    """
    paths = len(points) // 3
    compiled = compiled_search(harmonics, paths=paths)
    if compiled is None:
        return None
    weights = np.empty((3, len(harmonics), points.shape[1]))
    compiled.weigh(kernel, paths, np.array(harmonics, np.int64), noise, np.ascontiguousarray(points), weights)
    return weights


@dataclass(frozen=True)
class Scanned:
    """The best delays of a grid for n pixels, (n,) each.

    `first` is the place of the path in the grid, `peak` its matched sum. For a pair, the other path lies `lag` places
    later, and `other` is its matched sum.
    """

    first: Index
    lag: Index
    peak: Float
    other: Float

    @classmethod
    def empty(cls, count: int, /) -> "Scanned":
        """Return uninitialised arrays for `count` pixels."""
        return cls(np.empty(count, np.intp), np.empty(count, np.intp), np.empty(count), np.empty(count))


def compiled_scan(
    factors: Float, lags: Float, re: Float, im: Float, /, *, harmonics: tuple[int, ...], pairs: bool, kernel: str
) -> Scanned | None:
    """Scan a grid of delays for phasors in real and imaginary parts, (N, n) each; None if numpy must do it.

    `factors`, (places, N, 2), are the weight of a harmonic times cosine and sine at each delay. `lags`, (places/2, 3),
    are ρ, −2ρ and 1/(1 − ρ²) of each lag from 1 on.
    """
    compiled, (places, rows) = compiled_search(harmonics, paths=1 + pairs), factors.shape[:2]
    if compiled is None:
        return None
    found, planes = Scanned.empty(re.shape[1]), (np.ascontiguousarray(part) for part in (factors, lags, re, im))
    compiled.scan(kernel, rows, places, pairs, *planes, found.first, found.lag, found.peak, found.other)
    return found
