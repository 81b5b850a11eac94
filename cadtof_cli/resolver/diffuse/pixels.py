"""The answer of a pixel: its own data, conditioned through the linear model of the tail that its patches give.

Every pixel is computed alone, by the same operations wherever it stands, so blocks of any size give the same bits. From
the data on, precision is single; its rounding is a thousandth of their noise. `_pixels.h` is the compiled twin, and this
module is its front.
"""

from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.condition import conditioned
from cadtof_cli.resolver.diffuse.elementary import exponential, logarithm, phase_of, rotor, within_a_turn
from cadtof_cli.resolver.diffuse.light import LARGEST_AMPLITUDE
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.records import DiffuseModel, DiffusePixels, PixelTails
from cadtof_cli.resolver.diffuse.settings import NEAREST_M, range_from_phase
from cadtof_cli.resolver.diffuse.tail import residuals
from cadtof_cli.resolver.diffuse.upsampling import row_above
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous, extension, is_compiled_for
from cadtof_cli.resolver.two_path.kernel import Buffers

if TYPE_CHECKING:
    from cadtof_cli.resolver.response.table import ResponseBlock

LEAST_AMPLITUDE = 0.1
"""Floor for |p_1| in a pixel's data and their noise, in standard deviations of the noise of p_1. Fainter pixels have no
answer."""

LEAST_HARMONIC = 1.0
"""Floor for |p_h| in a pixel's data and their noise, in standard deviations of the noise of p_h: a phasor that is all
noise has a phase that is known to about a radian."""

LEAST_SHARE = 0.05
"""Least variance of the direct phase, over that of arg p_1: a tail cannot cancel the noise of the data."""

USUAL_MISFIT, MISFIT_PER_DATUM = 2.0, 1.5
"""Up to 2 + 1.5 · (number of data), a pixel's χ² is taken as usual: noise alone exceeds it in a twelfth of the pixels. Beyond,
the pixel contradicts the tail of its patches, as at edges of surfaces and in mirrors. Its variance then grows as χ²."""

UNKNOWN_PHASE_RAD = np.pi / np.sqrt(3.0)
"""Standard deviation of a phase of which nothing is known."""


@dataclass(frozen=True, eq=False)
class PixelData:
    """The data of n pixels.

    Attributes:
        amplitude: |p_1|, (n,).
        phase_rad: arg p_1, (n,).
        data: ln|p_h/p_1| and arg p_h − h·arg p_1, (data, n).
        relative_noise: σ²/|p_h|² of every harmonic, (n,) each.
    """

    amplitude: Float32
    phase_rad: Float32
    data: Float32
    relative_noise: list[Float32]


def diffuse_pixels(
    phasors: Complex, /, *, model: DiffuseModel, first: int, usable: Bool, samples: Float | None = None
) -> DiffusePixels:
    """Return the answers of consecutive pixels by their frame's model; inputs are not changed.

    Args:
        phasors: (H, n), normalised by the modulation amplitude and corrected for the pulse.
        model: that of the frame.
        first: flat index of the first of these pixels.
        usable: (n,); all other pixels get NaN.
        samples: number of recorded pixels that each phasor is a mean of, (n,); None: 1.
    """
    if is_compiled_for(len(model.settings.harmonics)):
        return _by_kernel(phasors, model, first, usable, samples)
    pixels = slice(first, first + usable.size)
    with np.errstate(over="ignore"):
        re, im = phasors.real.astype(np.float32), phasors.imag.astype(np.float32)
        square = re * re + im * im
    answered = usable & (square < LARGEST_AMPLITUDE**2).all(axis=0) & (square[0] > 0.0)
    if model.separate.any():
        answered &= ~model.is_separate(pixels)
    re, im, square = (np.where(answered, part, np.float32(np.nan)) for part in (re, im, square))
    seen = _pixel_data(phase_of(re, im), square, model, samples)
    planes = model.upsampler.joint(pixels, _first_range(seen.phase_rad, model, pixels))
    count = model.coarse.data
    means, entries = planes[: count + 2], dict(zip(model.coarse.entries, planes[count + 2 :], strict=False))
    for entry, value in noise_covariance(seen.relative_noise, harmonics=model.settings.harmonics).items():
        if entry in entries:
            entries[entry] = entries[entry] + value
    posterior = conditioned(list(residuals(seen.data, means[:count])), entries)
    shrink, lag = exponential(-(means[count] + posterior.shifts[0])), means[count + 1] + posterior.shifts[1]
    floor = np.float32(LEAST_SHARE) * seen.relative_noise[0]
    misfit = np.maximum(posterior.chi_squared / np.float32(USUAL_MISFIT + MISFIT_PER_DATUM * count), np.float32(1.0))
    direct = _direct(seen, shrink, lag, (np.maximum(posterior.covariance[1, 1], floor) + planes[-2]) * misfit)
    mpi = _mpi(seen, direct[1], shrink, lag, planes[-1], misfit)
    return DiffusePixels(answered, *direct, *mpi, posterior.chi_squared)


