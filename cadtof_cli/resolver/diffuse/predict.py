"""The diffuse MPI of a frame: whether a tail fits, and the coarse model from which the pixels are answered."""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32, median
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.beyond import surfaces_beyond, surfaces_guessed
from cadtof_cli.resolver.diffuse.bias import Bias, missed_share, remaining_sigma_rad, view_numbers
from cadtof_cli.resolver.diffuse.choice import (
    LEAST_PATCHES,
    PatchKinds,
    Reason,
    RoomNumbers,
    tail_fits,
    two_paths_fail,
)
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes, LagParts, coarse_planes, patch_posterior
from cadtof_cli.resolver.diffuse.condition import Conditioned
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchLight, PatchMeans
from cadtof_cli.resolver.diffuse.model_error import mpi_share
from cadtof_cli.resolver.diffuse.nets import find_nets
from cadtof_cli.resolver.diffuse.patch_fit import PatchFit, fitted_patches
from cadtof_cli.resolver.diffuse.patches import LitPatches, first_planes
from cadtof_cli.resolver.diffuse.planes import PatchPlanes
from cadtof_cli.resolver.diffuse.prior import pattern
from cadtof_cli.resolver.diffuse.radiosity import interreflections, light_of
from cadtof_cli.resolver.diffuse.records import DiffuseModel, Nets, TermTails
from cadtof_cli.resolver.diffuse.second_paths import PatchData, SecondPaths, further_chi_squared, two_path_lag
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.diffuse.tail import TailModel
from cadtof_cli.resolver.diffuse.upsampling import upsampler
from cadtof_cli.resolver.diffuse.variation import varies_like_the_tail

GUESSED_POWER = 4
"""Power of the unknown share of what a patch faces, with which the light of guessed walls counts. A view that shows
walls at right angles holds most of the early light. A view of a single wall holds none of it."""

TERM_ERROR = 0.5
"""Standard deviation of the tail at a multiple that only other terms of a response see, as a share of it. Early light
hardly changes the ratios of the fitted harmonics, but at those multiples it is all that is left of a tail."""

COVERED_ERROR = 1e6
"""Factor on the error of patches with two surfaces, so that they say nothing of the room."""

LEAST_STEPPED = 0.1
"""Least share of the patches with a step for a second look. A view full of shelves has a third and more, and noise makes one of a
hundred."""


@dataclass(frozen=True, eq=False)
class _Room:
    """The patches with light of a frame, and the room that they show, fitted to the data of the patches that no net covers.

    Attributes:
        patches: the n patches with light.
        tail: the model of their tail.
        term_tail: the same at the multiples that other terms of the response see; None for a sine.
        fit: the state of the room and of all patches.
        posterior: what the data of each patch say of its tail.
        nets: the surface that lets light through; None if there is none.
        uncovered: patches that it does not cover, (n,).
    """

    patches: LitPatches
    tail: TailModel
    term_tail: TailModel | None
    fit: PatchFit
    posterior: Conditioned
    nets: Nets | None
    uncovered: Bool


def diffuse_model(
    light: PatchLight, means: PatchMeans, kinds: PatchKinds, frame: FrameTraits, /
) -> DiffuseModel | Reason:
    """Return the model of a frame, or why it is left to separate paths after all; inputs are not changed.

    Args:
        light: of the frame's sampled pixels. Their phasors are those of a sine, normalised by the modulation amplitude
            and corrected for the pulse. Pixels without an answer (saturated, hot, without signal) are not seen.
        means: over all pixels of each patch that are seen.
        kinds: of the patches of a frame that is taken for a tail.
        frame: what else is known of the frame.
    """
    settings = frame.settings
    planes = first_planes(light, means, frame)
    valid: Bool = planes.found & kinds.lit
    if valid.sum() < LEAST_PATCHES:
        return "few patches with light"
    room = _room(light, planes, valid, frame)
    if settings.model == "auto" and not _has_tail(room, frame):
        # shelves and clutter tilt planes, so that light is foretold where there is none
        tilted, planes = planes, first_planes(light, means, frame, over_steps=True)
        stepped = (planes.surfaces.normal != tilted.surfaces.normal).any(axis=0)
        if stepped.sum() < LEAST_STEPPED * planes.found.sum():
            return "no tail fits"
        room = _room(light, planes, valid, frame)
        if not _has_tail(room, frame):
            return "no tail fits"
    two_path_rad = two_path_lag(room.patches.ratios[0])
    coarse = _coarse(room, two_path_rad, frame).weighted_by(kinds.mpi_probability)
    terms = None if room.term_tail is None else _term_tails(room.term_tail, room, coarse, frame)
    if terms is not None:
        coarse = coarse.with_added_variance(_term_variance(terms, settings))
    covered = 0 if room.nets is None else int(room.nets.found.sum())
    difference_rad = (coarse.planes[coarse.data + 1][valid] - two_path_rad)[room.uncovered]
    return DiffuseModel(
        settings,
        replace(kinds.choice, room=RoomNumbers.of(room.fit.state), net_patches=covered),
        frame.recorded_variances,
        coarse,
        upsampler(coarse.planes, planes.surfaces.range_m, valid, frame.grid),
        kinds.separate,
        float(median(difference_rad**2)),
        frame.range_offset_m,
        room.nets,
        terms,
    )


