"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index, Status
from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.closed_form import (
    FULL_TURN,
    FundamentalFrame,
    fundamental_frame,
    is_single,
    phase_of,
    two_paths,
)
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath, one_path
from cadtof_cli.resolver.order import second_path_threshold, signal_threshold
from cadtof_cli.resolver.refine import RefinedPaths, refined_one_path, refined_two_paths
from cadtof_cli.resolver.response_table import ResponseBlock
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 0
"""Newton steps of the one-path fit where the order test follows. What the test accepts deviates from one path by no more than
noise, and to first order in the noise the fit's start is its end: a step would change the scatter by less than 0.1 %."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""

_REFINED_STEPS = {1: 6, 2: 2}
"""Gauss–Newton steps of the one-path fit to a full response, by the most paths there may be."""

ECHO_RATIO = 0.5
"""A path below this share of the other's amplitude, and over half a turn ahead of it, is its echo, wrapped round the range."""


@dataclass(frozen=True)
class Path:
    """One path of n pixels: amplitude in units of the phasors, phase in rad, its standard deviation in rad, (n,) each.

    Phases lie in [0, 2π), but that of an MPI path that is known to lie behind the direct one may go on to 4π.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float | Float32


@dataclass(frozen=True)
class ResolvedPaths:
    """The answer for n pixels: the direct and the MPI path, float64 (n,) each, NaN where there is none.

    `confidence` is the magnitude of the first phasor; `status` holds bits of `StatusBit`.
    """

    direct: Path
    mpi: Path
    confidence: Float
    status: Status


@dataclass(frozen=True)
class _Decision:
    """Which pixels have two paths, and the fit of those that have one: `fields` of shape (single.size,) each.

    `alone` is the fit of all pixels, where the response is refined.
    """

    has_two: Bool
    single: Index
    amplitude: Float
    phase_rad: Float
    sigma_rad: Float
    alone: OnePath | None = None


@dataclass(frozen=True)
class _Refinement:
    """What the answer of a pure sine is refined with, where the channel pairs answer with more than that."""

    phasors: Complex
    response: ResponseBlock
    noise: NoiseModel
    steps: int

    def one(self, frame: FundamentalFrame) -> OnePath:
        """Return the best single path of all pixels."""
        start = one_path(frame, noise=self.noise, steps=1)
        return refined_one_path(start, self.phasors, response=self.response, noise=self.noise, steps=self.steps)

    def two(self, alone: OnePath, has_two: Bool) -> RefinedPaths:
        """Return two paths, exact where a pixel has two; elsewhere nothing that means anything."""
        return refined_two_paths(alone, self.phasors, has_two, response=self.response, noise=self.noise)


def resolve_paths(
    phasors: Complex,
    /,
    *,
    saturated: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    amplitude_v: float,
    response: ResponseBlock | None = None,
    hot: Bool | None = None,
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) into one or two paths; inputs are not changed.

    A pixel that is saturated, hot, not finite or without a signal gets NaN and a status bit. Every pixel is computed alone,
    by the same operations wherever it stands, so that blocks of any size give the same bits. Where the channel pairs answer
    with more than a sine, `response` says how, and the sine's answer is refined.

    Raises:
        SettingsError: the harmonics are not the fundamental and its double.
    """
    if phasors.shape[0] != 2:
        raise SettingsError(f"two-path resolving: found {phasors.shape[0]} harmonics, expected 2 (T1 and T1/2)")
    with np.errstate(all="ignore"):
        frame = fundamental_frame(phasors[0], phasors[1])
        status, confidence = _screened(frame, saturated, settings, noise, amplitude_v)
        if hot is not None:
            status |= hot * np.uint32(StatusBit.HOT_PIXEL)
            confidence = np.where(hot, np.nan, confidence)
        answered = status == 0
        if not answered.all():
            # NaN in the phasor is NaN in all that follows from it.
            frame = replace(frame, u=np.where(answered, frame.u, np.nan))
        refinement = _Refinement(phasors, response, noise, _REFINED_STEPS[settings.max_paths]) if response else None
        decision = _decided(frame, settings, noise, refinement)
        status |= answered * np.where(decision.has_two, np.uint32(StatusBit.TWO_PATHS), np.uint32(StatusBit.ONE_PATH))
        direct, mpi = _paths(frame, decision, settings, noise, status, refinement)
    return ResolvedPaths(direct, mpi, confidence, status)


