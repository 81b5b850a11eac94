"""The diffuse MPI of a frame: whether a tail fits, and the coarse model from which the pixels are answered."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.quantiles import median, quantiles
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.beyond import surfaces_beyond, surfaces_guessed
from cadtof_cli.resolver.diffuse.bias import Bias, missed_share, remaining_sigma_rad, view_numbers
from cadtof_cli.resolver.diffuse.choice import (
    LEAST_PATCHES,
    DiffuseChoice,
    PatchKinds,
    Reason,
    RoomNumbers,
    tail_fits,
)
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes, LagParts, coarse_planes, patch_posterior
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.light import PatchLight, PatchMeans, patch_means, patch_phasors
from cadtof_cli.resolver.diffuse.model_error import model_error, mpi_share
from cadtof_cli.resolver.diffuse.nets import find_nets, typical_tail
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit, fitted_patches
from cadtof_cli.resolver.diffuse.planes import PatchPlanes, Surfaces, patch_planes
from cadtof_cli.resolver.diffuse.prior import pattern
from cadtof_cli.resolver.diffuse.radiosity import interreflections, light_of
from cadtof_cli.resolver.diffuse.records import DiffuseModel, Nets, Tails, TermTails
from cadtof_cli.resolver.diffuse.second_paths import PatchData, SecondPaths, further_chi_squared, two_path_lag
from cadtof_cli.resolver.diffuse.settings import NEAREST_M, DiffuseSettings, range_from_phase
from cadtof_cli.resolver.diffuse.tail import TailModel
from cadtof_cli.resolver.diffuse.upsampling import upsampler
from cadtof_cli.resolver.diffuse.variation import varies_like_the_tail
from cadtof_cli.resolver.kernels import NUMPY

LEAST_RATIO = 0.05
"""Floor for |q_h| in the noise of a patch's data: the noise of ln|q_h| grows without limit as |q_h| goes to 0."""

GUESSED_POWER = 4
"""Power of the unknown share of what a patch faces, with which the light of guessed walls counts. A view that shows
walls at right angles holds most of the early light. A view of a single wall holds none of it."""

TERM_ERROR = 0.5
"""Standard deviation of the tail at a multiple that only other terms of a response see, as a share of it. Early light
hardly changes the ratios of the fitted harmonics, but at those multiples it is all that is left of a tail."""

NO_RATIO = 1e-9
"""Floor for |q_h| in the data: its logarithm must be finite, and below this it is of no interest."""