def _room(light: PatchLight, planes: PatchPlanes, valid: Bool, frame: FrameTraits) -> _Room:
    """Fit the room that the patches `valid`, (rows, columns), show; if a net covers some, once more without their data."""
    patches = LitPatches.of(light, planes, valid, frame)
    tail, term_tail = _tail_models(patches, frame)
    error, rule = patches.model_error + patches.noise, pattern(tail.light.direct)
    known = frame.grid.view.known
    fit = fitted_patches(patches.data, error, tail, rule, known_optics=known)
    nets = find_nets(patches, fit, frame) if frame.settings.model == "auto" else None
    uncovered = np.ones(patches.amplitude.size, np.bool_)
    if nets is not None:
        uncovered = ~nets.found[patches.valid]
        error = np.where(uncovered, error, _covered_error(error))
        fit = fitted_patches(patches.data, error, tail, rule, known_optics=known)
        candidates = (find_nets(patches, fit, frame, which) for which in (uncovered, None))
        nets = max(filter(None, candidates), key=lambda one: one.found.sum(), default=nets)
    return _Room(patches, tail, term_tail, fit, patch_posterior(patches.data, error, fit), nets, uncovered)


def _has_tail(room: _Room, frame: FrameTraits) -> bool:
    """Return whether the room's tail explains the patches, and whether they vary over the view as it does."""
    patches, uncovered, data = room.patches, room.uncovered, len(room.patches.data)
    by_two_paths = _two_path_chi_squared(patches, frame)[uncovered]
    if not tail_fits(room.posterior.chi_squared[uncovered], by_two_paths, data):
        return False
    if room.term_tail is not None or two_paths_fail(by_two_paths, data):
        # phasors that two paths have freed of other terms do not vary as a tail yet; and how MPI varies is only asked to
        # tell a tail from two paths
        return True
    foretold, _ = room.tail.values(room.fit.room[:, None] + pattern(room.tail.light.direct))
    snr = patches.amplitude / np.sqrt(frame.variances[0])
    return varies_like_the_tail(patches.data, foretold, patches.noise, patches.model_error, snr, uncovered)


def _coarse(room: _Room, two_path_rad: Float, frame: FrameTraits) -> CoarsePlanes:
    """Return what pixels need from the patches; light that the view does not show, and the bias of two harmonics, are in it."""
    lags, two_harmonics = _lag_parts(room, frame), len(room.patches.ratios) == 1
    bias = _bias(room, lags.seen_rad, two_path_rad, frame) if two_harmonics else None
    return coarse_planes(room.fit, room.posterior, lags, room.patches.valid, bias, slowness=frame.settings.slowness)


def _bias(room: _Room, seen_rad: Float, two_path_rad: Float, frame: FrameTraits) -> Bias:
    """Return the correction of the lag with two harmonics, from the patches that no net covers."""
    uncovered, slowness = room.uncovered, frame.settings.slowness
    lag_rad, two_path_rad = room.fit.posterior[-1, uncovered], two_path_rad[uncovered]
    numbers = view_numbers(
        room.fit.room,
        room.patches.seen[uncovered],
        room.patches.amplitude[uncovered],
        lag_rad=lag_rad,
        seen_rad=seen_rad[uncovered],
        two_path_rad=two_path_rad,
    )
    left = remaining_sigma_rad(lag_rad, two_path_rad, rad_per_ns=frame.settings.rad_per_ns, slowness=slowness)
    return Bias(0.0 if numbers is None else missed_share(numbers, slowness=slowness), left)