def _screened(
    frame: FundamentalFrame, saturated: Bool, settings: ResolverSettings, noise: NoiseModel, amplitude_v: float
) -> tuple[Status, Float]:
    """Return the status of pixels that get no answer, 0 for the others, and the confidence of all."""
    first, second = noise.harmonics
    power = frame.powers[0] * (1.0 / first.dark_variance)
    power += frame.powers[1] * (1.0 / second.dark_variance)
    if settings.min_confidence_v is None:
        low = power <= signal_threshold(settings.false_alarm, harmonics=2)
    else:
        low = (frame.u < settings.min_confidence_v / amplitude_v) | (power == 0.0)
    status = low * np.uint32(StatusBit.LOW_CONFIDENCE)
    not_finite = ~np.isfinite(power)
    confidence = frame.u
    if saturated.any() or not_finite.any():
        status[not_finite] = StatusBit.NOT_FINITE
        status[saturated] = StatusBit.SATURATED | status[saturated] & StatusBit.NOT_FINITE
        confidence = np.where(saturated | not_finite, np.nan, frame.u)
    return status, confidence


def _decided(
    frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel, refinement: _Refinement | None
) -> _Decision:
    """Fit one path where there may be no more, and keep it where the misfit is within the noise."""
    count = frame.u.size
    if refinement is not None:
        return _decided_by_response(frame, settings, refinement)
    if settings.max_paths == 1:
        candidates = np.arange(count)
        fit = one_path(frame, noise=noise, steps=ONE_PATH_STEPS)
        kept = np.ones(count, np.bool_)
    elif settings.order == "2":
        candidates = np.flatnonzero(is_single(frame))
        fit = one_path(frame.at(candidates), noise=noise, steps=ORDER_TEST_STEPS)
        kept = np.ones(candidates.size, np.bool_)
    else:
        threshold = second_path_threshold(settings.false_alarm)
        candidates = np.flatnonzero(_may_be_one_path(frame, threshold, noise))
        fit = one_path(frame.at(candidates), noise=noise, steps=ORDER_TEST_STEPS)
        kept = ~(fit.chi_squared > threshold)
    has_two = np.ones(count, np.bool_)
    single = candidates[kept]
    has_two[single] = False
    return _Decision(has_two, single, fit.amplitude[kept], phase_of(fit.cos, fit.sin)[kept], fit.sigma_rad[kept])


def _decided_by_response(frame: FundamentalFrame, settings: ResolverSettings, refinement: _Refinement) -> _Decision:
    """Decide as `_decided` does, by fits of the full response."""
    fit = refinement.one(frame)
    if settings.max_paths == 1:
        has_two = np.zeros(frame.u.size, np.bool_)
    elif settings.order == "2":
        has_two = ~is_single(frame)
    else:
        has_two = fit.chi_squared > second_path_threshold(settings.false_alarm)
    single = np.flatnonzero(~has_two)
    phase = phase_of(fit.cos[single], fit.sin[single])
    return _Decision(has_two, single, fit.amplitude[single], phase, fit.sigma_rad[single], fit)