def pixels_of_sine(
    phasors: Complex,
    /,
    *,
    model: DiffuseModel,
    first: int,
    response: "ResponseBlock",
    samples: Float | None = None,
) -> tuple[Complex, Float]:
    """Return what a sine would have recorded of pixels, (H, n), and a number of recorded pixels for each, (n,).

    The result for a pixel has the noise of a mean over that number of recorded pixels. `first` is the flat index of the
    first of these consecutive pixels. The model is not that of a sine.
    """
    from cadtof_cli.resolver.diffuse.other_terms import freed_of_other_terms
    from cadtof_cli.resolver.response.as_sine import first_phase

    assert model.terms is not None
    alone, pixels = first_phase(phasors[0], response=response), slice(first, first + phasors.shape[1])
    planes = model.terms.upsampler.joint(pixels, _first_range(alone.astype(np.float32), model, pixels))
    tails = PixelTails.of(planes, model.terms.harmonics)
    sine, more = freed_of_other_terms(phasors, tails, response=response, alone_rad=alone)
    return sine, (1.0 if samples is None else samples) / more.astype(np.float64)


def _by_kernel(phasors: Complex, model: DiffuseModel, first: int, usable: Bool, samples: Float | None) -> DiffusePixels:
    answered, rows = np.empty(usable.size, np.bool_), np.empty((7, usable.size), np.float32)
    given = contiguous(phasors, usable, samples)
    extension().answer_tail(chosen_kernel(), *given, answered, rows, *tail_buffers(model, first))
    return DiffusePixels(answered, *rows)


def tail_buffers(model: DiffuseModel, first: int, /) -> Buffers:
    """Return the model of a frame for pixels from the flat index `first` on, as buffers for the compiled twin."""
    compiled = extension()
    up, settings = model.upsampler, model.settings
    height, width = up.grid.height, up.grid.width
    rows, columns = up.range_m.shape
    sizes = {"first": first, "height": height, "width": width, "side": up.grid.side, "left": up.first}
    sizes |= {"rows": rows, "columns": columns, "harmonics": len(settings.harmonics)}
    constants = {"separate_variance": model.separate_variance, "metres": settings.m_per_rad}
    offset = model.range_offset_m
    return (
        np.array([sizes[name] for name in compiled.tail_sizes()], np.int64),
        np.array([constants[name] for name in compiled.tail_constants()]),
        np.array(settings.harmonics, np.int64),
        np.array(model.variances),
        *contiguous(up.planes, up.range_m),
        up.down,
        up.right,
        np.asarray(row_above(np.arange(height), up.grid.side), np.int64),
        np.ascontiguousarray(model.separate) if model.separate.any() else None,
        None if offset is None else np.ascontiguousarray(offset, np.float64),
    )


def _direct(seen: PixelData, shrink: Float32, lag: Float32, variance: Float32) -> tuple[Float32, Float32, Float32]:
    """Return amplitude, phase and sigma of p_1/H_1; `shrink` is 1/|H_1|."""
    return seen.amplitude * shrink, within_a_turn(seen.phase_rad - lag), np.sqrt(variance)


def _mpi(
    seen: PixelData, direct_rad: Float32, shrink: Float32, lag: Float32, variance: Float32, misfit: Float32
) -> tuple[Float32, Float32, Float32]:
    """Return amplitude, phase and sigma of the MPI light's phasor, p_1·(1 − 1/H_1); its phase follows the direct one. The
    variance is `misfit` times as large as usual."""
    cos, sin = rotor(lag)
    re, im = 1.0 - shrink * cos, shrink * sin
    sigma = np.sqrt((np.maximum(variance, 0.0) + seen.relative_noise[0]) * misfit)
    return (
        seen.amplitude * np.sqrt(re * re + im * im),
        direct_rad + within_a_turn(phase_of(re, im) + lag),
        np.minimum(sigma, np.float32(UNKNOWN_PHASE_RAD)),
    )


def _pixel_data(phases: Float32, square: Float32, model: DiffuseModel, samples: Float | None) -> PixelData:
    """Return the data of pixels from the phases and squared amplitudes of their phasors, (H, n)."""
    over = 1.0 if samples is None else samples
    variances = [np.asarray(variance / over, np.float32) for variance in model.variances]
    first = np.maximum(square[0], np.float32(LEAST_AMPLITUDE**2) * variances[0])
    relative = [variances[0] / first]
    count = len(phases) - 1
    data = np.empty((2 * count, first.size), np.float32)
    for i, h in enumerate(model.settings.harmonics[1:]):
        power = np.maximum(square[i + 1], np.float32(LEAST_HARMONIC**2) * variances[i + 1])
        data[i] = np.float32(0.5) * logarithm(power / first)
        data[count + i] = phases[i + 1] - np.float32(h) * phases[0]
        relative.append(variances[i + 1] / power)
    return PixelData(np.sqrt(square[0]), phases[0], data, relative)


def _first_range(phase_rad: Float32, model: DiffuseModel, pixels: slice, /) -> Float32:
    """Return the ranges of pixels by the lag of the nearest patches: good enough to tell surfaces apart."""
    lag = model.upsampler.linear(model.coarse.data + 1, pixels)
    range_m = range_from_phase(phase_rad - lag, model.settings) + model.range_offset(pixels)
    return np.asarray(np.maximum(range_m, np.float32(NEAREST_M)))
