"""How many paths, and which: from one path on, as many as the noise does not explain, for any number of harmonics."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.maximum import Fit, fisher_fit, found_paths, most_likely
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture
from cadtof_cli.resolver.order import worth_another
from cadtof_cli.resolver.paper.eliminated import random_starts, two_shares
from cadtof_cli.resolver.paths import PathSet
from cadtof_cli.resolver.returns import arranged
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.two_path.closed_form import fundamental_frame, phase_of
from cadtof_cli.resolver.two_path.one_path import one_path

SURELY_MORE = 2.0
"""Misfit with white noise, over the threshold, that settles the order: no light has more than twice the noise of ambient
light in any direction, so that the best fit with the noise of the light that was found cannot come below the threshold."""

NO_AMPLITUDE = 1e-9
"""Share of the strongest path below which a path is none: where the most likely amplitude is 0 it comes out as rounding."""


def resolve_many(measured: Measured, /, *, settings: ResolverSettings, noise: NoiseModel, samples: Float) -> PathSet:
    """Return the paths of n pixels: the fewest, up to `settings.max_paths`, that leave no more than noise does.

    Nor does a pixel get another path that is not worth it (`worth_another`).

    With an order given it is that many. `samples`, (n,), is the number of pixels that each has been averaged over.
    """
    answer = _Answer(settings, measured.re.shape[1])
    at_work: Index = np.arange(samples.size)
    if settings.order == "auto":
        for count in range(1, settings.max_paths):
            limits = chi_squared_threshold(settings.false_alarm, pairs=len(measured.harmonics) - count) / samples
            done = _resolved_as(count, answer, at_work, measured, limits[at_work], samples, noise)
            at_work = np.delete(at_work, done)
            measured = measured.taken(np.delete(np.arange(measured.re.shape[1]), done))
    if not at_work.size:
        return answer.paths
    if settings.solver == "lm" and settings.max_paths == 2:
        fit = _eliminated(measured, settings, noise)
    else:
        fit = most_likely(measured, found_paths(measured, settings.max_paths, noise=noise), noise=noise)
    answer.store(at_work, fit, samples)
    return answer.paths


def _resolved_as(
    count: int,
    answer: "_Answer",
    at_work: Index,
    measured: Measured,
    limits: Float,
    samples: Float,
    noise: NoiseModel,
) -> Index:
    """Store `count` paths where they may do, and return where they leave no more than the limits, among the pixels at work."""
    some: Index = np.flatnonzero(~surely_more_paths(measured, count, limits=limits, noise=noise))
    found = found_paths(measured.taken(some), count, noise=noise)
    maybe = np.flatnonzero(found.chi_squared <= SURELY_MORE * limits[some])
    fit = most_likely(measured.taken(some[maybe]), found.taken(maybe), noise=noise)
    answer.store(at_work[some[maybe]], fit, samples)
    done: Index = some[maybe][fit.chi_squared <= limits[some[maybe]]]
    return done


def surely_more_paths(measured: Measured, count: int, /, *, limits: Float, noise: NoiseModel) -> Bool:
    """Return where the first two harmonics alone leave more than the limits of one path, without a search.

    What all harmonics leave is no less than what two do. The fit is that of `one_path` without a step, exact to first order in
    the noise, for which `SURELY_MORE` leaves room.
    """
    if count > 1 or measured.harmonics[:2] != (1, 2):
        return np.zeros(limits.size, np.bool_)
    first, second = (measured.re[row] + 1j * measured.im[row] for row in (0, 1))
    fit = one_path(fundamental_frame(first, second), noise=replace(noise, harmonics=noise.harmonics[:2]), steps=0)
    more: Bool = fit.chi_squared > SURELY_MORE * limits
    return more


def _eliminated(measured: Measured, settings: ResolverSettings, noise: NoiseModel) -> Fit:
    phasors = measured.re + 1j * measured.im
    starts = random_starts(settings.starts, seed=settings.seed)
    two = two_shares(phasors, harmonics=measured.harmonics, starts=starts)
    return fisher_fit(measured, Mixture(two.amplitude, two.cos, two.sin), converged=two.converged, noise=noise)


class _Answer:
    """The paths of a block as they become known."""

    def __init__(self, settings: ResolverSettings, count: int, /) -> None:
        def unknown() -> Float:
            return np.full((settings.max_paths, count), np.nan)

        no = np.zeros(count, np.bool_)
        self.paths = PathSet(unknown(), unknown(), unknown(), np.full(count, np.nan), no, no.copy())
        self._settings = settings

    def store(self, of: Index, fit: Fit, samples: Float) -> None:
        """Put a fit's paths into the pixels `of`, with what averaging over `samples`, of all pixels, leaves of the noise.

        A pixel that has fewer paths already keeps them, unless another is worth it.
        """
        new = _path_set(fit, samples[of])
        rivals: Index = np.flatnonzero(np.isfinite(self.paths.chi_squared[of]))
        direct, fewer = (arranged(paths, self._settings)[0] for paths in (new.at(rivals), self.paths.at(of[rivals])))
        replaced = np.delete(np.arange(of.size), rivals[~worth_another(direct, fewer)])
        self.paths.put(of[replaced], new.at(replaced))


def _path_set(fit: Fit, samples: Float) -> PathSet:
    amplitude = fit.paths.amplitude
    none = ~(amplitude > NO_AMPLITUDE * amplitude.max(axis=0)) | ~fit.converged
    sigma = np.where(none, np.nan, fit.sigma_rad / np.sqrt(samples))
    return PathSet(
        np.where(none, np.nan, amplitude),
        np.where(none, np.nan, phase_of(fit.paths.cos, fit.paths.sin)),
        sigma,
        fit.chi_squared * samples,
        fit.converged,
        _doubtful(fit.paths, sigma),
    )


def _doubtful(paths: Mixture, sigma: Float) -> Bool:
    """Return where a standard deviation exceeds half the distance between two paths (its sine)."""
    doubtful = np.zeros(sigma.shape[1], np.bool_)
    for i in range(len(sigma)):
        for j in range(i):
            cos = paths.cos[i] * paths.cos[j] + paths.sin[i] * paths.sin[j]
            half = np.sqrt(np.maximum(0.5 * (1.0 - cos), 0.0))
            doubtful |= np.maximum(sigma[i], sigma[j]) > half
    return doubtful
