"""The phase of a rotor, by a polynomial: numpy here and the kernel in C give the same bits, on any machine.

Arctangents of C libraries and of numpy's vectorised loops differ in their last bits. Sums and products of IEEE 754 do
not differ, so phases are computed from sums and products alone. A division is not needed, because the parts of a rotor
are its cosine and sine. `_arcsine.h` has the same operations in the same order.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.resolver.paths import FULL_TURN

SIN_TWELFTH = 0.25881904510252074
"""sin(π/12). Rotors with a larger sine are turned back by π/6, so that the polynomial covers only −π/12 to π/12."""

COS_SIXTH = 0.8660254037844386
"""cos(π/6); sin(π/6) is ½."""

COEFFICIENTS = (
    0.16666666666666652,
    0.07500000000029207,
    0.04464285705150488,
    0.03038195530554957,
    0.022371526870346412,
    0.017372651805504305,
    0.013621509253689112,
    0.01456748213483585,
)
"""arcsin s = s + s·z·Σ_k COEFFICIENTS[k]·z^k with z = s², |s| ≤ sin(π/12), with a relative error of 1.1e-17. The
polynomial interpolates (arcsin(√z)/√z − 1)/z at the 8 Chebyshev nodes between 0 and sin²(π/12)."""


def phase_of(cos: Float, sin: Float, /) -> Float:
    """Return the phase in [0, 2π) rad of the unit rotor cos + i·sin, (n,) each; NaN in gives NaN out.

    If rounding makes the length of the rotor 1 + ε instead of 1, the phase is off by less than ε.
    """
    x, y = np.abs(cos), np.abs(sin)
    steep = y > x
    low, high = np.where(steep, x, y), np.where(steep, y, x)
    far = low > SIN_TWELFTH
    sine = np.where(far, low * COS_SIXTH - high * 0.5, low)
    z = sine * sine
    series = np.full_like(z, COEFFICIENTS[-1])
    for coefficient in reversed(COEFFICIENTS[:-1]):
        series = series * z + coefficient
    phase = sine + sine * z * series
    phase = np.where(far, phase + np.pi / 6.0, phase)
    phase = np.where(steep, 0.5 * np.pi - phase, phase)
    phase = np.where(cos < 0.0, np.pi - phase, phase)
    phase = np.where(sin < 0.0, FULL_TURN - phase, phase)
    return np.where(phase >= FULL_TURN, 0.0, phase)