def _two_path_chi_squared(patches: LitPatches, frame: FrameTraits) -> Float:
    """Return χ², (n,), of the further harmonics about what two paths predict; the paths may have the errors of a tail."""
    if len(frame.settings.harmonics) == 2:
        # there are no further harmonics
        return np.zeros(patches.amplitude.size)
    data = PatchData.of(patches.means, patches.valid, frame)
    tolerated = np.diagonal(patches.model_error).T[:-2].reshape(2, *patches.ratios.shape)
    with np.errstate(all="ignore"):
        return further_chi_squared(SecondPaths.of(data), replace(data, tolerated=tolerated))


def _lag_parts(room: _Room, frame: FrameTraits) -> LagParts:
    """Return the lags by light that the view does not show.

    Light of guessed walls counts if a patch faces little that is known. If a frame has little MPI, it has less early
    light that the fit does not see.
    """
    patches, open_share = room.patches, room.tail.light.open_share
    guessed = surfaces_guessed(patches.surfaces, patches.valid, frame.grid, seen=patches.seen)
    light = open_share**GUESSED_POWER * light_of(guessed, patches.seen, rad_per_m=frame.settings.rad_per_m)
    seen_rad, continued_rad, unseen_rad, guessed_rad = room.tail.lag_parts(room.fit.state, light)
    share = mpi_share(patches.ratios)
    return LagParts(seen_rad, continued_rad, share * unseen_rad, share * guessed_rad, open_share, patches.seen.cosine)


def _tail_models(patches: LitPatches, frame: FrameTraits) -> tuple[TailModel, TailModel | None]:
    """Return the model of the patches, and their model at the multiples that other terms see; None for a sine."""
    settings = frame.settings
    multiples = tuple(h for h, _ in settings.terms or ())
    harmonics = tuple(sorted({*settings.harmonics, *multiples}))
    light = interreflections(
        patches.seen,
        surfaces_beyond(patches.surfaces, patches.valid, frame.grid),
        patches.amplitude,
        harmonics=harmonics,
        rad_per_m=settings.rad_per_m,
    )

    def model(chosen: tuple[int, ...]) -> TailModel:
        return TailModel(light.at([harmonics.index(h) for h in chosen]), chosen, settings.rad_per_ns)

    return model(settings.harmonics), None if settings.terms is None else model(multiples)


def _term_tails(tail: TailModel, room: _Room, coarse: CoarsePlanes, frame: FrameTraits) -> TermTails:
    """Return the tail that other terms of a response see, at the fitted state; invalid patches get the mean."""
    valid, range_m = room.patches.valid, room.patches.surfaces.range_m
    values = np.empty((2 + 2 * len(tail.harmonics), *valid.shape), np.float32)
    values[:2] = coarse.planes[coarse.data : coarse.data + 2]
    if tail.harmonics:
        light = tail.light_at(room.fit.state).reshape(len(values) - 2, -1)
        values[2:] = light.mean(axis=1)[:, None, None]
        values[2:, valid] = light
    return TermTails(tail.harmonics, values, upsampler(values, range_m, valid, frame.grid))


def _term_variance(tails: TermTails, settings: DiffuseSettings) -> Float32:
    """Return the variance of the direct phase, rad², (rows, columns), by errors of the tail that other terms see."""
    count, variance = len(tails.harmonics), np.zeros(tails.planes.shape[1:], np.float32)
    parts = zip(tails.planes[2 : 2 + count], tails.planes[2 + count :], strict=True)
    for (_, share), (re, im) in zip(settings.terms or (), parts, strict=True):
        variance += np.float32((TERM_ERROR * share) ** 2) * ((re - 1.0) ** 2 + im * im)
    return variance


def _covered_error(error: Float) -> Float:
    """Return the errors (data + 2, data + 2, n) of patches whose data must say nothing."""
    covered = np.zeros_like(error)
    covered[:-2, :-2], covered[-2:, -2:] = COVERED_ERROR * error[:-2, :-2], error[-2:, -2:]
    return covered
