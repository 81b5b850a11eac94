"""Flat targets at known distances → the response of the channel pairs and the maps of phase and gain."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.calibration.fit.field import field_curvature
from cadtof_cli.calibration.fit.pixels import Observations, PixelFit, Terms, fit_pixels, mean_rotor
from cadtof_cli.calibration.fit.robust import shape_rms
from cadtof_cli.calibration.fit.terms import LARGEST_RESIDUAL, TermFit, fit_terms
from cadtof_cli.calibration.parts import FieldCurvature, Origin
from cadtof_cli.calibration.response import ResponseCalibration, ResponseQuality
from cadtof_cli.capture.metadata import CaptureMetadata, Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.optics import LampBeside, wall_range_m
from cadtof_cli.phasors.response import HarmonicResponse, ideal_response
from cadtof_cli.units import metres_per_radian

SAME_DISTANCE_M = 0.01
"""Distances that differ by no more than this count as one distance."""

LEAST_SIGNAL = 5.0
"""Least voltage, in units of its noise, that a usable pixel has at every harmonic and distance."""

LEAST_USABLE = 0.05
"""Least share of the pixels that must be usable."""

TERM_PIXELS = 6_000
"""About how many pixels the terms are fitted to, spread over the array. The maps use all pixels."""

LARGEST_MISFIT_M = 0.01
"""A target is refused if the root mean square of its blocks' residuals, as ranges, is larger than this. The residuals
are those from the response that fits all targets."""

LEAST_IN_COMMON = 0.5
"""Least length of the mean of all pixels' rotors at the fundamental. Pixels of a camera differ by tenths of a radian, so
it is near 1. Offsets of frames without light have random phases, so it is near 0."""

LARGEST_OFFSET = 0.005
"""Largest offset that light of the laser is thought to bring with it, relative to k = 1. An offset of its own that is three times
smaller, at 2 m, looks as large."""


@dataclass(frozen=True, eq=False)
class TargetMean:
    """The mean frame of one flat target, without dark offsets.

    `volts` is complex128 (H, Y, X), NaN in pixels that cannot be used; `noise_v`, (H,), is the mean's standard
    deviation per channel. `offset_noise_v` is that of the dark offsets, a part of `noise_v` that all targets share.
    """

    volts: Complex
    noise_v: Float
    distance_m: float
    offset_noise_v: float = 0.0


def fit_response(targets: Sequence[TargetMean], /, *, metadata: CaptureMetadata, origin: Origin) -> ResponseCalibration:
    """Return the response that fits all targets, with as many terms as the distances of the targets can determine.

    Raises:
        SettingsError: too few pixels see every target; or the targets are not flat walls that face the camera.
    """
    every = _observations(targets, metadata.optics, origin)
    seen = _seen(every)
    usable = np.asarray(seen.all(axis=0))
    observed = every[usable]
    ideal = ideal_response(metadata)
    base = [{k: g / response.main for k, g in response.terms if k != 1} for response in ideal]
    distances = sorted({target.distance_m for target in targets})
    distinct = 1 + sum(b - a > SAME_DISTANCE_M for a, b in itertools.pairwise(distances))
    terms = fit_terms(observed[:: max(1, usable.sum() // TERM_PIXELS)], base, distances=distinct)
    pixels = fit_pixels(observed, terms.terms)
    _require_light(pixels)
    _require_one_response(pixels, usable.reshape(origin.pixels), origin, metadata.optics)
    own, log_gain = _of_all_pixels(every, seen, pixels, terms.terms)
    point, known = metadata.optics.principal_point(origin.pixels), metadata.optics.focal_length_px is not None
    curvature = (
        field_curvature(pixels, usable, point=point, origin=origin)
        if known
        else FieldCurvature(principal_point_px=point)
    )
    added_rad = curvature.added_m(origin.pixels).ravel() / metres_per_radian(origin.periods_ns[0])
    own -= np.array(origin.harmonics, np.float64)[:, np.newaxis] * added_rad
    responses, phases, gains = _terms_and_maps(own, log_gain, seen, terms.terms, ideal)
    shape = (len(ideal), *origin.pixels)
    said = (*_assumptions(seen, known), *_other_distances(targets, terms), *_doubts(terms, curvature))
    return ResponseCalibration(
        origin,
        responses,
        phases.reshape(shape),
        gains.reshape(shape),
        curvature,
        _quality(pixels, observed, targets[0].offset_noise_v, terms, tuple(distances), terms.findings + said),
        metadata.optics.lamp_offset_m or ResponseCalibration.lamp_offset_m,
    )


def _observations(targets: Sequence[TargetMean], optics: Optics, origin: Origin) -> Observations:
    """Return the targets as seen by all pixels. Without a focal length, all pixels of a target count as equally far."""
    known = optics.focal_length_px is not None
    per_metre = wall_range_m(optics, origin.pixels, distance_m=1.0) if known else np.ones(origin.pixels)
    ranges = np.stack([one.distance_m * per_metre.ravel() for one in targets])
    lamp = LampBeside.of(optics, origin.pixels)
    half_ways = ranges if lamp is None else lamp.half_way_m(ranges)
    return Observations(
        volts=np.stack([one.volts.reshape(len(origin.harmonics), -1) for one in targets]),
        noise_v=np.stack([one.noise_v for one in targets]),
        phase=half_ways / metres_per_radian(origin.periods_ns[0]),
        harmonics=origin.harmonics,
    )


def _seen(every: Observations) -> Bool:
    """Return in which pixels each target gives a signal, (N, n)."""
    with np.errstate(invalid="ignore"):
        seen = (np.abs(every.volts) > LEAST_SIGNAL * every.noise_v[:, :, np.newaxis]).all(axis=1)
    usable = seen.all(axis=0).mean()
    if usable < LEAST_USABLE:
        raise SettingsError(
            f"found {usable:.1%} of the pixels with a signal from every target, expected {LEAST_USABLE:.0%} or more: the "
            "targets must fill most of the view, and must not be saturated"
        )
    return np.asarray(seen)


def _of_all_pixels(every: Observations, seen: Bool, pixels: PixelFit, terms: Terms) -> tuple[Float, Float]:
    """Return phases and logarithms of gains, (H, n) each: of pixels that do not see all targets, by the targets that they
    see; 0 if they see none."""
    phase, log_gain = np.zeros((2, len(every.harmonics), seen.shape[1]))
    phase[:, seen.all(axis=0)], log_gain[:, seen.all(axis=0)] = pixels.phase, pixels.log_gain
    for kind in np.unique(seen[:, seen.any(axis=0) & ~seen.all(axis=0)], axis=1).T:
        alike = (seen == kind[:, np.newaxis]).all(axis=0)
        some = Observations(every.volts[kind], every.noise_v[kind], every.phase[kind], every.harmonics)
        fit = fit_pixels(some[alike], terms)
        phase[:, alike], log_gain[:, alike] = fit.phase, fit.log_gain
    return phase, log_gain


def _assumptions(seen: Bool, known_optics: bool) -> list[str]:
    said = ["gains are relative to harmonic 1, because its own gain cannot be separated from the target's reflectivity"]
    if known_optics:
        said.append("the targets are assumed to face the camera; their ranges follow from the optics")
    else:
        said.append(
            "warning: no focal length given, so the target's distance is used as the range of every pixel; set focal_length_px "
            "under [optics], or the shape of the walls ends up in the phase maps"
        )
    any_target, every_target = seen.any(axis=0), seen.all(axis=0)
    if (any_target & ~every_target).any():
        said.append(
            f"{(any_target & ~every_target).sum()} pixels are saturated, not finite or without a signal in some of the targets: "
            "their phase and gain are those of the other targets"
        )
    if not any_target.all():
        said.append(f"{(~any_target).sum()} pixels could not be used: they get the mean phase and gain of the array")
    return said


def _other_distances(targets: Sequence[TargetMean], terms: TermFit) -> tuple[str, ...]:
    """Return in words at which distances the frames fit, if those that were given explain them less well."""
    if terms.stretch is None:
        return ()
    given = np.array([target.distance_m for target in targets])
    shown = given * terms.stretch
    return (
        f"the given distances do not fit each other: one is {1000.0 * np.abs(shown - given).max():.1f} mm off, if the frames "
        f"are right; the terms were fitted with {', '.join(f'{one:.4f} m' for one in shown)}, whose mean is as given",
    )


def _doubts(terms: TermFit, curvature: FieldCurvature) -> list[str]:
    """Return in words what a user should know about the curvature, the residual and k = 0."""
    said = []
    k2, k4 = curvature.k2_m, curvature.k4_m
    if k2 or k4:
        said.append(
            f"field curvature k2 = {k2:.4f} m, k4 = {k4:.4f} m was removed from the phase maps: `resolve` corrects it by itself, "
            "or uses the field curvature of `calibrate petzval` instead"
        )
    if terms.residual > LARGEST_RESIDUAL:
        said.append(
            f"warning: the residual is {terms.residual:.1f} times the noise: is the dark calibration in the folder, are the "
            "distances right, and is the target flat, still and without multi-path interference?"
        )
    offset = max(abs(one.get(0, 0.0)) for one in terms.terms)
    if offset > LARGEST_OFFSET:
        said.append(
            f"warning: k = 0 is {offset:.2g} of k = 1, an offset in proportion to the laser's light: offsets that drifted since "
            "calibrate dark, a dirty window or stray light look like that, and this response then makes depths of other scenes "
            "wrong by decimetres. Repeat calibrate dark and this step at one temperature, with a clean window"
        )
    return said


def _require_light(pixels: PixelFit) -> None:
    """Make sure that the phases are those of light that reaches all pixels, not those of offsets."""
    in_common = float(np.abs(np.exp(1j * pixels.phase[0]).mean()))
    if in_common < LEAST_IN_COMMON:
        raise SettingsError(
            f"the phases of the pixels have only {in_common:.2f} in common (1: all are equal), expected {LEAST_IN_COMMON} or "
            "more: these frames hold offsets, or a target that does not fill the view. Was the laser on? If the light is "
            "weak, run `calibrate dark` first"
        )


def _require_one_response(pixels: PixelFit, where: Bool, origin: Origin, optics: Optics) -> None:
    """Make sure that every target, at its own distance, agrees with the response that fits all targets."""
    metres = metres_per_radian(origin.periods_ns[0])
    misfits = [
        max(metres * shape_rms(left.imag / h, where) for h, left in zip(origin.harmonics, one, strict=True))
        for one in pixels.left
    ]
    worst = int(np.argmax(misfits))
    if misfits[worst] > LARGEST_MISFIT_M:
        raise SettingsError(
            f"{origin.captures[worst]}: this target differs from the others by {1000 * misfits[worst]:.0f} mm (RMS over the "
            f"array), expected {1000 * LARGEST_MISFIT_M:.0f} mm at most: {_why_targets_differ(optics)}"
        )


def _why_targets_differ(optics: Optics) -> str:
    """Return the likely causes in words. Without a focal length the ranges over the array are wrong for sure."""
    if optics.focal_length_px is None:
        return (
            "no focal length is given, so every pixel of a target counts as equally far: set focal_length_px under [optics], "
            "and principal_point_px if the optical axis does not meet the middle of the array"
        )
    unknown = optics.principal_point_px is None
    axis = "or the optical axis does not meet the middle of the array (principal_point_px); " if unknown else ""
    return (
        "it is not flat, is tilted, receives light by other ways (MPI: floor, walls, glossy objects), or its distance is wrong; "
        f"{axis}or the dark calibration is missing in the folder. Point the camera square at a plain wall, clear the sides, "
        "measure the distance, and record again"
    )


def _quality(
    pixels: PixelFit,
    observed: Observations,
    offset_noise_v: float,
    terms: TermFit,
    distances: tuple[float, ...],
    findings: tuple[str, ...],
) -> ResponseQuality:
    own = np.maximum(observed.noise_v**2 - offset_noise_v**2, 0.0)

    def stderr(weights: Float, *rows: int) -> float:
        """Return the typical error of a mean over targets with these weights, (N, n), by the noise of these harmonics."""
        each = weights[:, np.newaxis, :] / observed.volts[:, rows]
        # all targets share the error of a pixel's offsets, which cancels in part if their phasors point elsewhere
        variance = (own[:, rows, np.newaxis] * np.abs(each) ** 2).sum(axis=0)
        variance += (offset_noise_v * np.abs(each.sum(axis=0))) ** 2
        return float(np.median(np.sqrt(variance.sum(axis=0)) / weights.sum(axis=0)))

    rows, of_targets = range(len(observed.harmonics)), pixels.weights.sum(axis=1)
    return ResponseQuality(
        distances_m=distances,
        residual=terms.residual,
        phase_stderr_rad=tuple([stderr(pixels.weights[:, row], row) for row in rows]),
        gain_stderr=(0.0, *[stderr(of_targets, 0, row) for row in rows[1:]]),
        term_stderr=terms.stderr,
        findings=findings,
    )


def _terms_and_maps(
    own: Float, log_gain: Float, seen: Bool, terms: Terms, ideal: tuple[HarmonicResponse, ...]
) -> tuple[tuple[HarmonicResponse, ...], Float32, Float32]:
    """Return G, which contains the means of phases and gains over the pixels that see all targets, and maps of what is left,
    (H, Y·X) each; `own` and `log_gain` are the phases and logarithms of the gains."""
    phase, gain = np.zeros(own.shape, np.float32), np.ones(own.shape, np.float32)
    usable, known = seen.all(axis=0), seen.any(axis=0)
    nominal = abs(ideal[0].main)
    responses = []
    for row, response in enumerate(ideal):
        rotor = mean_rotor(own[row, usable])
        gains = np.exp(log_gain[row]) * nominal
        middle = float(np.median(gains[usable]))
        phase[row, known] = np.angle(np.exp(1j * own[row, known]) / rotor)
        gain[row, known] = gains[known] / middle
        higher = [(k, middle * value * complex(rotor) ** k) for k, value in terms[row].items()]
        responses.append(HarmonicResponse(response.harmonic, ((1, middle * complex(rotor)), *higher)))
    return tuple(responses), phase, gain
