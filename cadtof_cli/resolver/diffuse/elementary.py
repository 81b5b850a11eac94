"""Logarithm, exponential, rotor and phase in single precision, by polynomials of our own.

Those of C libraries and of numpy's vectorised loops differ in their last bits. Additions, products, quotients and
square roots of IEEE 754 do not. `_elementary.h` holds the same operations in the same order, so that pixels get the
same bits from numpy and from C. All are right to 2e-7 of their value or of 1, a thousandth of the noise of any frame.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float32

LOGARITHM = (0.33333343, 0.19994386, 0.147902)
"""artanh s = s + s·z·Σ_k LOGARITHM[k]·z^k with z = s², |s| ≤ .1716. This polynomial, like all others here, goes through
the function at Chebyshev's nodes."""

EXPONENTIAL = (0.5, 0.16666578, 0.041666556, 0.008363173, 0.0013926176)
"""exp r = 1 + r + r²·Σ_k EXPONENTIAL[k]·r^k, |r| ≤ ½·ln 2."""

SINE = (-0.16666666, 0.0083332425, -0.0001982274, 2.6347564e-06)
"""sin r = r + r·z·Σ_k SINE[k]·z^k with z = r², |r| ≤ π/2."""

COSINE = (0.041666668, -0.0013888812, 2.4786083e-05, -2.6546067e-07)
"""cos r = 1 − ½·z + z²·Σ_k COSINE[k]·z^k with z = r², |r| ≤ π/2."""

ARCTANGENT = (-0.3333333, 0.19998683, -0.14257045, 0.108657576, -0.08009682, 0.04891432, -0.020027727, 0.0038677573)
"""arctan t = t + t·z·Σ_k ARCTANGENT[k]·z^k with z = t², |t| ≤ 1; the last digits are such that arctan 1 is π/4."""

LN_2 = (0.693359375, -0.00021219444)
"""ln 2 in two parts: a number of few digits, whose product with a small integer is exact, and the rest."""

HALF_TURN = (3.140625, 0.00096765359)
"""π in the same two parts."""

HALF_ROOT_BITS = 0x3F3504F3
"""The bits of √½ as an integer: mantissas lie between √½ and √2."""

MANTISSA_BITS = 23

SIGN_BIT = np.uint32(1 << 31)

LARGEST_EXPONENT = 80.0
"""Largest exponent; one beyond it has no meaning here, but gives the same answer everywhere."""

LARGEST_PHASE = 1e4
"""Largest phase, in rad; one beyond it has no meaning here, but gives the same answer everywhere."""

Array = Any
"""float32 (…). numpy's stubs take such an array times a Python number for float64, which it is not."""

TINY = np.float32(np.finfo(np.float32).tiny)


def logarithm(x: Float32, /) -> Float32:
    """Return ln x for positive, finite x, (…)."""
    bits = x.view(np.int32)
    power = (bits - HALF_ROOT_BITS) >> MANTISSA_BITS
    mantissa: Array = (bits - (power << MANTISSA_BITS)).view(np.float32)
    half = _odd(LOGARITHM, (mantissa - 1.0) / (mantissa + 1.0))
    n: Array = power.astype(np.float32)
    found: Float32 = n * LN_2[0] + (n * LN_2[1] + (half + half))
    return found


def exponential(x: Float32, /) -> Float32:
    """Return exp x, (…); NaN stays NaN."""
    n: Array = np.rint(np.fmin(np.fmax(x, -LARGEST_EXPONENT), LARGEST_EXPONENT) * np.float32(1.0 / np.log(2.0)))
    r = x - n * LN_2[0] - n * LN_2[1]
    mantissa = _series(EXPONENTIAL, r)
    mantissa *= r * r
    mantissa += r
    mantissa += 1.0
    found: Float32 = mantissa * ((n.astype(np.int32) + 127) << MANTISSA_BITS).view(np.float32)
    return found


def rotor(phase_rad: Float32, /) -> tuple[Float32, Float32]:
    """Return cosine and sine of phases, (…) each; NaN stays NaN."""
    n: Array = np.rint(np.fmin(np.fmax(phase_rad, -LARGEST_PHASE), LARGEST_PHASE) * np.float32(1.0 / np.pi))
    r = phase_rad - n * HALF_TURN[0] - n * HALF_TURN[1]
    z = r * r
    cos = _series(COSINE, z)
    cos *= z * z
    cos -= 0.5 * z
    cos += 1.0
    odd = n.astype(np.int32).view(np.uint32) << 31
    return _negated(cos, odd), _negated(_odd(SINE, r), odd)


def phase_of(cos: Float32, sin: Float32, /) -> Float32:
    """Return the phase of cos + i·sin, of any length but 0, in [−π, π] rad, (…). NaN stays NaN."""
    x, y = np.abs(cos), np.abs(sin)
    tangent: Array = y - x
    tangent /= np.maximum(x + y, TINY)
    from_diagonal: Array = np.float32(0.25 * np.pi) - _odd(ARCTANGENT, tangent)
    phase: Array = np.float32(0.5 * np.pi) - _negated(from_diagonal, cos.view(np.uint32) & SIGN_BIT)
    return _negated(phase, sin.view(np.uint32) & SIGN_BIT)


def _negated(x: Float32, sign: Any) -> Float32:
    """Return x, negated if the first bit of `sign`, uint32, is set: several times faster than a choice."""
    found: Float32 = (x.view(np.uint32) ^ sign).view(np.float32)
    return found


def _odd(coefficients: Sequence[float], x: Array) -> Array:
    """Return x + x·z·Σ_k coefficients[k]·z^k with z = x²."""
    z = x * x
    total = _series(coefficients, z)
    total *= z
    total *= x
    total += x
    return total


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