def _may_be_one_path(frame: FundamentalFrame, threshold: float, noise: NoiseModel) -> Bool:
    """Return False where one path leaves a χ² above the threshold for certain, without fitting it.

    If the best single path leaves n1 and n2 of the two phasors, then |p1| − p2·conj(ρ)² is at most (1+π)|n1| + |n2|, because
    n1 turns ρ by no more than π|n1|/2a; and noise along and across a phasor has at most twice its dark variance.
    """
    first, second = noise.harmonics
    limit = 2.0 * threshold * ((1.0 + np.pi) ** 2 * first.dark_variance + second.dark_variance)
    difference = frame.u - frame.pr
    may: Bool = difference * difference + frame.pi * frame.pi <= limit
    return may


def _paths(
    frame: FundamentalFrame,
    decision: _Decision,
    settings: ResolverSettings,
    noise: NoiseModel,
    status: Status,
    refinement: _Refinement | None,
) -> tuple[Path, Path]:
    """Return the direct and the MPI path, and mark in `status` where two paths are too close or too weak to be told apart."""
    count, has_two, single = frame.u.size, decision.has_two, decision.single
    # Where most pixels have two paths, the few others are computed along and written over: that is faster than to gather.
    everywhere = 2 * single.size <= count or refinement is not None
    chosen = slice(None) if everywhere else np.flatnonzero(has_two)
    if refinement is not None and decision.alone is not None:
        refined = refinement.two(decision.alone, has_two)
        two = refined.paths
        status |= (refined.failed & np.isfinite(frame.u)) * np.uint32(StatusBit.NOT_CONVERGED)
    else:
        two = two_paths(frame if everywhere else frame.at(chosen))
    sigma_x, sigma_y = two_path_sigmas(two, noise=noise)
    doubtful = np.maximum(sigma_x, sigma_y) > two.sin_half
    status[chosen] |= (doubtful & has_two[chosen]) * np.uint32(StatusBit.ILL_CONDITIONED)
    x, y = two.phases()
    direct, mpi = _direct_and_mpi(Path(two.a, x, sigma_x), Path(two.b, y, sigma_y), settings)
    if not single.size:
        return direct, mpi
    alone = Path(decision.amplitude, decision.phase_rad, decision.sigma_rad)
    return _merged(direct, alone, single, chosen, count), _merged(mpi, None, single, chosen, count)


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


def _direct_and_mpi(x: Path, y: Path, settings: ResolverSettings) -> tuple[Path, Path]:
    """Call one of two paths direct: the first or last that is strong enough, or the strongest.

    Phases repeat after a full turn, so a late echo of a far wall shows up ahead of it. Light that took the long way is the
    weaker: a path of less than half the other's amplitude that seems to come over half a turn before it is therefore put
    behind it, and its phase as the MPI path's goes on beyond 2π.
    """
    x_chosen: Bool
    lead = y.phase_rad - x.phase_rad
    x_wraps = (lead > 0.5 * FULL_TURN) & (x.amplitude < ECHO_RATIO * y.amplitude)
    y_wraps = (lead < -0.5 * FULL_TURN) & (y.amplitude < ECHO_RATIO * x.amplitude)
    if settings.returns == "strongest":
        x_chosen = x.amplitude >= y.amplitude
    else:
        x_before = ((lead >= 0.0) & ~x_wraps) | y_wraps
        x_wanted = x_before if settings.returns == "first" else ~x_before
        x_strong = x.amplitude >= settings.min_return_ratio * y.amplitude
        y_strong = y.amplitude >= settings.min_return_ratio * x.amplitude
        x_chosen = (x_wanted & x_strong) | ~y_strong
    direct, mpi = _where(x_chosen, x, y), _where(x_chosen, y, x)
    np.add(mpi.phase_rad, FULL_TURN, out=mpi.phase_rad, where=(x_wraps & ~x_chosen) | (y_wraps & x_chosen))
    return direct, mpi


def _where(chosen: Bool, first: Path, second: Path) -> Path:
    return Path(
        np.where(chosen, first.amplitude, second.amplitude),
        np.where(chosen, first.phase_rad, second.phase_rad),
        np.where(chosen, first.sigma_rad, second.sigma_rad),
    )
