"""How many paths a pixel has: the fewest that leave no more than noise does."""

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
"""Rows of the result at least, whatever was asked: the direct path, and that of the MPI."""


class Solver(Protocol):
    """What a room of the resolver offers by its module `solver`, for the phasors of a block of n pixels."""

    @property
    def modulus(self) -> Float:
        """|p| of the first harmonic, (n,)."""

    @property
    def powers(self) -> Sequence[Float]:
        """|p|² of every harmonic, (n,) each."""

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[SomePixels, Fit]:
        """Fit `count` paths to the pixels, bool (n,), and return the indices of those that were fitted, rising.

        A solver may fit the whole block where that is faster, and then returns a slice. It may leave out pixels whose χ² is
        certainly above `limit`, a number or (n,); None: no pixel may get more paths than these.
        """


def fewest_paths(solver: Solver, answered: Bool, /, *, settings: ResolverSettings, noise: NoiseModel) -> Fit:
    """Return the paths of n pixels, the direct one first: the fewest, up to `settings.max_paths`, that leave only noise.

    A pixel gets no further path that is not worth it (`worth_another`). Where the order is given, it is that many. Pixels that
    are not `answered` may hold anything.
    """
    rows, unresolved = max(settings.paths, LEAST_PATHS), answered.copy()
    if not unresolved.any():
        return Fit.none(rows, unresolved.size)
    first = 1 if settings.order == "auto" else settings.max_paths
    fewer: tuple[Index, Fit] | None = None
    for count in range(first, settings.max_paths):
        # what noise alone leaves
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


def worth_another(direct: Paths, fewer: Paths, /) -> Bool:
    """Return where another path moves the direct one by more than the scatter that it costs; `fewer` is that without it.

    One path is biased by δ, two scatter more: E(difference²) = δ² + σ2² − σ1², so the mean squared error of the direct phase is
    the smaller with two where difference² > 2(σ2² − σ1²): the focused information criterion (Claeskens and Hjort 2003,
    doi:10.1198/016214503000000819) for that phase. It stops splits of one path into two all but coinciding ones, a hundredth of
    all pixels by the misfit alone, from doubling the error of all.
    """
    difference = np.abs(direct.phase_rad - fewer.phase_rad)
    difference = np.minimum(difference, FULL_TURN - difference)
    cost = np.square(direct.sigma_rad) - np.square(fewer.sigma_rad)
    worth: Bool = difference * difference > 2.0 * cost
    return worth


def with_direct_first(fit: Fit, settings: ResolverSettings, noise: NoiseModel, pixels: SomePixels) -> Fit:
    """Return a fit with the direct path first, and with the noise of means, where the phasors are means of several pixels."""
    paths = direct_first(fit.paths, settings)
    if noise.samples is None:
        return replace(fit, paths=paths)
    samples = noise.samples[pixels]
    root = np.sqrt(samples)
    doubt = fit.doubt * samples if len(paths) == 1 else fit.doubt / root
    return Fit(replace(paths, sigma_rad=paths.sigma_rad / root), fit.chi_squared * samples, fit.converged, doubt)


def _of_all_pixels(fit: Fit, pixels: SomePixels, count: int, rows: int) -> Fit:
    """Return a fit of some pixels as one of all, with room for as many paths; NaN elsewhere."""
    if isinstance(pixels, slice) and len(fit.paths) == rows:
        return fit
    whole = Fit.none(rows, count)
    whole[pixels] = fit
    return whole


def _fewer_where_enough(whole: Fit, pixels: SomePixels, fewer: tuple[Index, Fit], unresolved: Bool) -> Fit:
    """Write the fit of fewer paths over that of more, which is in `pixels`, where fewer do or another is not worth it."""
    known, fit = fewer
    fitted = np.zeros(unresolved.size, np.bool_)
    fitted[pixels] = True
    rivals = np.flatnonzero((fitted & unresolved)[known])
    kept = np.ones(known.size, np.bool_)
    kept[rivals] = ~worth_another(whole.paths[0][known[rivals]], fit.paths[0][rivals])
    chosen = np.flatnonzero(kept)
    whole[known[chosen]] = fit[chosen]
    return whole
