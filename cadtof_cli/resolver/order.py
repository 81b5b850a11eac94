"""How many paths a pixel has: the smallest number whose misfit noise alone can explain."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, SomePixels
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.resolver.paths import FULL_TURN, Fit, Paths
from cadtof_cli.resolver.returns import direct_first
from cadtof_cli.resolver.settings import ResolverSettings

LEAST_PATHS = 2
"""Smallest number of rows of the result, even if the settings allow one path only: the direct path and the MPI path."""


class Solver(Protocol):
    """Fits paths to the phasors of a block of n pixels; each room of the resolver makes one in its module `solver`."""

    @property
    def modulus(self) -> Float:
        """|p_1|, the modulus of the first harmonic's phasor, (n,)."""

    @property
    def powers(self) -> Sequence[Float]:
        """|p_h|² of every harmonic, (n,) each."""

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[SomePixels, Fit]:
        """Fit `count` paths to the pixels, bool (n,), and return the indices of the fitted pixels, in rising order.

        A solver may fit the whole block if that is faster; it then returns a slice. It may leave out pixels whose χ² is
        certainly above `limit`, a number or (n,). `limit` is None if `count` is the largest number of paths that is
        allowed.
        """


def fewest_paths(solver: Solver, answered: Bool, /, *, settings: ResolverSettings, noise: NoiseModel) -> Fit:
    """Return the paths of n pixels, the direct path first.

    A pixel gets the smallest number of paths, up to `settings.max_paths`, whose misfit is within noise. It gets one
    path more only if that path is worth its scatter (`worth_another`). If the settings fix the order, every pixel gets
    that number. At least one pixel is `answered`; the result of the others has no meaning.
    """
    rows, unresolved = max(settings.paths, LEAST_PATHS), answered.copy()
    first = 1 if settings.order == "auto" else settings.max_paths
    fewer: tuple[Index, Fit] | None = None
    for count in range(first, settings.max_paths):
        # χ² that noise alone exceeds with probability `false_alarm`
        threshold = chi_squared_threshold(settings.false_alarm, pairs=len(noise.each) - count)
        limit = threshold if noise.samples is None else threshold / noise.samples
        pixels, fit = solver.fit(count, unresolved, limit=limit)
        fit = with_direct_first(fit, settings, noise, pixels)
        assert isinstance(pixels, np.ndarray)
        if fewer is not None:
            whole = _of_all_pixels(fit, pixels, answered.size, rows)
            known = np.union1d(pixels, fewer[0])
            fewer = known, _fewer_where_enough(whole, pixels, fewer, unresolved)[known]
        else:
            fewer = pixels, fit
        unresolved[pixels] &= fit.chi_squared > threshold
    if fewer is not None and not unresolved.any():
        return _of_all_pixels(fewer[1], fewer[0], answered.size, rows)
    chosen, fit = solver.fit(settings.max_paths, unresolved, limit=None)
    fit = with_direct_first(fit, settings, noise, chosen)
    whole = _of_all_pixels(fit, chosen, answered.size, rows)
    return whole if fewer is None or not fewer[0].size else _fewer_where_enough(whole, chosen, fewer, unresolved)


def move_and_limit(direct: Paths, fewer: Paths, /) -> tuple[Float, Float]:
    """Return by how much another path moves the direct path, in rad, and the square of the least move that is worth it.

    `direct` is the direct path with the other path, `fewer` the direct path without it. The square is below 0 if the
    other path adds no scatter. The answer with fewer paths has a bias δ; the answer with more paths has more scatter.
    E(difference²) = δ² + σ2² − σ1². So the mean squared error of the direct phase is smaller with the other path if
    difference² > 2(σ2² − σ1²). This is the focused information criterion (Claeskens and Hjort 2003,
    doi:10.1198/016214503000000819) for the direct phase. By the misfit alone, one pixel in a hundred would be split into
    two paths that nearly coincide, and these pixels would double the error over all pixels.
    """
    difference = np.abs(direct.phase_rad - fewer.phase_rad)
    moved: Float = np.minimum(difference, FULL_TURN - difference)
    return moved, 2.0 * (np.square(direct.sigma_rad) - np.square(fewer.sigma_rad))


def worth_another(direct: Paths, fewer: Paths, /) -> Bool:
    """Return True where another path moves the direct path by more than the scatter that the other path adds."""
    moved, limit = move_and_limit(direct, fewer)
    worth: Bool = moved * moved > limit
    return worth


def with_direct_first(fit: Fit, settings: ResolverSettings, noise: NoiseModel, pixels: SomePixels) -> Fit:
    """Return a fit with the direct path first, and with the noise of means if phasors are means of several pixels."""
    paths = direct_first(fit.paths, settings)
    if noise.samples is None:
        return replace(fit, paths=paths)
    samples = noise.samples[pixels]
    root = np.sqrt(samples)
    doubt = fit.doubt * samples if len(paths) == 1 else fit.doubt / root
    return Fit(replace(paths, sigma_rad=paths.sigma_rad / root), fit.chi_squared * samples, fit.converged, doubt)


def _of_all_pixels(fit: Fit, pixels: SomePixels, count: int, rows: int) -> Fit:
    """Return the fit of `pixels` as a fit of all `count` pixels with `rows` paths; other pixels and paths are NaN."""
    if isinstance(pixels, slice) and len(fit.paths) == rows:
        return fit
    whole = Fit.none(rows, count)
    whole[pixels] = fit
    return whole


def _fewer_where_enough(whole: Fit, pixels: SomePixels, fewer: tuple[Index, Fit], unresolved: Bool) -> Fit:
    """Overwrite the fit with more paths by that with fewer, where fewer are enough or another path is not worth it.

    `whole` holds more paths in `pixels` only. In pixels that are not `unresolved`, fewer paths are enough.
    """
    known, fit = fewer
    fitted = np.zeros(unresolved.size, np.bool_)
    fitted[pixels] = True
    rivals = (fitted & unresolved)[known]
    kept = np.ones(known.size, np.bool_)
    kept[rivals] = ~worth_another(whole.paths[0][known[rivals]], fit.paths[0][rivals])
    chosen = np.flatnonzero(kept)
    whole[known[chosen]] = fit[chosen]
    return whole
