"""The front of the compiled search and scans: what `levenberg_marquardt` and `starts` do, with the same bits."""

from types import ModuleType

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.records import dataclass

WHITE, WEIGHTED = range(2)
"""Kinds of problems, in the order of `enum kind` in `_search.h`."""

MOST_PATHS, MOST_ROWS, MOST_HARMONIC = 4, 8, 16
"""What there is room for there; numpy solves what is larger."""


@dataclass(frozen=True)
class Planes:
    """n problems as the compiled search takes them.

    Attributes:
        kind: of which kind they are.
        paths: K.
        harmonics: N numbers of harmonics.
        re, im: what was measured, (N, n).
        weights: of `WHITE` (N,), of `WEIGHTED` (3, N, n).
    """

    kind: int
    paths: int
    harmonics: tuple[int, ...]
    re: Float
    im: Float
    weights: Float


@dataclass(frozen=True)
class Minimum:
    """Where n problems ended: points (P, n), cost (n,), JᵀWJ by its triangle, which converged, and after how many steps."""

    points: Float
    cost: Float
    matrix: Float
    converged: Bool
    steps: Index


def compiled_search(harmonics: tuple[int, ...], /, *, paths: int) -> ModuleType | None:
    """Return the extension module; None where it was not built, or has no room for so many paths of these harmonics."""
    if not (0 < len(harmonics) <= MOST_ROWS and max(harmonics) <= MOST_HARMONIC and 0 < paths <= MOST_PATHS):
        return None
    try:
        from cadtof_cli.resolver.likelihood import _search
    except ImportError:
        return None
    return _search


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
    """Minimise n problems from their starts, (P, n); None where numpy has to. See `LevenbergMarquardt` for the options."""
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
    """Return the inverse covariances' entries of n pixels, (3, N, n), for the light of points (3·K, n); None where numpy has to.

    `noise`, (N, 3), is level, double and averaging of each harmonic (`HarmonicNoise.covariance_terms`).
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
    """The best of a grid's delays for n pixels, (n,) each.

    `first` is the place of a path in the grid, `peak` its matched sum; of a pair `lag` is how many places behind the other one
    lies, with the matched sum `other`.
    """

    first: Index
    lag: Index
    peak: Float
    other: Float

    @classmethod
    def empty(cls, count: int, /) -> "Scanned":
        """Return room for so many pixels."""
        return cls(np.empty(count, np.intp), np.empty(count, np.intp), np.empty(count), np.empty(count))


def compiled_scan(
    factors: Float, lags: Float, re: Float, im: Float, /, *, harmonics: tuple[int, ...], pairs: bool, kernel: str
) -> Scanned | None:
    """Scan a grid for phasors in parts, (N, n); None where numpy has to.

    `factors`, (places, N, 2), are a harmonic's weight times cosine and sine at each delay; `lags`, (places/2, 3), are
    ρ, −2ρ and 1/(1 − ρ²) of each lag from 1 on.
    """
    compiled, (places, rows) = compiled_search(harmonics, paths=1 + pairs), factors.shape[:2]
    if compiled is None:
        return None
    found, planes = Scanned.empty(re.shape[1]), (np.ascontiguousarray(part) for part in (factors, lags, re, im))
    compiled.scan(kernel, rows, places, pairs, *planes, found.first, found.lag, found.peak, found.other)
    return found
