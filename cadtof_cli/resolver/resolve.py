"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Status
from cadtof_cli.errors import SettingsError
from cadtof_cli.resolver.closed_form import FundamentalFrame, TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath, one_path
from cadtof_cli.resolver.order import chi_squared_threshold
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
    """One path of n pixels: amplitude in units of the phasors, phase in [0, 2π) rad, its standard deviation in rad."""

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
    phasors: Complex, /, *, saturated: Bool, settings: ResolverSettings, noise: NoiseModel, amplitude_v: float
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) into one or two paths; inputs are not changed.

    A pixel that is saturated, not finite or without a signal gets NaN and a status bit. Every pixel is computed alone, by the
    same operations wherever it stands, so that blocks of any size give the same bits.

    Raises:
        SettingsError: the harmonics are not the fundamental and its double.
    """
    if phasors.shape[0] != 2:
        raise SettingsError(f"two-path resolving: found {phasors.shape[0]} harmonics, expected 2 (T1 and T1/2)")
    with np.errstate(all="ignore"):
        frame = fundamental_frame(phasors[0], phasors[1])
        status = np.where(saturated, np.uint32(StatusBit.SATURATED), np.uint32(0))
        confidence = np.where(saturated, np.nan, frame.u)
        status |= np.where(np.isfinite(phasors).all(axis=0), np.uint32(0), np.uint32(StatusBit.NOT_FINITE))
        low = _without_signal(frame, settings, noise, amplitude_v)
        status |= np.where(low & (status == 0), np.uint32(StatusBit.LOW_CONFIDENCE), np.uint32(0))
        answered = status == 0
        direct, mpi = _paths(frame, settings, noise, status, answered)
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
    weak: Bool = power <= chi_squared_threshold(settings.false_alarm, pairs=2)
    return weak


def _paths(
    frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel, status: Status, answered: Bool
) -> tuple[Path, Path]:
    """Return the direct and the MPI path, and mark in `status` how many there are."""
    if settings.max_paths == 1:
        status |= np.where(answered, np.uint32(StatusBit.ONE_PATH), np.uint32(0))
        single = _only_path(one_path(frame, noise=noise, steps=ONE_PATH_STEPS))
        nothing = np.full_like(frame.u, np.nan)
        return single, Path(nothing, nothing.copy(), nothing.copy())
    two = two_paths(frame)
    x, y = _both_paths(two, noise)
    direct, mpi = _direct_and_mpi(x, y, settings)
    has_two = ~two.single
    if settings.order == "auto":
        alone = one_path(frame, noise=noise, steps=ORDER_TEST_STEPS)
        has_two &= alone.chi_squared > chi_squared_threshold(settings.false_alarm, pairs=1)
        direct = _where(has_two, direct, _only_path(alone))
    mpi = _where(has_two, mpi, Path(*(np.float64(np.nan),) * 3))
    doubtful = has_two & (np.maximum(x.sigma_rad, y.sigma_rad) > np.abs(two.sin_half))
    bits = np.where(has_two, np.uint32(StatusBit.TWO_PATHS), np.uint32(StatusBit.ONE_PATH))
    bits |= np.where(doubtful, np.uint32(StatusBit.ILL_CONDITIONED), np.uint32(0))
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
    weaker: a weaker path that seems to come over half a turn before the stronger one is therefore put behind it.
    """
    x_chosen: Bool
    x_stronger = x.amplitude >= y.amplitude
    if settings.returns == "strongest":
        x_chosen = x_stronger
    else:
        lead = y.phase_rad - x.phase_rad
        x_before = (lead >= 0.0) ^ ((np.abs(lead) > 0.5 * FULL_TURN) & (x_stronger == (lead < 0.0)))
        x_wanted = x_before if settings.returns == "first" else ~x_before
        x_strong = (x.amplitude >= settings.min_return_ratio * y.amplitude) & (x.amplitude > 0.0)
        y_strong = (y.amplitude >= settings.min_return_ratio * x.amplitude) & (y.amplitude > 0.0)
        x_chosen = (x_wanted & x_strong) | ~y_strong
    return _where(x_chosen, x, y), _where(x_chosen, y, x)


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
