"""Phasors of a block of pixels → the paths of every pixel: the driver of the stage between `phasors/` and `maps/`."""

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Status
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.resolver.order import LEAST_PATHS, Solver, fewest_paths, with_direct_first
from cadtof_cli.resolver.paths import Fit, ResolvedPaths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit

if TYPE_CHECKING:
    from cadtof_cli.resolver.diffuse.net_pixels import NetPixels
    from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels
    from cadtof_cli.resolver.response.table import ResponseBlock


def resolve_paths(
    phasors: Complex,
    /,
    *,
    status: Status,
    settings: ResolverSettings,
    noise: NoiseModel,
    response: "ResponseBlock | None" = None,
    tail: "DiffuseModel | None" = None,
    first: int = 0,
) -> ResolvedPaths:
    """Resolve every pixel of phasors (H, n) into paths; inputs are not changed.

    A pixel that is not finite or has no signal gets NaN and a status bit. A pixel that already has a bit in `status`,
    (n,), because it is saturated or hot, gets NaN. Every pixel is computed alone, by the same operations at any
    position in the block, so that blocks of any size give the same bits.

    `response` is the response of the channel pairs if it is no pure sine. `tail` is the model of the frame's diffuse
    MPI: it answers all pixels except those of patches with separate paths. `first` is the flat index in the frame of
    the first of the n pixels; the tail, and with the seed the starts of a random search, depend on it.

    Raises:
        SettingsError: the harmonics cannot tell as many paths apart as the settings ask for.
    """
    make_solver = solver_for(settings, noise.harmonics, sine=response is None)
    # The tail answers first, because it leaves only few pixels to the solver. But a net is found in phasors of a pure
    # sine: with a response, these follow from the solver's paths, so there the solver runs first.
    tail_first = tail is None or response is None or tail.nets is None
    before, after = (tail, None) if tail_first else (None, tail)
    if tail is not None:
        from cadtof_cli.resolver.diffuse.net_pixels import freed_pixels
    with np.errstate(all="ignore"):
        free, nets = (phasors, None) if before is None else freed_pixels(phasors, before, first=first)
        start = partial(make_solver, free, noise=noise, settings=settings, response=response, first=first)
        solver: Solver | None = start() if before is None else None
        powers = list(free.real**2 + free.imag**2) if solver is None else solver.powers
        modulus = np.sqrt(powers[0]) if solver is None else solver.modulus
        status, confidence = screened(modulus, powers, status, settings=settings, noise=noise)
        if nets is not None:
            confidence = np.where(nets.where, confidence * nets.size, confidence)
        answered = status == 0
        predicted = None
        if before is not None:
            usable = answered if nets is None else answered & ~nets.where
            predicted = _predicted(phasors, before, first, usable, noise, response)
            answered &= ~predicted.answered
        if answered.any():
            fit = _separate_paths(solver or start(), free, answered, settings, noise, response)
        else:
            fit = Fit.none(max(settings.paths, LEAST_PATHS), answered.size)
        if after is not None and response is not None:
            from cadtof_cli.resolver.response.as_sine import phasors_of_sine

            sine = phasors_of_sine(phasors, fit.paths, response=response)
            free, nets = freed_pixels(sine, after, first=first)
            usable = answered if nets is None else answered & ~nets.where
            _put_freed(fit, free, answered & ~usable, settings, noise)
            predicted = _predicted(phasors, after, first, usable, noise, response)
        bits = _bits(fit)
        if not answered.all():
            bits = np.where(answered, bits, status)
            for values in (fit.paths.amplitude, fit.paths.phase_rad, fit.paths.sigma_rad, fit.chi_squared):
                np.copyto(values, np.nan, where=~answered)
        if tail is not None and predicted is not None:
            _put_tail(fit, predicted, nets, tail.separate_variance)
            bits = np.where(predicted.answered, np.uint32(StatusBit.DIFFUSE_MPI), bits)
    if noise.samples is not None:
        np.bitwise_or(bits, np.uint32(StatusBit.POOLED), out=bits, where=noise.samples > 1.0)
    return ResolvedPaths(fit.paths, confidence, bits, fit.chi_squared)


def _separate_paths(
    solver: Solver,
    phasors: Complex,
    answered: Bool,
    settings: ResolverSettings,
    noise: NoiseModel,
    response: "ResponseBlock | None",
) -> Fit:
    """Return the paths that the solver and the order test give, with standard deviations that hold other pairs of paths."""
    fit = fewest_paths(solver, answered, settings=settings, noise=noise)
    if response is not None:
        from cadtof_cli.resolver.response.other_pairs import widen

        widen(fit, phasors, noise=noise, response=response, settings=settings)
    return fit


