"""A pixel's answer: its own data through its patches' linear model of the tail.

Elementwise throughout, by rectangles between rows of patches, so that blocks of any size give the same bits.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.resolver.diffuse.condition import conditioned
from cadtof_cli.resolver.diffuse.light import LARGEST_AMPLITUDE
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.records import DiffuseBlock, DiffuseModel, DiffusePixels
from cadtof_cli.resolver.diffuse.tail import Values, residuals, wrapped
from cadtof_cli.resolver.diffuse.upsampling import Band

FULL_TURN = 2.0 * np.pi

LEAST_AMPLITUDE = 0.1
"""Least |p_1| in standard deviations of its noise that the noise of its data is taken for; fainter pixels have no answer."""

LEAST_HARMONIC = 1.0
"""The same for |p_h|: where it is all noise, its phase is known to about a radian."""

LEAST_SHARE = 0.05
"""Least variance of the direct phase, as a share of that of arg p_1: a tail cannot cancel the noise of the data."""

UNKNOWN_PHASE_RAD = np.pi / np.sqrt(3.0)
"""Standard deviation of a phase of which nothing is known."""

NEAREST_M = 0.05
"""Least range: the range of a pixel with the phase 0."""


@dataclass(frozen=True, eq=False)
class PixelData:
    """What pixels (rows, columns) were seen at: |p_1| and arg p_1, float64; their data, float32 (data, …); σ²/|p_h|²."""

    amplitude: Float
    phase_rad: Float
    data: Float32
    relative_noise: list[Float32]


def diffuse_pixels(
    phasors: Complex, /, *, tail: DiffuseBlock, usable: Bool, samples: Float | None = None
) -> DiffusePixels:
    """Return the answers of the pixels that a block of a frame's model is for; inputs are not changed.

    Args:
        phasors: (H, n), normalised by the modulation amplitude and corrected for the pulse.
        tail: the frame's model, and which of its pixels these are.
        usable: (n,); the others get NaN.
        samples: over how many recorded pixels each phasor is a mean, (n,); None: 1.
    """
    answer = DiffusePixels.empty(usable.size, tail.model.separate_variance)
    model, pixels = tail.model, tail.pixels
    start = pixels.start
    for band in model.upsampler.bands(pixels):
        count = band.shape[0] * band.shape[1]
        chosen = slice(start - pixels.start, start - pixels.start + count)
        _fill(
            answer[chosen],
            phasors[:, chosen].reshape(-1, *band.shape),
            model,
            band,
            usable[chosen].reshape(band.shape),
            None if samples is None else samples[chosen].reshape(band.shape),
        )
        start += count
    return answer


def _fill(
    answer: DiffusePixels, phasors: Complex, model: DiffuseModel, band: Band, usable: Bool, samples: Float | None
) -> None:
    """Write the answer of a band's pixels, phasors (H, rows, columns)."""
    with np.errstate(over="ignore"):
        square = phasors.real**2 + phasors.imag**2
    answered = usable & (square < LARGEST_AMPLITUDE**2).all(axis=0) & (square[0] > 0.0)
    if model.separate.any():
        answered &= ~model.is_separate(band)
    every = bool(answered.all())
    if not every:
        phasors, square = np.where(answered, phasors, 1.0), np.where(answered, square, 1.0)
    seen = _pixel_data(phasors, square, model, samples)
    planes = model.upsampler.joint(band, _first_range(seen.phase_rad, model, band))
    count = model.coarse.data
    means, entries = planes[: count + 2], dict(zip(model.coarse.entries, planes[count + 2 :], strict=False))
    for entry, value in noise_covariance(seen.relative_noise, harmonics=model.settings.harmonics).items():
        if entry in entries:
            entries[entry] = entries[entry] + value
    left = conditioned(list(residuals(seen.data, means[:count])), entries, targets=2)
    shrink, lag = np.exp(-(means[count] + left.shifts[0])), means[count + 1] + left.shifts[1]
    floor = np.float32(LEAST_SHARE) * seen.relative_noise[0]
    answer.answered[:], answer.chi_squared[:] = answered.ravel(), left.chi_squared.ravel()
    _write_direct(answer, seen, shrink, lag, np.maximum(left.covariance[1, 1], floor) + planes[-2])
    _write_mpi(answer, seen, shrink, lag, planes[-1])
    if not every:
        answer.clear(~answer.answered)


def _write_direct(answer: DiffusePixels, seen: PixelData, shrink: Float32, lag: Float32, variance: Float32) -> None:
    """Write p_1/H_1; `shrink` is 1/|H_1|."""
    answer.direct_amplitude[:] = (seen.amplitude * shrink).ravel()
    answer.direct_phase_rad[:] = _within_a_turn(seen.phase_rad - lag).ravel()
    answer.direct_sigma_rad[:] = np.sqrt(variance).ravel()


def _write_mpi(answer: DiffusePixels, seen: PixelData, shrink: Float32, lag: Float32, variance: Float32) -> None:
    """Write p_1·(1 − 1/H_1), the phasor of the MPI light, its phase behind the direct one."""
    re, im = 1.0 - shrink * np.cos(lag), shrink * np.sin(lag)
    answer.mpi_amplitude[:] = (seen.amplitude * np.sqrt(re * re + im * im)).ravel()
    answer.mpi_phase_rad[:] = answer.direct_phase_rad + _within_a_turn(np.arctan2(im, re) + lag).ravel()
    sigma = np.sqrt(np.maximum(variance, 0.0) + seen.relative_noise[0])
    answer.mpi_sigma_rad[:] = np.minimum(sigma, np.float32(UNKNOWN_PHASE_RAD)).ravel()


def _pixel_data(phasors: Complex, square: Float, model: DiffuseModel, samples: Float | None) -> PixelData:
    """Return what phasors (H, rows, columns) and their squared amplitudes say of the tail."""
    variances = [v if samples is None else v / samples for v in model.variances]
    phase = np.arctan2(phasors[0].imag, phasors[0].real)
    first = np.maximum(square[0], LEAST_AMPLITUDE**2 * variances[0])
    relative = [(variances[0] / first).astype(np.float32)]
    count = len(phasors) - 1
    data = np.empty((2 * count, *phase.shape), np.float32)
    for i, (p, h) in enumerate(zip(phasors[1:], model.settings.harmonics[1:], strict=True)):
        further = np.maximum(square[i + 1], LEAST_HARMONIC**2 * variances[i + 1])
        data[i] = np.float32(0.5) * np.log((further / first).astype(np.float32))
        data[count + i] = wrapped(np.arctan2(p.imag, p.real) - h * phase)
        relative.append((variances[i + 1] / further).astype(np.float32))
    return PixelData(np.sqrt(square[0]), phase, data, relative)


def _within_a_turn(phase: Values, /) -> Values:
    """Return phases between −2π and 4π brought to [0, 2π)."""
    turn = phase.dtype.type(FULL_TURN)
    inside: Values = np.where(phase < 0.0, phase + turn, phase)
    np.subtract(inside, turn, out=inside, where=inside >= turn)
    return inside


def _first_range(phase_rad: Float, model: DiffuseModel, band: Band) -> Float32:
    """Return the ranges of pixels by the lag of the nearest patches, float32: good enough to tell surfaces apart."""
    lag = model.upsampler.linear(model.coarse.data + 1, band)
    range_m = model.range_m(phase_rad.astype(np.float32) - lag) + model.range_offset(band)
    return np.asarray(np.maximum(range_m, NEAREST_M), np.float32)
