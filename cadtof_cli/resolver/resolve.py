"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index, Status
from cadtof_cli.resolver.closed_form import FundamentalFrame, fundamental_frame, is_single, two_paths
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import one_path
from cadtof_cli.resolver.order import chi_squared_threshold
from cadtof_cli.resolver.paths import Path, ResolvedPaths
from cadtof_cli.resolver.returns import direct_and_mpi
from cadtof_cli.resolver.rotors import phase_of
from cadtof_cli.resolver.screening import screened
from cadtof_cli.resolver.searched import searched_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 0
"""Newton steps of the one-path fit where the order test follows. What the test accepts deviates from one path by no more than
noise, and to first order in the noise the fit's start is its end: a step would change the scatter by less than 0.1 %."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""


@dataclass(frozen=True)
class _Decision:
    """Which pixels have two paths, and the fit of those that have one: `fields` of shape (single.size,) each."""

    has_two: Bool
    single: Index
    amplitude: Float
    phase_rad: Float
    sigma_rad: Float | Float32


def resolve_paths(
    phasors: Complex,
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    samples: Float | None = None,
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) into paths; inputs are not changed.

    A pixel that is saturated, not finite or without a signal gets NaN and a status bit. Every pixel is computed alone, by the
    same operations wherever it stands, so that blocks of any size give the same bits. `samples`, (n,), is the number of
    recorded pixels that each phasor has been averaged over; None: 1.

    Raises:
        SettingsError: the harmonics cannot tell as many paths apart as the settings ask for.
    """
    settings.check_harmonics(noise.numbers)
    resolve = _in_closed_form if settings.in_closed_form(noise.numbers) else searched_paths
    resolved = resolve(
        phasors,
        saturated=saturated,
        settings=settings,
        noise=noise,
        amplitude_v=amplitude_v,
        samples=samples,
    )
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
            (frame.u * frame.u, frame.pr * frame.pr + frame.pi * frame.pi),
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
        decision = _decided(frame, settings, noise, samples)
        status |= answered * np.where(decision.has_two, np.uint32(StatusBit.TWO_PATHS), np.uint32(StatusBit.ONE_PATH))
        direct, mpi = _paths(frame, decision, settings, noise, samples, status)
    return ResolvedPaths(direct, mpi, confidence, status)


def _decided(
    frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel, samples: Float | None
) -> _Decision:
    """Fit one path where there may be no more, and keep it where the misfit is within the noise."""
    count = frame.u.size
    if settings.max_paths == 1:
        candidates = np.arange(count)
        fit = one_path(frame, noise=noise, steps=ONE_PATH_STEPS)
        kept = np.ones(count, np.bool_)
    elif settings.order == "2":
        candidates = np.flatnonzero(is_single(frame))
        fit = one_path(frame.at(candidates), noise=noise, steps=ORDER_TEST_STEPS)
        kept = np.ones(candidates.size, np.bool_)
    else:
        threshold = chi_squared_threshold(settings.false_alarm, pairs=1)
        candidates = np.flatnonzero(_may_be_one_path(frame, threshold, noise, samples))
        fit = one_path(frame.at(candidates), noise=noise, steps=ORDER_TEST_STEPS)
        kept = ~(_times(fit.chi_squared, samples, candidates) > threshold)
    has_two = np.ones(count, np.bool_)
    single = candidates[kept]
    has_two[single] = False
    sigma = _averaged(fit.sigma_rad, samples, candidates)
    return _Decision(has_two, single, fit.amplitude[kept], phase_of((fit.cos, fit.sin))[kept], sigma[kept])


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
    decision: _Decision,
    settings: ResolverSettings,
    noise: NoiseModel,
    samples: Float | None,
    status: Status,
) -> tuple[Path, Path]:
    """Return the direct and the MPI path, and mark in `status` where two paths are too close or too weak to be told apart."""
    count, has_two, single = frame.u.size, decision.has_two, decision.single
    # Where most pixels have two paths, the few others are computed along and written over: that is faster than to gather.
    everywhere = 2 * single.size <= count
    chosen = slice(None) if everywhere else np.flatnonzero(has_two)
    two = two_paths(frame if everywhere else frame.at(chosen))
    sigma_x, sigma_y = (_averaged(sigma, samples, chosen) for sigma in two_path_sigmas(two, noise=noise))
    doubtful = np.maximum(sigma_x, sigma_y) > np.abs(two.sin_half)
    status[chosen] |= (doubtful & has_two[chosen]) * np.uint32(StatusBit.ILL_CONDITIONED)
    direct, mpi = direct_and_mpi(
        Path(two.a, phase_of((two.cos_x, two.sin_x)), sigma_x),
        Path(two.b, phase_of((two.cos_y, two.sin_y)), sigma_y),
        settings,
    )
    if not single.size:
        return direct, mpi
    alone = Path(decision.amplitude, decision.phase_rad, decision.sigma_rad)
    return _merged(direct, alone, single, chosen, count), _merged(mpi, None, single, chosen, count)


def _times(chi_squared: Float, samples: Float | None, of: slice | Index) -> Float:
    """Return a misfit over the noise of one pixel as one over the noise of means of `samples` pixels."""
    return chi_squared if samples is None else chi_squared * samples[of]


def _averaged(sigma: Float | Float32, samples: Float | None, of: slice | Index) -> Float | Float32:
    """Return a standard deviation from the noise of one pixel as one from that of means of `samples` pixels."""
    return sigma if samples is None else sigma / np.sqrt(samples[of])


def _merged(path: Path, alone: Path | None, single: Index, chosen: slice | Index, count: int) -> Path:
    """Return `path`, which holds the pixels in `chosen`, for all pixels, with `alone` or NaN at the indices `single`."""

    def merge(values: Float | Float32, others: Float | Float32 | float) -> Any:
        whole = values if isinstance(chosen, slice) else np.empty(count, values.dtype)
        if whole is not values:
            whole[chosen] = values
        whole[single] = others
        return whole

    if alone is None:
        return Path(*(merge(values, np.nan) for values in (path.amplitude, path.phase_rad, path.sigma_rad)))
    return Path(
        merge(path.amplitude, alone.amplitude),
        merge(path.phase_rad, alone.phase_rad),
        merge(path.sigma_rad, alone.sigma_rad),
    )
