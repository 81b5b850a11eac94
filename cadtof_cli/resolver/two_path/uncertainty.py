"""Predicted standard deviations of two resolved paths: the noise of the phasors carried through the inverse Jacobian."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.phasors.noise import HarmonicNoise, NoiseModel
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.resolver.two_path.closed_form import TwoPaths


def two_path_sigmas(paths: "TwoPaths", /, *, noise: NoiseModel) -> Float:
    """Return the standard deviations of x and y in rad, (2, n); infinite where a, b or x − y is 0.

    With D = y − x, c = cos D and s = sin D, the change of x is (α·q1 + β·q2)/a, where q_h is the noise of p_h turned back by
    h·x and · multiplies real with real and imaginary with imaginary parts:

        α = (−(1+c)s,  1+c+c²)/((1−c)(2+c)),   β = ((1+c)s,  ½−c−c²)/((1−c)(2+c))

    For white noise this is the Cramér–Rao bound, (σ/a)·√(13+20c+12c²)/(2(1−c)(2+c)). Here q_h has the covariance that
    the averaging gives for this mix of light: E|q|² = ε_h(1/r_h² − |z_h|²) and E q² = ε_h(r_2h·z_2h/r_h² − z_h²), where
    z_k = a + b·exp(ikD) and ε_h = 1/(2·n_av − 1). Multiplied out,

        σ_x²·(a(1−c)(2+c))² = s1(2+4c+3c²) + s2(5/4+c) − t1(a·c²(3+4c+2c²) + b·c(4+5c))
                              + t2(a(3/4+3c−4c³−2c⁴) + b(3/4−c−2c²)) − (ε1+ε2)(1−c²)(b − a(1+c))²

    with s_h the dark variance and t_h = ε_h·r_2h/(2·r_h²). For σ_y exchange a and b. Single precision is enough for this.

    No light has a + b > 1, but noise can give such amplitudes, and σ_x² would then fall to 0. The right side is that of light
    with the same a/b and a + b = 1.
    """
    terms = variance_terms(noise.each)
    # Any: numpy's stubs take a float32 array times a Python number for float64, which it is not
    gap: Any = (2.0 * paths.sin_half * paths.sin_half).astype(np.float32)
    a, b = paths.a.astype(np.float32), paths.b.astype(np.float32)
    cos = 1.0 - gap
    alone, own, other = (_polynomial(cos, factors) for factors in (terms.alone, terms.own, terms.other))
    signal = gap * (1.0 + cos) * terms.signal
    scale = gap * (2.0 + cos)
    share = 1.0 / np.maximum(a + b, 1.0)

    def sigma(strength: Any, rival: Any) -> Any:
        possible, other_possible = strength * share, rival * share
        excess = other_possible - possible * (1.0 + cos)
        variance = possible * own + other_possible * other + alone - excess * excess * signal
        deviation = np.sqrt(np.maximum(variance, 0.0)) / (strength * scale)
        return deviation.astype(np.float64)

    return np.stack([sigma(a, b), sigma(b, a)])


@dataclass(frozen=True)
class VarianceTerms:
    """Coefficients of cos⁰ D, cos¹ D … in the variance of `two_path_sigmas`, and `signal`, which is ε1 + ε2.

    `own` is multiplied by the amplitude of the path itself, `other` by the amplitude of the other path, `alone` by
    neither.
    """

    alone: tuple[float, ...]
    own: tuple[float, ...]
    other: tuple[float, ...]
    signal: float


def variance_terms(each: Sequence[HarmonicNoise], /) -> VarianceTerms:
    """Return the coefficients for the noise of harmonics 1 and 2."""
    first, second = each
    s1, s2 = first.dark_variance, second.dark_variance
    t1, t2 = (0.5 * h.averaging * h.pulse_double / h.pulse**2 for h in (first, second))
    return VarianceTerms(
        (2.0 * s1 + 1.25 * s2, 4.0 * s1 + s2, 3.0 * s1),
        (0.75 * t2, 3.0 * t2, -3.0 * t1, -4.0 * (t1 + t2), -2.0 * (t1 + t2)),
        (0.75 * t2, -4.0 * t1 - t2, -5.0 * t1 - 2.0 * t2),
        first.averaging + second.averaging,
    )


def _polynomial(x: Any, coefficients: Sequence[float]) -> Any:
    """Return Σ coefficients[k]·x^k by Horner's rule, in the type of x."""
    value = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value


def misfit_spread(each: Sequence[HarmonicNoise], /) -> float:
    """Return the dark variance of |p1| − p2·conj(ρ)² (see `solver.py: may_be_one_path`)."""
    first, second = each
    return (1.0 + math.pi) ** 2 * first.dark_variance + second.dark_variance
