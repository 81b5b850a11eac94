"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from dataclasses import dataclass, replace

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
from cadtof_cli.resolver.one_path import one_path
from cadtof_cli.resolver.order import second_path_threshold, signal_threshold
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 0
"""Newton steps of the one-path fit where the order test follows. What the test accepts deviates from one path by no more than
noise, and to first order in the noise the fit's start is its end: a step would change the scatter by less than 0.1 %."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""

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

    def at(self, pixels: Index | Bool, /) -> "Path":
        """Return the path of some of the pixels."""
        return Path(self.amplitude[pixels], self.phase_rad[pixels], self.sigma_rad[pixels])

    def put(self, pixels: Index, other: "Path", /) -> None:
        """Overwrite the path of some of the pixels."""
        self.amplitude[pixels] = other.amplitude
        self.phase_rad[pixels] = other.phase_rad
        self.sigma_rad[pixels] = other.sigma_rad

    def spread(self, pixels: Index, count: int, /) -> "Path":
        """Return a path of `count` pixels that holds this one's at these indices, and anything elsewhere."""
        whole = Path(np.empty(count), np.empty(count), np.empty(count, self.sigma_rad.dtype))
        whole.put(pixels, self)
        return whole


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
class _Alone:
    """Pixels that may have one path only, their indices, its fit, and whether its misfit is more than noise; (m,) each."""

    pixels: Index
    path: Path
    misfit: Bool


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
        status, confidence = _screened(frame, saturated, settings, noise, amplitude_v)
        answered = status == 0
        if not answered.all():
            # NaN in the phasor is NaN in all that follows from it.
            frame = replace(frame, u=np.where(answered, frame.u, np.nan))
        alone = _fitted_alone(frame, settings, noise)
        status |= answered * np.uint32(StatusBit.TWO_PATHS)
        direct, mpi = _paths(frame, alone, settings, noise, status)
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


def _fitted_alone(frame: FundamentalFrame, settings: ResolverSettings, noise: NoiseModel) -> _Alone:
    """Fit one path wherever there may be no more."""
    threshold, steps = np.inf, ORDER_TEST_STEPS
    if settings.max_paths == 1:
        pixels, steps = np.arange(frame.u.size), ONE_PATH_STEPS
    elif settings.order == "2":
        pixels = np.flatnonzero(is_single(frame))
    else:
        threshold = second_path_threshold(settings.false_alarm)
        pixels = np.flatnonzero(_may_be_one_path(frame, threshold, noise))
    fit = one_path(frame.at(pixels), noise=noise, steps=steps)
    return _Alone(pixels, Path(fit.amplitude, phase_of(fit.cos, fit.sin), fit.sigma_rad), fit.chi_squared > threshold)


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
    frame: FundamentalFrame, alone: _Alone, settings: ResolverSettings, noise: NoiseModel, status: Status
) -> tuple[Path, Path]:
    """Return the direct and the MPI path; mark in `status` which pixels have one path, and which two cannot be told apart."""
    count = frame.u.size
    # Where most pixels need two paths, the few others are computed along and written over: that is faster than to gather.
    everywhere = 2 * np.count_nonzero(~alone.misfit) <= count
    chosen = np.empty(0, np.intp) if everywhere else np.delete(np.arange(count), alone.pixels[~alone.misfit])
    two = two_paths(frame if everywhere else frame.at(chosen))
    sigma_x, sigma_y = two_path_sigmas(two, noise=noise)
    doubtful = (np.maximum(sigma_x, sigma_y) > two.sin_half) * np.uint32(StatusBit.ILL_CONDITIONED)
    x, y = two.phases()
    direct, mpi = _direct_and_mpi(Path(two.a, x, sigma_x), Path(two.b, y, sigma_y), settings)
    if everywhere:
        status |= doubtful
    else:
        status[chosen] |= doubtful
        direct, mpi = direct.spread(chosen, count), mpi.spread(chosen, count)
    kept = ~alone.misfit
    kept[alone.misfit] = ~_worth_two(direct.at(alone.pixels[alone.misfit]), alone.path.at(alone.misfit))
    single = alone.pixels[kept]
    direct.put(single, alone.path.at(kept))
    mpi.put(single, Path(*(np.full(single.size, np.nan),) * 3))
    status[single] = np.where(status[single] & StatusBit.TWO_PATHS, StatusBit.ONE_PATH, status[single])
    return direct, mpi


def _worth_two(direct: Path, alone: Path) -> Bool:
    """Return where a second path moves the direct one by more than the scatter that it costs.

    One path is biased by δ, two scatter more: E(difference²) = δ² + σ2² − σ1², so the mean squared error of the direct phase is
    the smaller with two where difference² > 2(σ2² − σ1²): the focused information criterion (Claeskens and Hjort 2003,
    doi:10.1198/016214503000000819) for that phase. It stops splits of one path into two all but coinciding ones, a hundredth of
    all pixels by the misfit alone, from doubling the error of all.
    """
    difference = np.abs(direct.phase_rad - alone.phase_rad)
    difference = np.minimum(difference, FULL_TURN - difference)
    cost = np.square(direct.sigma_rad, dtype=np.float64) - np.square(alone.sigma_rad)
    worth: Bool = difference * difference > 2.0 * cost
    return worth


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
