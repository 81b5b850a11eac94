"""Stored values → phasors where every pixel has an offset, a gain and a delay of its own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32, Stored
from cadtof_cli.phasors.response import HarmonicResponse


@dataclass(frozen=True)
class PixelCorrection:
    """A real affine map a pixel and harmonic: Re p and Im p from the stored SC1 and SC2.

    `matrix` is float64 (H, 2, 2, n), row by row, and `constant` float64 (H, 2, n).
    """

    matrix: Float
    constant: Float


def pixel_correction(
    responses: Sequence[HarmonicResponse],
    /,
    *,
    volts_per_count: float,
    zero_counts: float,
    amplitude_v: float,
    offset_v: Float | Float32 | None,
    phase_rad: Float | None,
    gain: Float | Float32 | None,
    pixels: int,
) -> PixelCorrection:
    """Return the maps that take out offset, gain, imbalance and phase, in this order.

    Args:
        responses: of every harmonic; the terms k = ±1 are inverted here, exactly.
        volts_per_count: of the stored values.
        zero_counts: stored value of 0 V.
        amplitude_v: modulation amplitude that phasors are counted in.
        offset_v: (H, 2, n) V, what the pixel shows without light.
        phase_rad: (H, n), what the pixel adds to the phase of every path at that harmonic.
        gain: (H, n), by which the pixel multiplies.
        pixels: n.
    """
    matrix = np.empty((len(responses), 2, 2, pixels))
    constant = np.empty((len(responses), 2, pixels))
    for row, response in enumerate(responses):
        turn = np.ones(pixels, np.complex128) if phase_rad is None else np.exp(-1j * phase_rad[row].astype(np.float64))
        scale = turn / amplitude_v if gain is None else turn / (amplitude_v * gain[row].astype(np.float64))
        for column, unit in enumerate((1.0 + 0.0j, 1.0j)):
            answer = scale * response.without_mirror(np.array(unit))
            matrix[row, 0, column], matrix[row, 1, column] = answer.real, answer.imag
        offset = np.zeros((2, 1)) if offset_v is None else offset_v[row].astype(np.float64)
        shift = offset + zero_counts * volts_per_count
        constant[row] = -(matrix[row, :, 0] * shift[0] + matrix[row, :, 1] * shift[1])
    return PixelCorrection(matrix * volts_per_count, constant)


def corrected_phasors(stored: Stored, /, *, correction: PixelCorrection, block: slice) -> Complex:
    """Return normalised phasors, complex128 (H, n), of the pixels of one block, stored as (H, 2, n); NaN stays NaN."""
    phasors = np.empty((stored.shape[0], stored.shape[2]), np.complex128)
    term = np.empty(stored.shape[2])
    for row, phasor in enumerate(phasors):
        first, second = stored[row].astype(np.float64, copy=False)
        for index, part in enumerate((phasor.real, phasor.imag)):
            matrix = correction.matrix[row, index, :, block]
            np.multiply(first, matrix[0], out=part)
            np.multiply(second, matrix[1], out=term)
            part += term
            part += correction.constant[row, index, block]
    return phasors
