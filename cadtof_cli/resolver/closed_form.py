"""Two paths from two harmonics in closed form: exact, unique, and the same work for every pixel.

By Carathéodory's theorem any pair of phasors (p1, p2) has exactly one decomposition p_h = a·exp(i h x) + b·exp(i h y)
with a, b ≥ 0 (Pisarenko's; Peters et al. 2015, doi:10.1145/2816795.2818103, use it for transient imaging). With p0 = a + b
the Toeplitz matrix of (p0, p1, p2) is singular, which makes p0 the root of a cubic and exp(ix), exp(iy) the roots of a
quadratic. The evaluation below keeps its digits where b → 0, x → y and p1 → 0; derivation and notation follow PHYSICS.
"""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index

NEWTON_STEPS = 6
"""From |d| the iteration falls monotonically onto the root; six steps reach machine precision for every input."""


ROUNDING_SQUARE = 2.0**-100
"""(|d|/|p1|)² up to which a pixel has one path: two phasors that differ from one path's by rounding alone, |d| ≤ 4 ulp."""

SMALLEST_SQUARE = 1e-280
"""|d|² up to which a pixel has one path even where p1 is 0: far enough above underflow."""

SMALLEST_SINE = 1e-300
"""Least sin²γ: keeps paths that coincide to the last digit from dividing zero by zero; how they share their sum is no matter."""


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

    def at(self, index: Index | slice, /) -> "FundamentalFrame":
        """Return the pixels at these indices."""
        return FundamentalFrame(*(values[index] for values in (self.u, self.pr, self.pi, self.cos, self.sin)))


@dataclass(frozen=True)
class TwoPaths:
    """Amplitudes and unit rotors exp(ix), exp(iy) of two paths, float64 (n,) each; `cos_half`, `sin_half` belong to (x − y)/2.

    Where `single` is set there is one path: `b` is 0, the second rotor that of the first, and the half angle 0.
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


def is_single(frame: FundamentalFrame, /) -> Bool:
    """Return where two phasors are those of one path to within rounding, (n,)."""
    difference = frame.u - frame.pr
    return _is_single(frame.u, difference * difference + frame.pi * frame.pi)


def _is_single(u: Float, d2: Float) -> Bool:
    single: Bool = d2 <= ROUNDING_SQUARE * (u * u) + SMALLEST_SQUARE
    return single


def two_paths(frame: FundamentalFrame, /) -> TwoPaths:
    """Return the one decomposition of every pixel into two paths; amplitudes are in units of the phasors.

    NaN in gives NaN out. Warnings about divisions by zero are the caller's to silence: they are the pixels in `single`.
    """
    u, dr, di = frame.u, frame.u - frame.pr, -frame.pi
    d2 = dr * dr + di * di
    single = _is_single(u, d2)
    h = _excess(u, dr, d2)
    h[single] = 0.0
    u_h = u + h
    den = h * (u_h + u)
    cos_m, sin_m = _half_angle(u_h * dr - u * h, u_h * di, den)
    cos_half = (h + dr) * cos_m
    cos_half += di * sin_m
    cos_half *= 0.5 * u
    cos_half /= den
    sin_half = (1.0 - cos_half) * (1.0 + cos_half)
    np.sqrt(np.maximum(sin_half, SMALLEST_SINE, out=sin_half), out=sin_half)
    if single.any():
        for values, alone in ((cos_m, 1.0), (sin_m, 0.0), (cos_half, 1.0), (sin_half, 0.0)):
            values[single] = alone
        split = np.where(single, -u, u * sin_m / sin_half)
    else:
        split = u * sin_m / sin_half
    a, b = _shares(u_h, split)
    # exp(im)·ρ, then times exp(±iγ)
    cos, sin = cos_m * frame.cos - sin_m * frame.sin, cos_m * frame.sin + sin_m * frame.cos
    cc, ss, sc, cs = cos * cos_half, sin * sin_half, sin * cos_half, cos * sin_half
    return TwoPaths(a, b, cc - ss, sc + cs, cc + ss, sc - cs, cos_half, sin_half, single)


def _shares(total: Float, split: Float) -> tuple[Float, Float]:
    """Return (total ∓ split)/2; rounding must not let either fall below 0."""
    np.minimum(split, total, out=split)
    np.maximum(split, -total, out=split)
    return 0.5 * (total - split), 0.5 * (total + split)


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


def _half_angle(re: Float, im: Float, modulus: Float) -> tuple[Float, Float]:
    """Return cosine and sine of half the argument of re + i·im, or of that plus π, which only swaps the two paths."""
    large = modulus + np.abs(re)
    norm = 1.0 / np.sqrt(2.0 * modulus * large)
    large *= norm
    small = im * norm
    right = re >= 0.0
    return np.where(right, large, small), np.where(right, small, large)
