"""Paths that need a search: more than two harmonics, more than two paths, or the paper's solver."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.many_paths import resolve_many
from cadtof_cli.resolver.likelihood.mixture import Measured
from cadtof_cli.resolver.paths import Path, PathSet, ResolvedPaths
from cadtof_cli.resolver.returns import arranged
from cadtof_cli.resolver.screening import screened
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit

LEAST_PATHS = 2
"""Paths that an answer has room for, whatever was asked: the direct one, and that of the MPI."""


def searched_paths(
    phasors: Complex,
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None = None,
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) as `resolve_paths` does, whatever the harmonics.

    Only pixels with an answer are searched: gathering them costs less than a step of the search.
    """
    measured = Measured.of_phasors(phasors, harmonics=noise.numbers)
    squares = [re * re + im * im for re, im in zip(measured.re, measured.im, strict=True)]
    with np.errstate(all="ignore"):
        status, confidence = screened(
            np.sqrt(squares[0]),
            squares,
            saturated=saturated,
            settings=settings,
            noise=noise,
            amplitude_v=amplitude_v,
            samples=samples,
        )
        at: Index = np.flatnonzero(status == 0)
        many = np.ones(at.size) if samples is None else samples[at]
        found = resolve_many(measured.taken(at), settings=settings, noise=noise, samples=many)
        for marked, bit in _marks(found):
            status[at[marked]] |= np.uint32(bit)
        paths = [_spread(path, at, status.size) for path in arranged(found, settings)]
    nothing = Path(*(np.full(status.size, np.nan) for _ in range(3)))
    paths += [nothing] * (max(settings.paths, LEAST_PATHS) - len(paths))
    chi_squared = np.full(status.size, np.nan)
    chi_squared[at] = found.chi_squared
    return ResolvedPaths(paths[0], paths[1], confidence, status, tuple(paths[2:]), chi_squared)


def _marks(found: PathSet) -> tuple[tuple[Bool, StatusBit], ...]:
    count = np.isfinite(found.amplitude).sum(axis=0)
    return (
        (count == 1, StatusBit.ONE_PATH),
        (count == 2, StatusBit.TWO_PATHS),
        (count > 2, StatusBit.MORE_PATHS),
        (found.doubtful, StatusBit.ILL_CONDITIONED),
        (~found.converged, StatusBit.NOT_CONVERGED),
    )


def _spread(path: Path, at: Index, count: int) -> Path:
    """Return a path of the pixels `at` as one of all `count` pixels, NaN in the others."""

    def spread(values: Float | Float32) -> Float:
        everywhere = np.full(count, np.nan)
        everywhere[at] = values
        return everywhere

    return Path(spread(path.amplitude), spread(path.phase_rad), spread(path.sigma_rad))