def _predicted(
    phasors: Complex,
    tail: "DiffuseModel",
    first: int,
    usable: Bool,
    noise: NoiseModel,
    response: "ResponseBlock | None",
) -> "DiffusePixels":
    """Return the answers that the tail's model gives for the usable pixels."""
    from cadtof_cli.resolver.diffuse.pixels import diffuse_pixels, pixels_of_sine

    samples = noise.samples
    if response is not None:
        phasors, samples = pixels_of_sine(phasors, model=tail, first=first, response=response, samples=samples)
    return diffuse_pixels(phasors, model=tail, first=first, usable=usable, samples=samples)


def solver_for(settings: ResolverSettings, harmonics: tuple[int, ...], /, *, sine: bool) -> Callable[..., Solver]:
    """Return the class of the solver, from the module that the settings choose.

    Raises:
        SettingsError: see `ResolverSettings.solver_module`.
    """
    name = settings.solver_module(harmonics, sine=sine)
    made: Callable[..., Solver] = import_module(f"cadtof_cli.resolver.{name}").solver
    return made


def screened(
    modulus: Float, powers: Sequence[Float], status: Status, /, *, settings: ResolverSettings, noise: NoiseModel
) -> tuple[Status, Float]:
    """Return the status, 0 for pixels that get an answer, and the confidence of all pixels, (n,) each."""
    power = powers[0] * (1.0 / noise.each[0].dark_variance)
    for square, harmonic in zip(powers[1:], noise.each[1:], strict=True):
        power += square * (1.0 / harmonic.dark_variance)
    if noise.samples is not None:
        power *= noise.samples
    if settings.min_confidence is None:
        low = power <= chi_squared_threshold(settings.false_alarm, pairs=len(powers))
    else:
        low = (modulus < settings.min_confidence) | (power == 0.0)
    found: Status = low * np.uint32(StatusBit.LOW_CONFIDENCE)
    sound = (status == 0) & np.isfinite(power)
    if sound.all():
        return found, modulus
    unsound = status | ~np.isfinite(power) * np.uint32(StatusBit.NOT_FINITE)
    return np.where(sound, found, unsound), np.where(sound, modulus, np.nan)


def _put_freed(fit: Fit, free: Complex, where: Bool, settings: ResolverSettings, noise: NoiseModel) -> None:
    """Overwrite the fit in the pixels `where` by two paths, from phasors `free` of a pure sine without tails."""
    chosen = np.flatnonzero(where)
    if chosen.size:
        make_solver = solver_for(settings, noise.harmonics, sine=True)
        of_sine = make_solver(free[:, chosen], noise=noise[chosen], settings=settings)
        _, two = of_sine.fit(2, np.ones(chosen.size, np.bool_), limit=None)
        fit[chosen] = with_direct_first(two, settings, noise[chosen], slice(None))


def _put_tail(fit: Fit, predicted: "DiffusePixels", nets: "NetPixels | None", left: float) -> None:
    """Write the direct light and the MPI light into `fit` as two paths, in pixels with a predicted tail.

    The other pixels get the variance that the tail still adds to the phases of their separate paths: `left`, rad², by
    the room's tail, or what is left of it in pixels that look through a net.
    """
    where, paths = predicted.answered, fit.paths
    paths.sigma_rad[:] = np.sqrt(np.square(paths.sigma_rad) + (left if nets is None else nets.variance(left)))
    for row, (amplitude, phase, sigma) in enumerate((predicted.direct, predicted.mpi)):
        np.copyto(paths.amplitude[row], amplitude, where=where)
        np.copyto(paths.phase_rad[row], phase, where=where)
        np.copyto(paths.sigma_rad[row], sigma, where=where, casting="same_kind")
    np.copyto(fit.chi_squared, predicted.chi_squared, where=where)


def _bits(fit: Fit) -> Status:
    """Return the bits of each pixel: the number of paths, whether they are in doubt, whether the search converged."""
    one, two, *more = np.isfinite(fit.paths.amplitude)
    bits: Status = np.where(two, np.uint32(StatusBit.TWO_PATHS), one * np.uint32(StatusBit.ONE_PATH))
    for another in more:
        bits[another] = StatusBit.MORE_PATHS
    bits |= ((fit.doubt > 1.0) & one) * np.uint32(StatusBit.ILL_CONDITIONED)
    if not fit.converged.all():
        bits |= ~fit.converged * np.uint32(StatusBit.NOT_CONVERGED)
    return bits
