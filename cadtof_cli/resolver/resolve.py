"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Status
from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.closed_form import FundamentalFrame, TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath, one_path
from cadtof_cli.resolver.order import second_path_threshold, signal_threshold
from cadtof_cli.resolver.refine import RefinedPaths, refined_one_path, refined_two_paths
from cadtof_cli.resolver.response_table import ResponseBlock
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 1
"""Newton steps of the one-path fit where the order test follows: what it accepts lies within first order of its start."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""

FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Path:
    """One path of n pixels: amplitude in units of the phasors, phase in rad, its standard deviation in rad.

    Phases lie in [0, 2π), but that of an MPI path that is known to lie behind the direct one may go on to 4π.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float


@dataclass(frozen=True)
class ResolvedPaths:
    """The answer for n pixels: the direct and the MPI path, float64 (n,) each, NaN where there is none.

    `confidence` is the magnitude of the first phasor; `status` holds bits of `StatusBit`.
    """

    direct: Path
    mpi: Path
    confidence: Float
    status: Status


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
    by the same operations wherever it stands, so that blocks of any size give the same bits. Where the channel pairs answer with
    more than a sine, `response` says how, and the sine's answer is refined.

    Raises:
        SettingsError: the harmonics are not the fundamental and its double.
    """
    if phasors.shape[0] != 2:
        raise SettingsError(f"two-path resolving: found {phasors.shape[0]} harmonics, expected 2 (T1 and T1/2)")
    with np.errstate(all="ignore"):
        frame = fundamental_frame(phasors[0], phasors[1])
        status = np.where(saturated, np.uint32(StatusBit.SATURATED), np.uint32(0))
        if hot is not None:
            status |= np.where(hot, np.uint32(StatusBit.HOT_PIXEL), np.uint32(0))
        confidence = np.where(status != 0, np.nan, frame.u)
        status |= np.where(np.isfinite(phasors).all(axis=0), np.uint32(0), np.uint32(StatusBit.NOT_FINITE))
        low = _without_signal(frame, settings, noise, amplitude_v)
        status |= np.where(low & (status == 0), np.uint32(StatusBit.LOW_CONFIDENCE), np.uint32(0))
        answered = status == 0
        direct, mpi = _paths(_Task(phasors, frame, settings, noise, response), status, answered)
        blank = ~answered
        if blank.any():
            for values in (direct.amplitude, direct.phase_rad, direct.sigma_rad):
                values[blank] = np.nan
            for values in (mpi.amplitude, mpi.phase_rad, mpi.sigma_rad):
                values[blank] = np.nan
            confidence[~np.isfinite(confidence)] = np.nan
    return ResolvedPaths(direct, mpi, confidence, status)


def _without_signal(frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel, amplitude_v: float) -> Bool:
    second2 = frame.pr * frame.pr + frame.pi * frame.pi
    if settings.min_confidence_v is not None:
        least = settings.min_confidence_v / amplitude_v
        low: Bool = (frame.u < least) | ((frame.u == 0.0) & (second2 == 0.0))
        return low
    first, second = noise.harmonics
    power = frame.u * frame.u / first.dark_variance + second2 / second.dark_variance
    weak: Bool = power <= signal_threshold(settings.false_alarm, harmonics=2)
    return weak


@dataclass(frozen=True)
class _Task:
    """What the paths of a block follow from."""

    phasors: Complex
    frame: FundamentalFrame
    settings: ResolverSettings
    noise: NoiseModel
    response: ResponseBlock | None

    def one(self, steps: int) -> OnePath:
        """Return the best single path; from the sine's, a full response needs one step more."""
        fit = one_path(self.frame, noise=self.noise, steps=steps)
        if self.response is None:
            return fit
        return refined_one_path(fit, self.phasors, response=self.response, noise=self.noise, steps=steps + 1)

    def two(self, wanted: Bool, alone: OnePath | None) -> RefinedPaths:
        """Return two paths, exact in the wanted pixels; `alone` is the best single path, where it is known already."""
        if self.response is None:
            return RefinedPaths(two_paths(self.frame), np.zeros(wanted.shape, np.bool_))
        alone = alone or self.one(ORDER_TEST_STEPS)
        return refined_two_paths(alone, self.phasors, wanted, response=self.response, noise=self.noise)