COVERED_ERROR = 1e6
"""Factor on the error of patches with two surfaces, so that they say nothing of the room."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """What is known of a frame besides its light.

    Attributes:
        grid: its patches.
        settings: what is asked for.
        variances: noise variance of a channel of each harmonic, (H,), of a pixel as it is resolved.
        offset_m: what is added to the ranges of the sampled pixels.
        shared: how many pixels share their noise.
        kernel: of `available_kernels`.
    """

    grid: PatchGrid
    settings: DiffuseSettings
    variances: Float
    offset_m: Float32 | float
    shared: float
    kernel: str


def diffuse_model(
    light: PatchLight,
    means: PatchMeans,
    kinds: PatchKinds,
    /,
    *,
    grid: PatchGrid,
    variances: tuple[float, ...],
    settings: DiffuseSettings,
    samples: float = 1.0,
    shared: float = 1.0,
    range_offset_m: Float | None = None,
    kernel: str = NUMPY,
) -> DiffuseModel | Reason:
    """Return the model of a frame, or why it is left to separate paths after all; inputs are not changed.

    Args:
        light: of the frame's sampled pixels. Their phasors are those of a sine, normalised by the modulation amplitude
            and corrected for the pulse. Pixels without an answer (saturated, hot, without signal) are not seen.
        means: over all pixels of each patch that are seen.
        kinds: of the patches of a frame that is taken for a tail.
        grid: how the frame is cut.
        variances: noise variance of one channel of one recorded pixel, for each harmonic, in squared units of the phasors.
        settings: which model is asked for, and the harmonics' periods.
        samples: number of recorded pixels that most phasors are a mean of.
        shared: how many pixels share their noise, as in `SharedNoise`.
        range_offset_m: what is added to the range of every pixel (field curvature), (Y, X); None for nothing.
        kernel: of `available_kernels`, all of which give the same bits.
    """
    offset = 0.0 if range_offset_m is None else grid.samples(range_offset_m).astype(np.float32)
    frame = _Frame(grid, settings, np.array(variances) / samples, offset, shared, kernel)
    planes = _planes(light, means, frame)
    valid: Bool = planes.found & kinds.lit
    if valid.sum() < LEAST_PATCHES:
        return "few patches with light"
    return _model(light, planes, valid, kinds, frame, variances, range_offset_m) or "no tail fits"


def _model(
    light: PatchLight,
    planes: PatchPlanes,
    valid: Bool,
    kinds: PatchKinds,
    frame: _Frame,
    variances: tuple[float, ...],
    range_offset_m: Float | None,
) -> DiffuseModel | None:
    """Return the model of a frame; None if no tail fits it."""
    means = patch_means(
        light,
        planes.on_plane,
        variance=frame.variances[0],
        harmonics=frame.settings.harmonics,
        shared=frame.shared,
        kernel=frame.kernel,
    )
    ratios, amplitude, seen = means.ratios[:, valid], means.amplitude[valid], planes.surfaces[valid]
    model, term_model = _tail_models(seen, surfaces_beyond(planes.surfaces, valid, frame.grid), amplitude, frame)
    rule = pattern(model.light.direct)
    data = np.concatenate([np.log(np.maximum(np.abs(ratios), NO_RATIO)), np.angle(ratios)])
    modelled, noise = model_error(ratios), _noise(ratios, amplitude, means.pixels[valid], frame)
    error = modelled + noise
    known, auto = frame.grid.view.known, frame.settings.model == "auto"
    fit = fitted_patches(data, error, model, rule, known_optics=known, kernel=frame.kernel)
    phasors = patch_phasors(means, harmonics=frame.settings.harmonics)
    nets = _find_nets(phasors, valid, fit, frame) if auto else None
    uncovered = np.ones(amplitude.size, np.bool_)
    if nets is not None:
        uncovered = ~nets.found[valid]
        error = np.where(uncovered, error, _covered_error(error))
        fit = fitted_patches(data, error, model, rule, known_optics=known, kernel=frame.kernel)
        candidates = (_find_nets(phasors, valid, fit, frame, patches) for patches in (uncovered, None))
        nets = max(filter(None, candidates), key=lambda one: one.found.sum(), default=nets)
    posterior = patch_posterior(data, error, fit)
    if auto:
        by_two_paths = _two_path_chi_squared(means, valid, frame)[uncovered]
        if not tail_fits(posterior.chi_squared[uncovered], by_two_paths, len(data)):
            return None
        foretold, _ = model.values(fit.room[:, None] + rule)
        snr = amplitude / np.sqrt(frame.variances[0])
        # phasors that two paths have freed of other terms do not vary as a tail yet
        if term_model is None and not varies_like_the_tail(data, foretold, noise, modelled, snr, uncovered):
            return None
    guessed = surfaces_guessed(planes.surfaces, valid, frame.grid, seen=seen)
    lags = _lag_parts(fit, model, seen, guessed, frame, mpi_share(ratios))
    two_path_rad = two_path_lag(ratios[0], kernel=frame.kernel)
    bias = _bias(fit, seen, amplitude, lags.seen_rad, two_path_rad, uncovered, frame) if len(ratios) == 1 else None
    coarse = coarse_planes(fit, posterior, lags, valid, bias, slowness=frame.settings.slowness)
    coarse = coarse.weighted_by(kinds.mpi_probability)
    term_tails = None if term_model is None else _term_tails(term_model, fit, coarse, planes, valid, frame)
    if term_tails is not None:
        coarse = coarse.with_added_variance(_term_variance(term_tails, frame.settings))
    covered = 0 if nets is None else int(nets.found.sum())
    difference_rad = (coarse.planes[coarse.data + 1][valid] - two_path_rad)[uncovered]
    return DiffuseModel(
        frame.settings,
        DiffuseChoice("tail", int(kinds.lit.sum()), kinds.separate_share, _room_numbers(fit.state), covered),
        variances,
        coarse,
        upsampler(coarse.planes, planes.surfaces.range_m, valid, frame.grid),
        kinds.separate,
        float(median(difference_rad**2)),
        range_offset_m,
        nets,
        term_tails,
    )


def _bias(
    fit: PatchFit,
    seen: Surfaces,
    amplitude: Float,
    seen_rad: Float,
    two_path_rad: Float,
    uncovered: Bool,
    frame: _Frame,
) -> Bias:
    """Return the correction of the lag with two harmonics, from the patches that are `uncovered`."""
    lag_rad, two_path_rad = fit.posterior[-1, uncovered], two_path_rad[uncovered]
    numbers = view_numbers(
        fit.room,
        seen[uncovered],
        amplitude[uncovered],
        lag_rad=lag_rad,
        seen_rad=seen_rad[uncovered],
        two_path_rad=two_path_rad,
    )
    slowness = frame.settings.slowness
    left = remaining_sigma_rad(lag_rad, two_path_rad, rad_per_ns=frame.settings.rad_per_ns, slowness=slowness)
    return Bias(0.0 if numbers is None else missed_share(numbers, slowness=slowness), left)


def _two_path_chi_squared(means: PatchMeans, valid: Bool, frame: _Frame) -> Float:
    """Return χ², (n,), of the further harmonics about what two paths predict; the paths may have the errors of a tail."""
    if len(frame.settings.harmonics) == 2:
        # there are no further harmonics
        return np.zeros(np.count_nonzero(valid))
    patches = PatchData.of(means, valid, frame.variances, frame.settings.harmonics)
    tolerated = np.diagonal(model_error(patches.ratios)).T[:-2].reshape(2, *patches.ratios.shape)
    with np.errstate(all="ignore"):
        return further_chi_squared(SecondPaths.of(patches, kernel=frame.kernel), replace(patches, tolerated=tolerated))


def _find_nets(
    phasors: Complex, valid: Bool, fit: PatchFit, frame: _Frame, uncovered: Bool | None = None
) -> Nets | None:
    """Return the surface that lets light through in a frame; None if there is none.

    By default, both paths get the tail that is typical of the frame. With `uncovered`, (n,), the nearer path gets the
    tail that is typical of the covered patches, and the farther path that of the uncovered ones.
    """
    far = typical_tail(fit.posterior if uncovered is None else fit.posterior[:, uncovered], frame.settings.harmonics)
    near = far if uncovered is None else typical_tail(fit.posterior[:, ~uncovered], frame.settings.harmonics)
    return find_nets(
        phasors,
        fit.posterior[-1],
        valid,
        Tails(near, far, frame.settings.harmonics),
        grid=frame.grid,
        settings=frame.settings,
        kernel=frame.kernel,
    )


def _lag_parts(
    fit: PatchFit, tail: TailModel, seen: Surfaces, guessed: Surfaces, frame: _Frame, share: float
) -> LagParts:
    """Return the lags by light that the view does not show.

    Light of guessed walls counts if a patch faces little that is known. If a frame has little MPI, it has less early
    light that the fit does not see.
    """
    light = light_of(guessed, seen, rad_per_m=frame.settings.rad_per_m, kernel=frame.kernel)
    open_share = tail.light.open_share
    seen_rad, continued_rad, unseen_rad, guessed_rad = tail.lag_parts(fit.state, open_share**GUESSED_POWER * light)
    return LagParts(seen_rad, continued_rad, share * unseen_rad, share * guessed_rad, open_share, seen.cosine)


def _planes(light: PatchLight, means: PatchMeans, frame: _Frame) -> PatchPlanes:
    """Return the surfaces from a first depth: that of two paths, from the mean light of every patch."""
    lag = two_path_lag(means.ratios[0], kernel=frame.kernel)
    range_m = range_from_phase(light.phase_rad - lag.astype(np.float32), frame.settings) + frame.offset_m
    return patch_planes(np.maximum(range_m, np.float32(NEAREST_M)), light.seen, frame.grid)


def _tail_models(
    seen: Surfaces, beyond: Surfaces, amplitude: Float, frame: _Frame
) -> tuple[TailModel, TailModel | None]:
    """Return the model of patches with these surfaces, and the model at the multiples that other terms see; None for a sine."""
    settings = frame.settings
    multiples = tuple(h for h, _ in settings.terms or ())
    harmonics = tuple(sorted({*settings.harmonics, *multiples}))
    light = interreflections(
        seen, beyond, amplitude, harmonics=harmonics, rad_per_m=settings.rad_per_m, kernel=frame.kernel
    )

    def model(chosen: tuple[int, ...]) -> TailModel:
        return TailModel(light.at([harmonics.index(h) for h in chosen]), chosen, settings.rad_per_ns, frame.kernel)

    return model(settings.harmonics), None if settings.terms is None else model(multiples)


def _term_tails(
    tail: TailModel, fit: PatchFit, coarse: CoarsePlanes, planes: PatchPlanes, valid: Bool, frame: _Frame
) -> TermTails:
    """Return the tail that other terms of a response see, at the fitted state; invalid patches get the mean."""
    values = np.empty((2 + 2 * len(tail.harmonics), *valid.shape), np.float32)
    values[:2] = coarse.planes[coarse.data : coarse.data + 2]
    if tail.harmonics:
        light = tail.light_at(fit.state).reshape(len(values) - 2, -1)
        values[2:] = light.mean(axis=1)[:, None, None]
        values[2:, valid] = light
    return TermTails(tail.harmonics, values, upsampler(values, planes.surfaces.range_m, valid, frame.grid))


def _term_variance(tails: TermTails, settings: DiffuseSettings) -> Float32:
    """Return the variance of the direct phase, rad², (rows, columns), by errors of the tail that other terms see."""
    count, variance = len(tails.harmonics), np.zeros(tails.planes.shape[1:], np.float32)
    parts = zip(tails.planes[2 : 2 + count], tails.planes[2 + count :], strict=True)
    for (_, share), (re, im) in zip(settings.terms or (), parts, strict=True):
        variance += np.float32((TERM_ERROR * share) ** 2) * ((re - 1.0) ** 2 + im * im)
    return variance


def _noise(ratios: Complex, amplitude: Float, pixels: Float, frame: _Frame) -> Float:
    """Return the covariance of the patches' data by noise, (data + 2, data + 2, n); it is 0 among the last two values."""
    strength = np.concatenate([np.ones((1, ratios.shape[1])), np.maximum(np.abs(ratios), LEAST_RATIO)]) * amplitude
    relative = frame.variances[:, None] / (strength**2 * pixels)
    count = 2 * len(ratios)
    covariance = np.zeros((count + 2, count + 2, amplitude.size))
    for (i, j), value in noise_covariance(list(relative), harmonics=frame.settings.harmonics).items():
        if i < count:
            covariance[i, j] = covariance[j, i] = value
    return covariance


def _covered_error(error: Float) -> Float:
    """Return the errors (data + 2, data + 2, n) of patches whose data must say nothing."""
    covered = np.zeros_like(error)
    covered[:-2, :-2], covered[-2:, -2:] = COVERED_ERROR * error[:-2, :-2], error[-2:, -2:]
    return covered


def _room_numbers(state: Float) -> RoomNumbers:
    """Return the medians and the scatter of the states of all patches, (6, n)."""
    low, middle, high = quantiles(state, (0.16, 0.5, 0.84))
    scatter = 0.5 * (high - low)
    natural = np.exp(middle[:5])
    albedo, beside, later, unseen, decay = (
        (float(value), float(value * s)) for value, s in zip(natural, scatter, strict=False)
    )
    return RoomNumbers(albedo, beside, later, unseen, decay, (float(middle[5]), float(scatter[5])))
