"""Flat targets at known distances → the response of the channel pairs and the maps of phase and gain."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.calibration.fit.pixels import Observations, PixelFit, Terms, fit_pixels
from cadtof_cli.calibration.fit.robust import SURE, RobustFit, robust_fit, shape_rms
from cadtof_cli.calibration.fit.terms import LARGEST_RESIDUAL, TermFit, fit_terms
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.calibration.response import ResponseCalibration, ResponseQuality
from cadtof_cli.capture.metadata import CaptureMetadata, Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.optics import LampBeside, curvature_m, squared_field_radius, wall_range_m
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

CURVATURE_SIGNIFICANCE = 4.0
"""Field curvature is taken out of the phases if k2 or k4 is larger than this many standard errors."""

LARGEST_MISFIT_M = 0.01
"""A target is refused if the root mean square of its blocks' residuals, as ranges, is larger than this. The residuals
are those from the response that fits all targets."""

LEAST_IN_COMMON = 0.5
"""Least length of the mean of all pixels' rotors at the fundamental. Pixels of a camera differ by tenths of a radian, so
it is near 1. Offsets of frames without light have random phases, so it is near 0."""

LARGEST_OFFSET = 0.005
"""Largest offset that light of the laser is thought to bring with it, relative to k = 1. An offset of its own that is three times
smaller, at 2 m, looks as large."""

LARGEST_LEAN_M = 0.1
"""Targets are refused if one side of the array sees them nearer than the other side by more than this."""

LARGEST_SHAPE_M = 0.03
"""Targets are refused if the root mean square of the blocks' departures from a wall, seen through a curved field, is
larger."""


@dataclass(frozen=True, eq=False)
class TargetMean:
    """The mean frame of one flat target, without dark offsets.

    `volts` is complex128 (H, Y, X), NaN in pixels that cannot be used; `noise_v`, (H,), is the mean's standard
    deviation per channel.
    """

    volts: Complex
    noise_v: Float
    distance_m: float


def fit_response(targets: Sequence[TargetMean], /, *, metadata: CaptureMetadata, origin: Origin) -> ResponseCalibration:
    """Return the response that fits all targets, with as many terms as the distances of the targets can determine.

    Raises:
        SettingsError: too few pixels see every target; or the targets are not flat walls that face the camera.
    """
    known_optics = metadata.optics.focal_length_px is not None
    per_metre = wall_range_m(metadata.optics, origin.pixels, distance_m=1.0) if known_optics else np.ones(origin.pixels)
    ranges = np.stack([target.distance_m * per_metre.ravel() for target in targets])
    lamp = LampBeside.of(metadata.optics, origin.pixels)
    phase = (ranges if lamp is None else lamp.half_way_m(ranges)) / metres_per_radian(origin.periods_ns[0])
    volts = np.stack([target.volts.reshape(len(origin.harmonics), -1) for target in targets])
    noise = np.stack([target.noise_v for target in targets])
    seen = _seen(volts, noise)
    usable = np.asarray(seen.all(axis=0))
    every = Observations(volts, noise, phase, origin.harmonics)
    observed = every[usable]
    ideal = ideal_response(metadata)
    base = [{k: g / response.main for k, g in response.terms if k != 1} for response in ideal]
    distances = sorted({target.distance_m for target in targets})
    distinct = 1 + sum(b - a > SAME_DISTANCE_M for a, b in itertools.pairwise(distances))
    terms = fit_terms(observed[:: max(1, usable.sum() // TERM_PIXELS)], base, distances=distinct)
    pixels = fit_pixels(observed, terms.terms)
    _require_light(pixels)
    _require_one_response(pixels, usable.reshape(origin.pixels), origin, metadata.optics)
    phase, log_gain = _of_all_pixels(every, seen, pixels, terms.terms)
    findings = [*terms.findings, *_assumptions(seen, known_optics)]
    findings += _other_distances(targets, terms)
    curvature, errors = _curvature(pixels, usable, metadata, origin) if known_optics else ((0.0, 0.0), (0.0, 0.0))
    if any(curvature):
        added_m = curvature_m(origin.pixels, metadata.optics.principal_point(origin.pixels), curvature).ravel()
        added_rad = added_m / metres_per_radian(origin.periods_ns[0])
        phase -= np.array(origin.harmonics, np.float64)[:, np.newaxis] * added_rad
        findings.append(
            f"field curvature k2 = {curvature[0]:.4f} m, k4 = {curvature[1]:.4f} m was removed from the phase maps: `resolve` "
            "corrects it by itself, or uses the field curvature of `calibrate petzval` instead"
        )
    if terms.residual > LARGEST_RESIDUAL:
        findings.append(
            f"warning: the residual is {terms.residual:.1f} times the noise: is the dark calibration in the folder, are the "
            "distances right, and is the target flat, still and without multi-path interference?"
        )
    offset = max(abs(one.get(0, 0.0)) for one in terms.terms)
    if offset > LARGEST_OFFSET:
        findings.append(
            f"warning: k = 0 is {offset:.2g} of k = 1, an offset in proportion to the laser's light: offsets that drifted since "
            "calibrate dark, a dirty window or stray light look like that, and this response then makes depths of other scenes "
            "wrong by decimetres. Repeat calibrate dark and this step at one temperature, with a clean window"
        )
    quality = _quality(pixels, terms, tuple(distances), errors, tuple(findings))
    responses, phases, gains = _terms_and_maps(phase, log_gain, seen, terms.terms, ideal)
    shape = (len(ideal), *origin.pixels)
    return ResponseCalibration(
        origin,
        responses,
        phases.reshape(shape),
        gains.reshape(shape),
        curvature,
        metadata.optics.principal_point(origin.pixels),
        quality,
        metadata.optics.lamp_offset_m or ResponseCalibration.lamp_offset_m,
    )


def _seen(volts: Complex, noise: Float) -> Bool:
    """Return in which pixels each target gives a signal, (N, n)."""
    with np.errstate(invalid="ignore"):
        seen = (np.abs(volts) > LEAST_SIGNAL * noise[:, :, np.newaxis]).all(axis=1)
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
    where = np.asarray(seen.any(axis=0) & ~seen.all(axis=0))
    for kind in np.unique(seen[:, where], axis=1).T:
        alike = where & (seen == kind[:, np.newaxis]).all(axis=0)
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


def _curvature(
    pixels: PixelFit, usable: Bool, metadata: CaptureMetadata, origin: Origin
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the field curvature (k2, k4) in the phases, and its standard errors.

    Curvature that is not significant is returned as 0. Its standard errors say how large it may be.
    The lens delays all harmonics alike, and so does a delay of the pixel. They are told apart by the shape over the
    array: the delay of the lens is a polynomial in the distance from the principal point.
    """
    point = metadata.optics.principal_point(origin.pixels)
    squared = squared_field_radius(origin.pixels, point).ravel()[usable]
    harmonics = np.array(origin.harmonics, np.float64)[:, np.newaxis]
    centred = np.angle(np.exp(1j * pixels.phase) / _mean_rotor(pixels.phase)[:, np.newaxis])
    weights = pixels.weights.sum(axis=0)
    information = (weights * harmonics**2).sum(axis=0)
    metres = metres_per_radian(origin.periods_ns[0])
    ranges = metres * (weights * harmonics * centred).sum(axis=0) / information
    sigma = metres / np.sqrt(information)
    rows, columns = np.divmod(np.flatnonzero(usable), origin.pixels[1])
    shapes = np.stack([squared, squared**2, np.ones_like(squared), columns, rows], axis=1)
    shapes[:, 3:] /= max(origin.pixels)

    # an array of one row or one column shows no lean across it
    free = np.ptp(shapes, axis=0) > 0.0
    free[2] = True

    def residual(parameters: Float) -> tuple[Float, Float]:
        return (ranges - shapes @ parameters) / sigma, shapes[:, free] / sigma[:, np.newaxis]

    fit = robust_fit(residual, np.zeros(5), free=free)
    _require_flat(fit, sigma, usable.reshape(origin.pixels))
    (k2, k4), (k2_stderr, k4_stderr) = fit.parameters[:2].tolist(), np.sqrt(np.diag(fit.covariance)[:2]).tolist()
    if abs(k2) <= CURVATURE_SIGNIFICANCE * k2_stderr and abs(k4) <= CURVATURE_SIGNIFICANCE * k4_stderr:
        return (0.0, 0.0), (k2_stderr, k4_stderr)
    return (k2, k4), (k2_stderr, k4_stderr)


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


