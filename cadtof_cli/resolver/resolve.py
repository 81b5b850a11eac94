"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index, Status
from cadtof_cli.phasors.chi_squared import chi_squared_threshold
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.likelihood.searched import searched_paths
from cadtof_cli.resolver.order import worth_another
from cadtof_cli.resolver.paths import Path, ResolvedPaths
from cadtof_cli.resolver.response.by_response import paths_by_response
from cadtof_cli.resolver.response.table import ResponseBlock
from cadtof_cli.resolver.returns import direct_and_mpi
from cadtof_cli.resolver.screening import screened
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.two_path.closed_form import (
    FundamentalFrame,
    fundamental_frame,
    is_single,
    phase_of,
    two_paths,
)
from cadtof_cli.resolver.two_path.one_path import one_path
from cadtof_cli.resolver.two_path.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 0
"""Newton steps of the one-path fit where the order test follows. What the test accepts deviates from one path by no more than
noise, and to first order in the noise the fit's start is its end: a step would change the scatter by less than 0.1 %."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""


@dataclass(frozen=True)
class _Alone:
    """Pixels that may have one path only, their indices, its fit, and whether its misfit is more than noise; (m,) each."""

    pixels: Index
    path: Path
    misfit: Bool


def resolve_paths(
    phasors: Complex,
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None = None,
    response: ResponseBlock | None = None,
    hot: Bool | None = None,
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) into paths; inputs are not changed.

    A pixel that is saturated, hot, not finite or without a signal gets NaN and a status bit. Every pixel is computed alone, by
    the same operations wherever it stands, so that blocks of any size give the same bits. `samples`, (n,), is the number of
    recorded pixels that each phasor has been averaged over; None: 1. Where the channel pairs answer with more than a sine,
    `response` says how.

    Raises:
        SettingsError: the harmonics cannot tell as many paths apart as the settings ask for.
    """
    settings.check_harmonics(noise.numbers)
    resolve: Callable[..., ResolvedPaths]
    if response is not None:
        settings.check_response(noise.numbers)
        resolve = partial(paths_by_response, response=response)
    elif settings.in_closed_form(noise.numbers):
        resolve = _in_closed_form
    else:
        resolve = searched_paths
    resolved = resolve(
        phasors,
        saturated=saturated if hot is None else saturated | hot,
        settings=settings,
        noise=noise,
        amplitude_v=amplitude_v,
        samples=samples,
    )
    if hot is not None:
        status = resolved.status
        status[hot & ~saturated] &= ~np.uint32(StatusBit.SATURATED)
        status[hot] |= np.uint32(StatusBit.HOT_PIXEL)
    if samples is not None:
        np.bitwise_or(resolved.status, np.uint32(StatusBit.POOLED), out=resolved.status, where=samples > 1.0)
    return resolved


def _in_closed_form(
    phasors: Complex,
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None,
) -> ResolvedPaths:
    with np.errstate(all="ignore"):
        frame = fundamental_frame(phasors[0], phasors[1])
        status, confidence = screened(
            frame.u,
            frame.powers,
            saturated=saturated,
            settings=settings,
            noise=noise,
            amplitude_v=amplitude_v,
            samples=samples,
        )
        answered = status == 0
        if not answered.all():
            # NaN in the phasor is NaN in all that follows from it.
            frame = replace(frame, u=np.where(answered, frame.u, np.nan))
        alone = _fitted_alone(frame, settings, noise, samples)
        status |= answered * np.uint32(StatusBit.TWO_PATHS)
        direct, mpi = _paths(frame, alone, settings, noise, samples, status)
    return ResolvedPaths(direct, mpi, confidence, status)


def _fitted_alone(
    frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel, samples: Float | None
) -> _Alone:
    """Fit one path wherever there may be no more."""
    threshold, steps = np.inf, ORDER_TEST_STEPS
    if settings.max_paths == 1:
        pixels, steps = np.arange(frame.u.size), ONE_PATH_STEPS
    elif settings.order == "2":
        pixels = np.flatnonzero(is_single(frame))
    else:
        threshold = chi_squared_threshold(settings.false_alarm, pairs=1)
        pixels = np.flatnonzero(_may_be_one_path(frame, threshold, noise, samples))
    fit = one_path(frame.at(pixels), noise=noise, steps=steps)
    sigma = _averaged(fit.sigma_rad, samples, pixels)
    misfit = _times(fit.chi_squared, samples, pixels) > threshold
    return _Alone(pixels, Path(fit.amplitude, phase_of(fit.cos, fit.sin), sigma), misfit)


def _may_be_one_path(frame: FundamentalFrame, threshold: float, noise: NoiseModel, samples: Float | None) -> Bool:
    """Return False where one path leaves a χ² above the threshold for certain, without fitting it.

    If the best single path leaves n1 and n2 of the two phasors, then |p1| − p2·conj(ρ)² is at most (1+π)|n1| + |n2|, because
    n1 turns ρ by no more than π|n1|/2a; and noise along and across a phasor has at most twice its dark variance.
    """
    first, second = noise.harmonics
    limit = 2.0 * threshold * ((1.0 + np.pi) ** 2 * first.dark_variance + second.dark_variance)
    difference = frame.u - frame.pr
    square = difference * difference + frame.pi * frame.pi
    may: Bool = _times(square, samples, slice(None)) <= limit
    return may


def _paths(
    frame: FundamentalFrame,
    alone: _Alone,
    settings: ResolverSettings,
    noise: NoiseModel,
    samples: Float | None,
    status: Status,
) -> tuple[Path, Path]:
    """Return the direct and the MPI path; mark in `status` which pixels have one path, and which two cannot be told apart."""
    count = frame.u.size
    # Where most pixels need two paths, the few others are computed along and written over: that is faster than to gather.
    everywhere = 2 * np.count_nonzero(~alone.misfit) <= count
    chosen = np.empty(0, np.intp) if everywhere else np.delete(np.arange(count), alone.pixels[~alone.misfit])
    two = two_paths(frame if everywhere else frame.at(chosen))
    sigma_x, sigma_y = (
        _averaged(sigma, samples, slice(None) if everywhere else chosen) for sigma in two_path_sigmas(two, noise=noise)
    )
    doubtful = (np.maximum(sigma_x, sigma_y) > two.sin_half) * np.uint32(StatusBit.ILL_CONDITIONED)
    x, y = two.phases()
    direct, mpi = direct_and_mpi(Path(two.a, x, sigma_x), Path(two.b, y, sigma_y), settings)
    if everywhere:
        status |= doubtful
    else:
        status[chosen] |= doubtful
        direct, mpi = direct.spread(chosen, count), mpi.spread(chosen, count)
    kept = ~alone.misfit
    kept[alone.misfit] = ~worth_another(direct.at(alone.pixels[alone.misfit]), alone.path.at(alone.misfit))
    single = alone.pixels[kept]
    direct.put(single, alone.path.at(kept))
    mpi.put(single, Path(*(np.full(single.size, np.nan),) * 3))
    status[single] = np.where(status[single] & StatusBit.TWO_PATHS, StatusBit.ONE_PATH, status[single])
    return direct, mpi


def _times(chi_squared: Float, samples: Float | None, of: slice | Index) -> Float:
    """Return a misfit over the noise of one pixel as one over the noise of means of `samples` pixels."""
    return chi_squared if samples is None else chi_squared * samples[of]


def _averaged(sigma: Float | Float32, samples: Float | None, of: slice | Index) -> Float | Float32:
    """Return a standard deviation from the noise of one pixel as one from that of means of `samples` pixels."""
    return sigma if samples is None else sigma / np.sqrt(samples[of])
