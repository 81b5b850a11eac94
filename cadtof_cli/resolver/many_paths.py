"""How many paths, and which: from one path on, as many as the noise does not explain, for any number of harmonics."""

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index
from cadtof_cli.resolver.eliminated import random_starts, two_shares
from cadtof_cli.resolver.likelihood import Fit, Found, fisher_fit, found_paths, most_likely
from cadtof_cli.resolver.mixture import Measured, Mixture
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.order import chi_squared_threshold
from cadtof_cli.resolver.paths import PathSet
from cadtof_cli.resolver.rotors import phase_of
from cadtof_cli.resolver.settings import ResolverSettings

SURELY_MORE = 2.0
"""Misfit with white noise, over the threshold, that settles the order: no light has more than twice the noise of ambient
light in any direction, so that the best fit with the noise of the light that was found cannot come below the threshold."""

NO_AMPLITUDE = 1e-9
"""Share of the strongest path below which a path is none: where the most likely amplitude is 0 it comes out as rounding."""


def resolve_many(measured: Measured, /, *, settings: ResolverSettings, noise: NoiseModel, samples: Float) -> PathSet:
    """Return the paths of n pixels: the fewest, up to `settings.max_paths`, that leave no more than noise does.

    With an order given it is that many. `samples`, (n,), is the number of pixels that each has been averaged over.
    """
    answer = _Answer(settings.max_paths, measured.re.shape[1])
    at_work: Index = np.arange(samples.size)
    found: Found | None = None
    for count in range(1, settings.max_paths + 1):
        last = count == settings.max_paths
        if last and settings.solver == "lm" and count == 2:
            answer.store(at_work, _eliminated(measured, settings, noise), samples[at_work])
            break
        found = found_paths(measured, fewer=found, noise=noise)
        if last:
            answer.store(at_work, most_likely(measured, found, noise=noise), samples[at_work])
        elif settings.order == "auto":
            limit = chi_squared_threshold(settings.false_alarm, pairs=len(measured.harmonics) - count)
            maybe = np.flatnonzero(found.chi_squared * samples[at_work] <= SURELY_MORE * limit)
            fit = most_likely(measured.taken(maybe), found.taken(maybe), noise=noise)
            fits = np.flatnonzero(fit.chi_squared * samples[at_work[maybe]] <= limit)
            answer.store(at_work[maybe[fits]], fit.taken(fits), samples[at_work[maybe[fits]]])
            going = np.delete(np.arange(at_work.size), maybe[fits])
            at_work, measured, found = at_work[going], measured.taken(going), found.taken(going)
            if not going.size:
                break
    return answer.paths


def _eliminated(measured: Measured, settings: ResolverSettings, noise: NoiseModel) -> Fit:
    phasors = measured.re + 1j * measured.im
    starts = random_starts(settings.starts, seed=settings.seed)
    two = two_shares(phasors, harmonics=measured.harmonics, starts=starts)
    return fisher_fit(measured, Mixture(two.amplitude, two.cos, two.sin), converged=two.converged, noise=noise)


class _Answer:
    """The paths of a block as they become known."""

    def __init__(self, most: int, count: int, /) -> None:
        def unknown() -> Float:
            return np.full((most, count), np.nan)

        self.paths = PathSet(
            unknown(),
            unknown(),
            unknown(),
            np.full(count, np.nan),
            np.zeros(count, np.bool_),
            np.zeros(count, np.bool_),
        )

    def store(self, of: Index, fit: Fit, samples: Float) -> None:
        """Put a fit's paths into the pixels `of`, with the standard deviations that averaging leaves."""
        amplitude, paths = fit.paths.amplitude, self.paths
        none = ~(amplitude > NO_AMPLITUDE * amplitude.max(axis=0)) | ~fit.converged
        sigma = np.where(none, np.nan, fit.sigma_rad / np.sqrt(samples))
        rows = slice(0, len(amplitude))
        paths.amplitude[rows, of] = np.where(none, np.nan, amplitude)
        paths.phase_rad[rows, of] = np.where(none, np.nan, phase_of((fit.paths.cos, fit.paths.sin)))
        paths.sigma_rad[rows, of] = sigma
        paths.chi_squared[of] = fit.chi_squared * samples
        paths.converged[of] = fit.converged
        paths.doubtful[of] = _doubtful(fit.paths, sigma)


def _doubtful(paths: Mixture, sigma: Float) -> Bool:
    """Return where a standard deviation exceeds half the distance between two paths (its sine)."""
    doubtful = np.zeros(sigma.shape[1], np.bool_)
    for i in range(len(sigma)):
        for j in range(i):
            cos = paths.cos[i] * paths.cos[j] + paths.sin[i] * paths.sin[j]
            half = np.sqrt(np.maximum(0.5 * (1.0 - cos), 0.0))
            doubtful |= np.maximum(sigma[i], sigma[j]) > half
    return doubtful
