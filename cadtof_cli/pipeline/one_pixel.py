"""One pixel of a prepared frame: its phasors with their noise, and the fits of one and of two paths."""

import math
from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.errors import SettingsError
from cadtof_cli.maps.layers import LayerSource
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold
from cadtof_cli.pipeline.stages import FramePixels, FrameStages
from cadtof_cli.resolver.diffuse.net_pixels import freed_pixels
from cadtof_cli.resolver.order import move_and_limit, with_direct_first, worth_another
from cadtof_cli.resolver.paths import Fit, Paths, ResolvedPaths
from cadtof_cli.resolver.resolve import solver_for
from cadtof_cli.resolver.response.other_pairs import widen
from cadtof_cli.resolver.status import StatusBit


@dataclass(frozen=True)
class PathNumbers:
    """A path in the units of a map: depth and its standard deviation in m, amplitude in V."""

    depth_m: float
    amplitude_v: float
    sigma_m: float


@dataclass(frozen=True)
class OrderTest:
    """The numbers of the order test, which decides whether a pixel gets one path or two.

    Attributes:
        chi_squared: χ² of the fit of one path.
        threshold: χ² that noise alone exceeds with the probability `false_alarm`; above it, a second path is considered.
        false_alarm: that probability.
        moved_m: distance by which a second path moves the direct path.
        needed_m: least such distance that is worth the larger standard deviation; NaN if a second path does not increase it.
        worth_another: whether the second path is worth it (`resolver/order.py: worth_another`).
    """

    chi_squared: float
    threshold: float
    false_alarm: float
    moved_m: float
    needed_m: float
    worth_another: bool


@dataclass(frozen=True, eq=False)
class PixelEvidence:
    """All numbers that lead to the answer of one pixel.

    Attributes:
        phasors: complex128 (H,), normalised, as they were resolved: calibrated, averaged, pooled.
        covariance: (H, 2, 2), of real and imaginary part, for the light of the resolved paths.
        noise: the noise with which the pixel was resolved.
        one: the fit of one path, and its χ²; None if there is no such fit.
        two: the fit of two paths, the direct one first; None if the harmonics cannot tell two paths.
        test: the order test; None if the settings ask for no test.
        resolved: the answer.
        of_paths: what each path of the answer adds to the phasors, complex128 (H, K); NaN for no path. With diffuse MPI, the
            second path is the tail.
        metres_per_radian: length in the map, range or planar depth, that a radian of phase at the fundamental stands for.
        in_separate_patch: whether the pixel is resolved as separate paths although the frame has a tail; None: it has
            no tail.
    """

    phasors: Complex
    covariance: Float
    noise: NoiseModel
    one: tuple[PathNumbers, float] | None
    two: tuple[PathNumbers, PathNumbers] | None
    test: OrderTest | None
    resolved: ResolvedPaths
    of_paths: Complex
    metres_per_radian: float
    in_separate_patch: bool | None


def pixel_evidence(pixels: FramePixels, index: int, stages: FrameStages, /) -> PixelEvidence:
    """Return all numbers that lead to the answer of the pixel with a flat index in a prepared frame."""
    pixel = pixels[index : index + 1]
    tail, response, phasors = pixels.tail, stages.response, stages.phasors(pixel)
    resolved = stages.resolved(pixel)
    free, nets = (phasors, None) if tail is None or response else freed_pixels(phasors, tail, first=index)
    fits = {count: _fit(free, count, pixel, stages) for count in (1, 2)}
    one, two = fits[1], fits[2]
    metres = float(np.ravel(stages.depth.metres(pixel.here))[0])
    answered_by_tail = bool(resolved.status[0] & StatusBit.DIFFUSE_MPI)
    asked = stages.plan.resolver.order == "auto" and stages.plan.resolver.max_paths > 1
    test = _order_test(one, two, stages, pixel.noise, metres) if asked and one and two else None
    if two is not None and response is not None:
        # after the test, as in the driver
        widen(two, free, noise=pixel.noise, response=response.block(pixel.here), settings=stages.plan.resolver)
    extra = tail.separate_variance if tail and not answered_by_tail else 0.0
    if nets is not None:
        extra = float(nets.variance(extra)[0])
    numbers = {
        count: [_numbers(fit, row, resolved, stages, pixel, extra) for row in range(count)]
        for count, fit in fits.items()
        if fit is not None
    }
    return PixelEvidence(
        phasors[:, 0],
        _covariance(phasors, resolved.paths, pixel.noise),
        pixel.noise,
        None if one is None else (numbers[1][0], float(one.chi_squared[0])),
        None if two is None else (numbers[2][0], numbers[2][1]),
        test,
        resolved,
        _phasors_of_paths(phasors, resolved, pixel, stages),
        metres,
        None if tail is None else bool(tail.is_separate(pixel.here)[0]) or (nets is not None and bool(nets.where[0])),
    )


