"""Phasors of a block of pixels → the paths of every pixel: the stage between `phasors/` and `maps/`."""

from collections.abc import Sequence

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index, Status
from cadtof_cli.resolver.closed_form import FundamentalFrame, TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.many_paths import resolve_many
from cadtof_cli.resolver.mixture import Measured
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath, one_path
from cadtof_cli.resolver.order import chi_squared_threshold
from cadtof_cli.resolver.paths import Path, ResolvedPaths
from cadtof_cli.resolver.returns import arranged, choose, direct_and_mpi
from cadtof_cli.resolver.rotors import phase_of
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.uncertainty import two_path_sigmas

ORDER_TEST_STEPS = 1
"""Newton steps of the one-path fit where the order test follows: what it accepts lies within first order of its start."""

ONE_PATH_STEPS = 6
"""Newton steps where one path is all that is asked for, however badly it fits."""


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
    harmonics = tuple(harmonic.harmonic for harmonic in noise.harmonics)
    settings.check_harmonics(harmonics)
    averaged = noise if samples is None else noise.averaged_over(samples)
    with np.errstate(all="ignore"):
        if settings.in_closed_form(harmonics):
            frame = fundamental_frame(phasors[0], phasors[1])
            modulus, powers = frame.u, (frame.u * frame.u, frame.pr * frame.pr + frame.pi * frame.pi)
        else:
            powers = tuple(phasor.real * phasor.real + phasor.imag * phasor.imag for phasor in phasors)
            modulus = np.sqrt(powers[0])
        status = np.where(saturated, np.uint32(StatusBit.SATURATED), np.uint32(0))
        confidence = np.where(saturated, np.nan, modulus)
        status |= np.where(np.isfinite(phasors).all(axis=0), np.uint32(0), np.uint32(StatusBit.NOT_FINITE))
        low = _without_signal(modulus, powers, settings, averaged, amplitude_v)
        status |= np.where(low & (status == 0), np.uint32(StatusBit.LOW_CONFIDENCE), np.uint32(0))
        answered = status == 0
        if samples is not None:
            status |= np.where(answered & (samples > 1.0), np.uint32(StatusBit.POOLED), np.uint32(0))
        if not settings.in_closed_form(harmonics):
            measured = Measured.of_phasors(phasors, harmonics=harmonics)
            paths, chi_squared = _iterated(measured, settings, noise, samples, status, answered)
        else:
            paths, chi_squared = _paths(frame, settings, averaged, status, answered), None
        blank = ~answered
        if blank.any():
            for path in paths:
                for values in (path.amplitude, path.phase_rad, path.sigma_rad):
                    values[blank] = np.nan
            confidence[~np.isfinite(confidence)] = np.nan
    direct, mpi, *others = paths
    return ResolvedPaths(direct, mpi, confidence, status, tuple(others), chi_squared)


def _without_signal(
    modulus: Float, powers: Sequence[Float], settings: ResolverSettings, noise: NoiseModel, amplitude_v: float
) -> Bool:
    """Return where the first phasor, `modulus`, is below the least confidence, or all of them are no more than noise."""
    if settings.min_confidence_v is not None:
        dark: Bool = np.logical_and.reduce([power == 0.0 for power in powers])
        return dark | (modulus < settings.min_confidence_v / amplitude_v)
    total = powers[0] / noise.harmonics[0].dark_variance
    for power, harmonic in zip(powers[1:], noise.harmonics[1:], strict=True):
        total = total + power / harmonic.dark_variance
    weak: Bool = total <= chi_squared_threshold(settings.false_alarm, pairs=len(powers))
    return weak


def _iterated(
    measured: Measured,
    settings: ResolverSettings,
    noise: NoiseModel,
    samples: Float | None,
    status: Status,
    answered: Bool,
) -> tuple[tuple[Path, ...], Float]:
    """Return the paths, two at least, and what they leave over the noise, of pixels that need a search."""
    at: Index = np.flatnonzero(answered)
    many = np.ones(at.size) if samples is None else samples[at]
    found = resolve_many(measured.taken(at), settings=settings, noise=noise, samples=many)
    count = np.isfinite(found.amplitude).sum(axis=0)
    for marked, bit in (
        (count == 1, StatusBit.ONE_PATH),
        (count == 2, StatusBit.TWO_PATHS),
        (count > 2, StatusBit.MORE_PATHS),
        (found.doubtful, StatusBit.ILL_CONDITIONED),
        (~found.converged, StatusBit.NOT_CONVERGED),
    ):
        status[at[marked]] |= np.uint32(bit)

    def spread(values: Float) -> Float:
        everywhere = np.full(answered.size, np.nan)
        everywhere[at] = values
        return everywhere

    paths = [
        Path(spread(path.amplitude), spread(path.phase_rad), spread(path.sigma_rad))
        for path in arranged(found, settings)
    ]
    while len(paths) < max(settings.paths, 2):
        paths.append(Path(*(np.full(answered.size, np.nan) for _ in range(3))))
    return tuple(paths), spread(found.chi_squared)


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
    direct, mpi = direct_and_mpi(x, y, settings)
    has_two = ~two.single
    if settings.order == "auto":
        alone = one_path(frame, noise=noise, steps=ORDER_TEST_STEPS)
        has_two &= alone.chi_squared > chi_squared_threshold(settings.false_alarm, pairs=1)
        direct = choose(has_two, direct, _only_path(alone))
    mpi = choose(has_two, mpi, Path(*(np.float64(np.nan),) * 3))
    doubtful = has_two & (np.maximum(x.sigma_rad, y.sigma_rad) > np.abs(two.sin_half))
    bits = np.where(has_two, np.uint32(StatusBit.TWO_PATHS), np.uint32(StatusBit.ONE_PATH))
    bits |= np.where(doubtful, np.uint32(StatusBit.ILL_CONDITIONED), np.uint32(0))
    status |= np.where(answered, bits, np.uint32(0))
    return direct, mpi


def _only_path(fit: OnePath) -> Path:
    return Path(fit.amplitude, phase_of((fit.cos, fit.sin)), fit.sigma_rad)


def _both_paths(two: TwoPaths, noise: NoiseModel) -> tuple[Path, Path]:
    sigma_x, sigma_y = two_path_sigmas(two, noise=noise)
    return Path(two.a, phase_of((two.cos_x, two.sin_x)), sigma_x), Path(two.b, phase_of((two.cos_y, two.sin_y)), sigma_y)