def _paths(task: _Task, status: Status, answered: Bool) -> tuple[Path, Path]:
    """Return the direct and the MPI path, and mark in `status` how many there are."""
    settings, noise = task.settings, task.noise
    if settings.max_paths == 1:
        status |= np.where(answered, np.uint32(StatusBit.ONE_PATH), np.uint32(0))
        single = _only_path(task.one(ONE_PATH_STEPS))
        nothing = np.full_like(task.frame.u, np.nan)
        return single, Path(nothing, nothing.copy(), nothing.copy())
    has_two, alone = answered.copy(), None
    if settings.order == "auto":
        alone = task.one(ORDER_TEST_STEPS)
        has_two &= alone.chi_squared > second_path_threshold(settings.false_alarm)
    refined = task.two(has_two, alone)
    two = refined.paths
    has_two &= ~two.single
    x, y = _both_paths(two, noise)
    direct, mpi = _direct_and_mpi(x, y, settings)
    if alone is not None:
        direct = _where(has_two, direct, _only_path(alone))
    mpi = _where(has_two, mpi, Path(*(np.float64(np.nan),) * 3))
    doubtful = has_two & (np.maximum(x.sigma_rad, y.sigma_rad) > np.abs(two.sin_half))
    bits = np.where(has_two, np.uint32(StatusBit.TWO_PATHS), np.uint32(StatusBit.ONE_PATH))
    for marked, bit in ((doubtful, StatusBit.ILL_CONDITIONED), (refined.failed, StatusBit.NOT_CONVERGED)):
        bits |= np.where(marked, np.uint32(bit), np.uint32(0))
    status |= np.where(answered, bits, np.uint32(0))
    return direct, mpi


def _only_path(fit: OnePath) -> Path:
    return Path(fit.amplitude, _phase(fit.cos, fit.sin), fit.sigma_rad)


def _both_paths(two: TwoPaths, noise: NoiseModel) -> tuple[Path, Path]:
    sigma_x, sigma_y = two_path_sigmas(two, noise=noise)
    return Path(two.a, _phase(two.cos_x, two.sin_x), sigma_x), Path(two.b, _phase(two.cos_y, two.sin_y), sigma_y)


def _direct_and_mpi(x: Path, y: Path, settings: ResolverSettings) -> tuple[Path, Path]:
    """Call one of two paths direct: the first or last that is strong enough, or the strongest.

    Phases repeat after a full turn, so a late echo of a far wall shows up ahead of it. Light that took the long way is the
    weaker: a weaker path that seems to come over half a turn before the stronger one is therefore put behind it, and its
    phase as the MPI path's goes on beyond 2π.
    """
    x_chosen: Bool
    x_stronger = x.amplitude >= y.amplitude
    lead = y.phase_rad - x.phase_rad
    wrapped = (np.abs(lead) > 0.5 * FULL_TURN) & (x_stronger == (lead < 0.0))
    if settings.returns == "strongest":
        x_chosen = x_stronger
    else:
        x_before = (lead >= 0.0) ^ wrapped
        x_wanted = x_before if settings.returns == "first" else ~x_before
        x_strong = (x.amplitude >= settings.min_return_ratio * y.amplitude) & (x.amplitude > 0.0)
        y_strong = (y.amplitude >= settings.min_return_ratio * x.amplitude) & (y.amplitude > 0.0)
        x_chosen = (x_wanted & x_strong) | ~y_strong
    direct, mpi = _where(x_chosen, x, y), _where(x_chosen, y, x)
    np.add(mpi.phase_rad, FULL_TURN, out=mpi.phase_rad, where=wrapped & (x_chosen == x_stronger))
    return direct, mpi


def _where(chosen: Bool, first: Path, second: Path) -> Path:
    return Path(
        np.where(chosen, first.amplitude, second.amplitude),
        np.where(chosen, first.phase_rad, second.phase_rad),
        np.where(chosen, first.sigma_rad, second.sigma_rad),
    )


def _phase(cos: Float, sin: Float) -> Float:
    """Return the phase of a unit rotor in [0, 2π): arctan2 by the half angle, in half its time and to the last digit."""
    left = cos < 0.0
    phase = 2.0 * np.arctan(np.where(left, 1.0 - cos, sin) / np.where(left, sin, 1.0 + cos))
    phase += np.where(phase < 0.0, FULL_TURN, 0.0)
    phase[phase >= FULL_TURN] = 0.0
    return phase
