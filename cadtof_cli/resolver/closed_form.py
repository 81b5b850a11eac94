"""Two paths from two harmonics in closed form: exact, unique, and the same work for every pixel.

By Carathéodory's theorem any pair of phasors (p1, p2) has exactly one decomposition p_h = a·exp(i h x) + b·exp(i h y)
with a, b ≥ 0 (Pisarenko's; Peters et al. 2015, doi:10.1145/2816795.2818103, use it for transient imaging). With p0 = a + b
the Toeplitz matrix of (p0, p1, p2) is singular, which makes p0 the root of a cubic and exp(ix), exp(iy) the roots of a
quadratic. The evaluation below keeps its digits where b → 0, x → y and p1 → 0; derivation and notation follow PHYSICS.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float

NEWTON_STEPS = 6
"""From |d| the iteration falls monotonically onto the root; six steps reach machine precision for every input."""


@dataclass(frozen=True)
class FundamentalFrame:
    """Two phasors of n pixels, turned so that the first is real: p1 = u·ρ and p2 = (pr + i·pi)·ρ².

    `u` ≥ 0, `pr`, `pi` and the unit rotor `cos`, `sin` of ρ are float64 of shape (n,). ρ = 1 where p1 = 0.
    """

    u: Float
    pr: Float
    pi: Float
    cos: Float
    sin: Float


@dataclass(frozen=True)
class TwoPaths:
    """Amplitudes and unit rotors exp(ix), exp(iy) of two paths, float64 (n,) each; `cos_half`, `sin_half` belong to (x − y)/2.

    Where `single` is set there is one path: `b` is 0, the second rotor that of the first, and the half angle π/2.
    """

    a: Float
    b: Float
    cos_x: Float
    sin_x: Float
    cos_y: Float
    sin_y: Float
    cos_half: Float
    sin_half: Float
    single: Bool


def fundamental_frame(p1: Complex, p2: Complex, /) -> FundamentalFrame:
    """Turn two phasors, complex128 (n,), into the frame in which the first is real. NaN in gives NaN out."""
    p1_re, p1_im = np.ascontiguousarray(p1.real), np.ascontiguousarray(p1.imag)
    p2_re, p2_im = np.ascontiguousarray(p2.real), np.ascontiguousarray(p2.imag)
    u = np.sqrt(p1_re * p1_re + p1_im * p1_im)
    zero = u == 0.0
    scale = 1.0 / (u + zero)
    cos, sin = p1_re * scale + zero, p1_im * scale
    cos2, sin2 = cos * cos - sin * sin, 2.0 * cos * sin
    return FundamentalFrame(u, p2_re * cos2 + p2_im * sin2, p2_im * cos2 - p2_re * sin2, cos, sin)


def two_paths(frame: FundamentalFrame, /) -> TwoPaths:
    """Return the one decomposition of every pixel into two paths; amplitudes are in units of the phasors.

    NaN in gives NaN out. Warnings about divisions by zero are the caller's to silence: they are the pixels in `single`.
    """
    u, dr, di = frame.u, frame.u - frame.pr, -frame.pi
    h = _excess(u, dr, dr * dr + di * di)
    den = h * (2.0 * u + h)
    single = den == 0.0
    scale = 1.0 / (den + single)
    u_h = u + h
    cos_m, sin_m = _half_angle((u_h * dr - u * h) * scale, u_h * di * scale)
    cos_half = 0.5 * scale * u * ((h + dr) * cos_m + di * sin_m)
    sin_half = np.sqrt(np.maximum((1.0 - cos_half) * (1.0 + cos_half), 0.0))
    split = u * sin_m / sin_half
    a, b = np.maximum(0.5 * (u_h - split), 0.0), np.maximum(0.5 * (u_h + split), 0.0)
    cc, ss, sc, cs = cos_m * cos_half, sin_m * sin_half, sin_m * cos_half, cos_m * sin_half
    if single.any():
        for values, alone in (
            (a, u),
            (b, 0.0),
            (cc, 1.0),
            (ss, 0.0),
            (sc, 0.0),
            (cs, 0.0),
            (cos_half, 0.0),
            (sin_half, 1.0),
        ):
            np.copyto(values, alone, where=single)
    x = _rotated(cc - ss, sc + cs, frame)
    y = _rotated(cc + ss, sc - cs, frame)
    return TwoPaths(a, b, *x, *y, cos_half, sin_half, single)


def _excess(u: Float, dr: Float, d2: Float) -> Float:
    """Return H = p0 − u, the positive root of H³ + 3uH² + (2u·Re d − |d|²)H − u|d|², by a fixed number of Newton steps.

    One step is H ← (H(2H² + 3uH) + u|d|²) / (3H² + 6uH + 2u·Re d − |d|²): the numerator is a sum of positive terms.
    """
    h = np.sqrt(d2)
    u3, linear, constant = 3.0 * u, 2.0 * u * dr - d2, u * d2
    t, v, w = np.empty_like(h), np.empty_like(h), np.empty_like(h)
    for _ in range(NEWTON_STEPS):
        np.multiply(h, h, out=v)
        np.multiply(u3, h, out=t)
        np.add(t, v, out=t)
        np.add(t, v, out=v)
        np.multiply(v, h, out=w)
        np.add(w, constant, out=w)
        np.add(v, t, out=v)
        np.add(v, linear, out=v)
        np.divide(w, v, out=h)
    return h


def _half_angle(re: Float, im: Float) -> tuple[Float, Float]:
    """Return cosine and sine of half the argument of re + i·im (or of that plus π, which only swaps the two paths)."""
    modulus = np.sqrt(re * re + im * im)
    large = modulus + np.abs(re)
    norm = 1.0 / np.sqrt(2.0 * modulus * large)
    large *= norm
    small = im * norm
    right = re >= 0.0
    return np.where(right, large, small), np.where(right, small, large)


def _rotated(cos: Float, sin: Float, frame: FundamentalFrame) -> tuple[Float, Float]:
    return cos * frame.cos - sin * frame.sin, cos * frame.sin + sin * frame.cos
