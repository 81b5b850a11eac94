"""The phase of a rotor, by a polynomial of our own: the same bits from numpy here and from the kernel in C, on any machine.

Arctangents of C libraries and of numpy's vectorised loops differ in their last bits. Additions, products, quotients and square
roots of IEEE 754 do not, so phases come from those alone. `_kernel_paths.h` holds the same operations in the same order.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.paths import FULL_TURN

TAN_EIGHTH = 0.41421356237309503
"""tan(π/8): steeper tangents are turned back by π/4, so that the polynomial is needed up to here only."""

COEFFICIENTS = (
    -0.3333333333333333,
    0.1999999999999552,
    -0.14285714284666542,
    0.11111111015256361,
    -0.09090904578123873,
    0.07692183190825433,
    -0.06664511447372731,
    0.058581489127221394,
    -0.0508544973752125,
    0.03923165828348216,
    -0.019176887104237525,
)
"""arctan t = t + t·z·Σ_k COEFFICIENTS[k]·z^k with z = t², |t| ≤ tan(π/8), to 8e-18 of its value: the polynomial through
(arctan(√z)/√z − 1)/z at Chebyshev's 11 nodes between 0 and tan²(π/8)."""


def phase_of(cos: Float, sin: Float, /) -> Float:
    """Return the phase of cos + i·sin, (n,) each and of any length but 0, in [0, 2π) rad; NaN in gives NaN out."""
    x, y = np.abs(cos), np.abs(sin)
    steep = y > x
    low, high = np.where(steep, x, y), np.where(steep, y, x)
    far = low > high * TAN_EIGHTH
    tangent = np.where(far, low - high, low) / np.where(far, low + high, high)
    z = tangent * tangent
    series = np.full_like(z, COEFFICIENTS[-1])
    for coefficient in reversed(COEFFICIENTS[:-1]):
        series = series * z + coefficient
    phase = tangent + tangent * z * series
    phase = np.where(far, phase + 0.25 * np.pi, phase)
    phase = np.where(steep, 0.5 * np.pi - phase, phase)
    phase = np.where(cos < 0.0, np.pi - phase, phase)
    phase = np.where(sin < 0.0, FULL_TURN - phase, phase)
    return np.where(phase >= FULL_TURN, 0.0, phase)