def _phasors_of_paths(phasors: Complex, resolved: ResolvedPaths, pixel: FramePixels, stages: FrameStages) -> Complex:
    """Return what each path of a pixel adds to its phasors, (H, K), by the response with which they were resolved."""
    amplitude, phase_rad = resolved.paths.amplitude[:, 0], resolved.paths.phase_rad[:, 0]
    steps: Complex = amplitude * np.exp(1j * np.outer(pixel.noise.harmonics, phase_rad))
    if stages.response is not None:
        block = stages.response.block(pixel.here)
        for row, step in enumerate(steps):
            re, im = block.added_by(row, phase_rad.astype(np.float32))
            step[:] = amplitude * (re + 1j * im)
    if resolved.status[0] & StatusBit.DIFFUSE_MPI:
        steps[:, 1] = phasors[:, 0] - steps[:, 0]
    return steps


def _fit(phasors: Complex, count: int, pixel: FramePixels, stages: FrameStages) -> Fit | None:
    """Return the fit of a number of paths to one pixel, by the same solver as in the driver; None if it has no such fit."""
    settings, response = replace(stages.plan.resolver, mpi_model="discrete"), stages.response
    try:
        if count > settings.max_paths:
            settings = replace(settings, order="auto", paths=max(count, settings.paths))
        if count > settings.max_paths:
            # the solver itself finds fewer paths
            settings = replace(settings, solver="two-path")
        make_solver = solver_for(settings, pixel.noise.harmonics, sine=response is None)
    except SettingsError:
        return None
    with np.errstate(all="ignore"):
        solver = make_solver(
            phasors,
            noise=pixel.noise,
            settings=settings,
            response=response.block(pixel.here) if response else None,
            first=pixel.first,
        )
        only: Bool = np.asarray(np.isfinite(phasors).all(axis=0))
        limit = None if count >= settings.max_paths else math.inf
        chosen, fit = solver.fit(count, only, limit=limit)
        return with_direct_first(fit, settings, pixel.noise, chosen) if only.any() and fit.chi_squared.size else None


def _numbers(
    fit: Fit, row: int, resolved: ResolvedPaths, stages: FrameStages, pixel: FramePixels, extra: float
) -> PathNumbers:
    """Return the path in a row of a fit, in the units of a map; `extra` is the variance that a frame's tail adds to its
    phase."""
    with np.errstate(all="ignore"):
        sigma = np.sqrt(np.square(fit.paths.sigma_rad) + extra)
        paths = Paths(fit.paths.amplitude, fit.paths.phase_rad, sigma)
        source: LayerSource = stages.depth.source(
            replace(resolved, paths=paths), pixel.here, samples=pixel.noise.samples
        )
        depth, amplitude, sigma_m = (
            np.asarray(np.multiply(*factors))
            for factors in (source.depth(row), source.amplitude(row), source.sigma(row))
        )
        if row == 0:
            sigma_m = stages.depth.sigma_from_camera(sigma_m, depth, pixel.here)
            depth = stages.depth.from_camera(depth, pixel.here)
    return PathNumbers(float(depth[0]), float(amplitude[0]), float(sigma_m[0]))


def _order_test(one: Fit, two: Fit, stages: FrameStages, noise: NoiseModel, metres: float) -> OrderTest:
    with np.errstate(invalid="ignore"):
        # without any light both standard deviations are infinite, and their difference is NaN
        moved, limit = move_and_limit(two.paths[0], one.paths[0])
        worth = bool(worth_another(two.paths[0], one.paths[0])[0])
        moved_m, needed_m = moved * metres, np.sqrt(limit) * metres
    threshold = chi_squared_threshold(stages.plan.resolver.false_alarm, pairs=len(noise.harmonics) - 1)
    chi_squared = float(one.chi_squared[0])
    return OrderTest(
        chi_squared, threshold, stages.plan.resolver.false_alarm, float(moved_m[0]), float(needed_m[0]), worth
    )


def _covariance(phasors: Complex, paths: Paths, noise: NoiseModel) -> Float:
    """Return the covariance of each harmonic's phasor, (H, 2, 2), for the light of the resolved paths.

    NaN if no light gives such a phasor, as in a saturated pixel.
    """
    samples = 1.0 if noise.samples is None else float(noise.samples[0])
    amplitude, phase = np.nan_to_num(paths.amplitude), np.nan_to_num(paths.phase_rad)
    found = np.empty((len(noise.each), 2, 2))
    for row, (harmonic, phasor) in enumerate(zip(noise.each, phasors, strict=True)):
        turn = 2 * harmonic.harmonic * phase
        doubled = (amplitude * np.cos(turn)).sum(axis=0), (amplitude * np.sin(turn)).sum(axis=0)
        with np.errstate(all="ignore"):
            along, between, across = harmonic.covariance((phasor.real, phasor.imag), doubled)
        found[row] = [[along[0], between[0]], [between[0], across[0]]] if min(along[0], across[0]) > 0.0 else np.nan
    return found / samples