def _require_flat(fit: RobustFit, sigma: Float, where: Bool) -> None:
    """Make sure that the maps of phase and gain show no object of the scene: it would change every corrected frame."""
    lean = float(np.hypot(*fit.parameters[3:]))
    # pixels differ in their own delays, so a few rows seem to lean by chance
    error = float(np.sqrt(fit.parameters[3:] @ fit.covariance[3:, 3:] @ fit.parameters[3:])) / lean if lean else 0.0
    shape = shape_rms(fit.residual * sigma, where)
    if lean > LARGEST_LEAN_M + SURE * error:
        raise SettingsError(
            f"one side of the array sees the targets {1000 * lean:.0f} mm nearer than the other, expected "
            f"{1000 * LARGEST_LEAN_M:.0f} mm at most: the targets do not face the camera, or light comes by other ways on one "
            "side (MPI: floor, side walls). Point the camera square at a plain wall, clear the sides, and record again"
        )
    if shape > LARGEST_SHAPE_M:
        raise SettingsError(
            f"the targets have a shape: parts of the array deviate from a flat wall by {1000 * shape:.0f} mm, expected "
            f"{1000 * LARGEST_SHAPE_M:.0f} mm at most: they are not flat, something stands before them, or light comes by "
            "other ways (MPI). Take a plain wall that fills the view, and record again"
        )


def _mean_rotor(phase: Float) -> Complex:
    """Return the mean phase of pixels, (…, n), as a rotor."""
    total = np.exp(1j * phase).sum(axis=-1)
    return np.asarray(total / np.abs(total))


def _quality(
    pixels: PixelFit,
    terms: TermFit,
    distances: tuple[float, ...],
    curvature_stderr_m: tuple[float, float],
    findings: tuple[str, ...],
) -> ResponseQuality:
    weights = pixels.weights
    information = weights.sum(axis=0)
    against_first = [(1.0 / (1.0 / weights[:, 0] + 1.0 / one)).sum(axis=0) for one in np.moveaxis(weights, 1, 0)]
    gain = [0.0] + [float(np.median(one**-0.5)) for one in against_first[1:]]
    return ResponseQuality(
        distances_m=distances,
        residual=terms.residual,
        phase_stderr_rad=tuple(float(np.median(one**-0.5)) for one in information),
        gain_stderr=tuple(gain),
        term_stderr=terms.stderr,
        curvature_stderr_m=curvature_stderr_m,
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
        rotor = _mean_rotor(own[row, usable])
        gains = np.exp(log_gain[row]) * nominal
        middle = float(np.median(gains[usable]))
        phase[row, known] = np.angle(np.exp(1j * own[row, known]) / rotor)
        gain[row, known] = gains[known] / middle
        higher = [(k, middle * value * complex(rotor) ** k) for k, value in terms[row].items()]
        responses.append(HarmonicResponse(response.harmonic, ((1, middle * complex(rotor)), *higher)))
    return tuple(responses), phase, gain
