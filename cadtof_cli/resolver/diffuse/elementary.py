"""Logarithm, exponential, rotor and phase in single precision, by polynomials of our own.

Those of C libraries and of numpy's vectorised loops differ in their last bits; additions, products, quotients and square roots of
IEEE 754 do not. `_elementary.h` holds the same operations in the same order, so that pixels get the same bits from numpy and from
C. All are right to 2e-7 of their value or of 1, a thousandth of the noise of any frame.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float32

LOGARITHM = (0.33333343, 0.19994386, 0.147902)
"""artanh s = s + s·z·Σ_k LOGARITHM[k]·z^k with z = s², |s| ≤ .1716: the polynomial through it at Chebyshev's nodes, as all."""

EXPONENTIAL = (0.5, 0.16666578, 0.041666556, 0.008363173, 0.0013926176)
"""exp r = 1 + r + r²·Σ_k EXPONENTIAL[k]·r^k, |r| ≤ ½·ln 2."""

SINE = (-0.16666664, 0.008332748, -0.0001958789)
"""sin r = r + r·z·Σ_k SINE[k]·z^k with z = r², |r| ≤ π/4."""

COSINE = (0.041666664, -0.0013888302, 2.4547942e-05)
"""cos r = 1 − ½·z + z²·Σ_k COSINE[k]·z^k with z = r², |r| ≤ π/4."""

ARCTANGENT = (-0.33333322, 0.19998682, -0.14257045, 0.10865759, -0.08009682, 0.04891432, -0.020026747, 0.0038667389)
"""arctan t = t + t·z·Σ_k ARCTANGENT[k]·z^k with z = t², |t| ≤ 1."""

LN_2 = (0.693359375, -0.00021219444)
"""ln 2 as a number of few digits, whose product with a small integer is exact, and the rest."""

QUARTER_TURN = (1.5703125, 0.00048375130, 7.5497900e-08)
"""π/2 in the same way."""

HALF_ROOT_BITS = 0x3F3504F3
"""√½ as its bits are counted: mantissas are taken from here to √2."""

MANTISSA_BITS = 23

SIGN_BIT = 31

SIGN_FROM_2 = 30
"""By how much a bit that stands for 2 is shifted to stand for the sign."""

LARGEST_EXPONENT = 80.0
"""Exponents beyond this have no meaning here, but an answer that is the same everywhere."""

LARGEST_PHASE = 1e4
"""The same for phases, in rad."""

Array = Any
"""float32 (…): numpy's stubs take such an array times a Python number for float64, which it is not."""

TINY = np.float32(np.finfo(np.float32).tiny)


def logarithm(x: Float32, /) -> Float32:
    """Return ln x for positive, finite x, (…)."""
    bits = x.view(np.int32)
    power = (bits - HALF_ROOT_BITS) >> MANTISSA_BITS
    mantissa: Array = (bits - (power << MANTISSA_BITS)).view(np.float32)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    half = s + s * z * _series(LOGARITHM, z)
    n: Array = power.astype(np.float32)
    found: Float32 = n * LN_2[0] + (n * LN_2[1] + (half + half))
    return found


def exponential(x: Float32, /) -> Float32:
    """Return exp x, (…); NaN stays NaN."""
    n: Array = np.rint(np.fmin(np.fmax(x, -LARGEST_EXPONENT), LARGEST_EXPONENT) * np.float32(1.0 / np.log(2.0)))
    r = x - n * LN_2[0] - n * LN_2[1]
    mantissa = r + r * r * _series(EXPONENTIAL, r) + 1.0
    found: Float32 = mantissa * ((n.astype(np.int32) + 127) << MANTISSA_BITS).view(np.float32)
    return found


def rotor(phase_rad: Float32, /) -> tuple[Float32, Float32]:
    """Return cosine and sine of phases, (…) each; NaN stays NaN."""
    n: Array = np.rint(np.fmin(np.fmax(phase_rad, -LARGEST_PHASE), LARGEST_PHASE) * np.float32(2.0 / np.pi))
    r = phase_rad - n * QUARTER_TURN[0] - n * QUARTER_TURN[1] - n * QUARTER_TURN[2]
    z = r * r
    sin = r + r * z * _series(SINE, z)
    cos = z * z * _series(COSINE, z) - 0.5 * z + 1.0
    quadrant = n.astype(np.int32)
    # swapped and negated as bits: several times faster than by choice
    cos_bits, sin_bits = cos.view(np.int32), sin.view(np.int32)
    swapped = (cos_bits ^ sin_bits) & -(quadrant & 1)
    cos_bits = (cos_bits ^ swapped) ^ (((quadrant + 1) & 2) << SIGN_FROM_2)
    sin_bits = (sin_bits ^ swapped) ^ ((quadrant & 2) << SIGN_FROM_2)
    return cos_bits.view(np.float32), sin_bits.view(np.float32)


def phase_of(cos: Float32, sin: Float32, /) -> Float32:
    """Return the phase of cos + i·sin, of any length, in [−π, π] rad, (…); that of 0 is 0. NaN stays NaN."""
    x, y = np.abs(cos), np.abs(sin)
    steep = y > x
    tangent: Array = np.minimum(x, y) / np.maximum(np.maximum(x, y), TINY)
    z = tangent * tangent
    phase = tangent + tangent * z * _series(ARCTANGENT, z)
    # differences from 0 or a quarter turn, from 0 or half a turn, and a sign: several times faster than by choice
    phase = np.abs(steep * np.float32(0.5 * np.pi) - phase)
    phase = np.abs((cos < 0.0) * np.float32(np.pi) - phase)
    signed: Float32 = (phase.view(np.uint32) ^ ((sin < 0.0).astype(np.uint32) << SIGN_BIT)).view(np.float32)
    return signed


def within_a_turn(phase: Float32, /) -> Float32:
    """Return phases between −2π and 4π brought to [0, 2π)."""
    turn = np.float32(2.0 * np.pi)
    inside = phase + (phase < 0.0) * turn
    return np.asarray(inside - (inside >= turn) * turn, np.float32)


def _series(coefficients: Sequence[float], z: Array) -> Array:
    """Return Σ_k coefficients[k]·z^k by Horner's rule."""
    last, before, *others = reversed(coefficients)
    total = z * last
    total += before
    for coefficient in others:
        total *= z
        total += coefficient
    return total
