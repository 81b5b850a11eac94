"""Two paths from two harmonics in closed form: exact, unique, and the same work for every pixel.

By Carathéodory's theorem any pair of phasors (p1, p2) has exactly one decomposition p_h = a·exp(i h x) + b·exp(i h y)
with a, b ≥ 0 (Pisarenko's; Peters et al. 2015, doi:10.1145/2816795.2818103, use it for transient imaging). With p0 = a + b
the Toeplitz matrix of (p0, p1, p2) is singular, which makes p0 the root of a cubic and exp(ix), exp(iy) the roots of a
quadratic. The evaluation below keeps its digits where b → 0, x → y and p1 → 0; derivation and notation follow PHYSICS.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.resolver.paths import FULL_TURN

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

    `u` ≥ 0, `pr`, `pi` and the unit rotor `cos`, `sin` of ρ are float64 of shape (n,). ρ = 1 where p1 = 0. They are planes of
    real numbers because numpy's complex products round differently at the end of an array than within it.
    """

    u: Float
    pr: Float
    pi: Float
    cos: Float
    sin: Float

    @property
    def powers(self) -> tuple[Float, Float]:
        """|p1|² and |p2|²."""
        return self.u * self.u, self.pr * self.pr + self.pi * self.pi

    def __getitem__(self, pixels: Index | slice, /) -> "FundamentalFrame":
        return FundamentalFrame(*(values[pixels] for values in (self.u, self.pr, self.pi, self.cos, self.sin)))


@dataclass(frozen=True)
class TwoPaths:
    """Two paths of n pixels, float64: amplitudes a and b, (2, n), and phases x, y = mean ± half.

    The mean phase is kept as the unit rotor `cos_mean`, `sin_mean`, half the difference, between 0 and π, as `cos_half` and
    `sin_half`. Where `single` is set there is one path: `b` is 0, and so is half the difference.
    """

    amplitude: Float
    cos_mean: Float
    sin_mean: Float
    cos_half: Float
    sin_half: Float
    single: Bool

    @property
    def a(self) -> Float:
        """Amplitude of the path at x."""
        return np.asarray(self.amplitude[0])

    @property
    def b(self) -> Float:
        """Amplitude of the path at y."""
        return np.asarray(self.amplitude[1])

    @cached_property
    def _products(self) -> tuple[Float, Float, Float, Float]:
        return (
            self.cos_mean * self.cos_half,
            self.sin_mean * self.sin_half,
            self.sin_mean * self.cos_half,
            self.cos_mean * self.sin_half,
        )

    @property
    def cos_x(self) -> Float:
        """Real part of exp(ix)."""
        return self._products[0] - self._products[1]

    @property
    def sin_x(self) -> Float:
        """Imaginary part of exp(ix)."""
        return self._products[2] + self._products[3]

    @property
    def cos_y(self) -> Float:
        """Real part of exp(iy)."""
        return self._products[0] + self._products[1]

    @property
    def sin_y(self) -> Float:
        """Imaginary part of exp(iy)."""
        return self._products[2] - self._products[3]

    def phases(self) -> Float:
        """Return x and y in [0, 2π) rad, (2, n)."""
        mean = phase_of(self.cos_mean, self.sin_mean)
        half = np.arctan(self.sin_half / (1.0 + self.cos_half))
        half *= 2.0
        both = np.empty((2, mean.size))
        x = np.add(mean, half, out=both[0])
        x -= (x >= FULL_TURN) * FULL_TURN
        y = np.subtract(mean, half, out=both[1])
        y += (y < 0.0) * FULL_TURN
        y[y >= FULL_TURN] = 0.0
        return both


def fundamental_frame(p1: Complex, p2: Complex, /) -> FundamentalFrame:
    """Turn two phasors, complex128 (n,), into the frame in which the first is real. NaN in gives NaN out."""
    cos, sin = p1.real.copy(), p1.imag.copy()
    u = cos * cos
    u += sin * sin
    np.sqrt(u, out=u)
    zero = u == 0.0
    scale = 1.0 / (u + zero)
    cos *= scale
    cos += zero
    sin *= scale
    cos2, sin2 = cos * cos, sin * cos
    cos2 -= sin * sin
    sin2 += sin2
    p2_re, p2_im = p2.real, p2.imag
    pr, pi = p2_re * cos2, p2_im * cos2
    pr += p2_im * sin2
    pi -= p2_re * sin2
    return FundamentalFrame(u, pr, pi, cos, sin)


def phase_of(cos: Float, sin: Float, /) -> Float:
    """Return the phase of a unit rotor in [0, 2π): π + 2·arctan of the tangent of half the angle from −1, in one of two forms.

    It takes half the time of arctan2, whose loop numpy does not vectorise everywhere.
    """
    phase = np.arctan(np.where(cos < 0.0, sin / (cos - 1.0), (1.0 + cos) / -sin))
    phase *= 2.0
    phase += np.pi
    phase[phase >= FULL_TURN] = 0.0
    return phase


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
    u, pi = frame.u, frame.pi
    dr = u - frame.pr
    d2 = dr * dr
    d2 += pi * pi
    single = _is_single(u, d2)
    h = _excess(u, dr, d2)
    h[single] = 0.0
    u_h = u + h
    den = (u_h + u) * h
    # exp(im), where 2m is the argument of u(d − H) + Hd with d = dr − i·pi
    cos_m, sin_m = _half_angle(u_h * dr - u * h, u_h * pi, den)
    cos_half = (h + dr) * cos_m
    cos_half += pi * sin_m
    cos_half *= u
    den += den
    cos_half /= den
    sin_half = (1.0 - cos_half) * (1.0 + cos_half)
    np.sqrt(np.maximum(sin_half, SMALLEST_SINE, out=sin_half), out=sin_half)
    split = sin_m * u
    split /= sin_half
    if single.any():
        for values, alone in ((cos_m, 1.0), (sin_m, 0.0), (cos_half, 1.0), (sin_half, 0.0)):
            values[single] = alone
        split[single] = u[single]
    cos = cos_m * frame.cos
    cos += sin_m * frame.sin
    sin = cos_m * frame.sin
    sin -= sin_m * frame.cos
    return TwoPaths(_shares(u_h, split), cos, sin, cos_half, sin_half, single)


def _shares(total: Float, split: Float) -> Float:
    """Return (total ± split)/2, (2, n); rounding must not let either fall below 0."""
    np.minimum(split, total, out=split)
    np.maximum(split, -total, out=split)
    shares = np.empty((2, total.size))
    np.add(total, split, out=shares[0])
    np.subtract(total, split, out=shares[1])
    shares *= 0.5
    return shares


def _excess(u: Float, dr: Float, d2: Float) -> Float:
    """Return H = p0 − u, the positive root of H³ + 3uH² + (2u·Re d − |d|²)H − u|d|², by a fixed number of Newton steps.

    One step is H ← (H(2H² + 3uH) + u|d|²) / (3H² + 6uH + 2u·Re d − |d|²): the numerator is a sum of positive terms. The first,
    from |d|, comes to |d|²(|d| + 2u) / (|d|² + u(3|d| + Re d)).
    """
    constant, linear, u2 = u * d2, u * dr, u + u
    linear += linear
    linear -= d2
    u3 = u2 + u
    h = np.sqrt(d2)
    t, v, w = 3.0 * h, np.empty_like(h), np.empty_like(h)
    t += dr
    t *= u
    t += d2
    h += u2
    h *= d2
    h /= t
    for _ in range(NEWTON_STEPS - 1):
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
