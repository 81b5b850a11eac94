"""Two paths from two harmonics in closed form: exact, unique, and the same work for every pixel.

By Carathéodory's theorem any pair of phasors (p1, p2) has exactly one decomposition p_h = a·exp(i h x) + b·exp(i h y)
with a, b ≥ 0 (Pisarenko's; Peters et al. 2015, doi:10.1145/2816795.2818103, use it for transient imaging). Let p0 be
a + b; then the Toeplitz matrix of (p0, p1, p2) is singular. So p0 is the root of a cubic, and exp(ix), exp(iy) are the
roots of a quadratic. The evaluation below loses no digits as b → 0, x → y or p1 → 0. Derivation and notation follow
docs/physics.md.
"""

from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, SomePixels
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.paths import FULL_TURN
from cadtof_cli.resolver.two_path.arcsine import phase_of
from cadtof_cli.resolver.two_path.roots import LEAST, inverse_root, inverse_root_or_none, rough_inverse_root

EXCESS_STEPS = 2
"""Each step quadruples the number of correct digits: the start's error of 8.5 % becomes 8e-5, then 4e-17."""

ROUNDING_SQUARE = 2.0**-100
"""(|d|/|p1|)² up to which a pixel has one path: its phasors are those of one path except for rounding, |d| ≤ 4 ulp."""

SMALLEST_SQUARE = 1e-100
"""|d|² up to which a pixel has one path even if p1 is 0, because the sixth power of |d| must not underflow."""

SMALLEST_SINE = 1e-300
"""Floor for sin²γ. It avoids 0/0 if paths coincide to the last digit; how they share their sum does not matter then."""


@dataclass(frozen=True)
class FundamentalFrame:
    """Two phasors of n pixels, turned so that the first is real: p1 = u·ρ and p2 = (pr + i·pi)·ρ².

    `u` ≥ 0, `pr`, `pi` and the unit rotor `cos`, `sin` of ρ are float64 of shape (n,). If |p1| < 1.5e-154, its square
    is no normal number, and then ρ = 1 and u = 0. The fields are real arrays, because numpy rounds complex products
    differently at the end of an array than within it.
    """

    u: Float
    pr: Float
    pi: Float
    cos: Float
    sin: Float

    @cached_property
    def d2(self) -> Float:
        """|d|² with d = u − p2·conj(ρ)², which is 0 for the phasors of one path."""
        dr = self.u - self.pr
        return dr * dr + self.pi * self.pi

    @property
    def powers(self) -> tuple[Float, Float]:
        """|p1|² and |p2|²."""
        return self.u * self.u, self.pr * self.pr + self.pi * self.pi

    def __getitem__(self, pixels: SomePixels | Bool, /) -> "FundamentalFrame":
        return FundamentalFrame(*(values[pixels] for values in (self.u, self.pr, self.pi, self.cos, self.sin)))


@dataclass(frozen=True)
class TwoPaths:
    """Two paths of n pixels, float64: amplitudes a and b, (2, n), and phases x, y = mean ± half.

    The mean phase is stored as the unit rotor `cos_mean`, `sin_mean`. Half the difference, between 0 and π, is stored
    as `cos_half` and `sin_half`. Where `single` is True there is one path: `b` and half the difference are 0. `known_rad` are
    the phases x and y, (2, n), if the kernel has computed them.
    """

    amplitude: Float
    cos_mean: Float
    sin_mean: Float
    cos_half: Float
    sin_half: Float
    single: Bool
    known_rad: Float | None = None

    @property
    def a(self) -> Float:
        """Amplitude of the path with phase x."""
        return np.asarray(self.amplitude[0])

    @property
    def b(self) -> Float:
        """Amplitude of the path with phase y."""
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
        if self.known_rad is not None:
            return self.known_rad
        mean, half = phase_of(self.cos_mean, self.sin_mean), phase_of(self.cos_half, self.sin_half)
        x, y = mean + half, mean - half
        x = np.where(x >= FULL_TURN, x - FULL_TURN, x)
        y = np.where(y < 0.0, y + FULL_TURN, y)
        return np.stack([x, np.where(y >= FULL_TURN, 0.0, y)])


def fundamental_frame(p1: Complex, p2: Complex, /) -> FundamentalFrame:
    """Turn two phasors, complex128 (n,), so that the first one is real. NaN in gives NaN out."""
    re1, im1, re2, im2 = p1.real, p1.imag, p2.real, p2.imag
    power = re1 * re1 + im1 * im1
    inverse = inverse_root_or_none(power)
    u = power * inverse
    cos, sin = np.where(power < LEAST, 1.0, re1 * inverse), im1 * inverse
    cos2, sin2 = cos * cos - sin * sin, 2.0 * (sin * cos)
    return FundamentalFrame(u, re2 * cos2 + im2 * sin2, im2 * cos2 - re2 * sin2, cos, sin)


def is_single(frame: FundamentalFrame, /) -> Bool:
    """Return True where the two phasors are those of one path to within rounding, (n,)."""
    single: Bool = frame.d2 <= ROUNDING_SQUARE * (frame.u * frame.u) + SMALLEST_SQUARE
    return single


def two_paths(frame: FundamentalFrame, /) -> TwoPaths:
    """Return the unique decomposition of every pixel into two paths; amplitudes are in units of the phasors.

    Let d = u − p2·conj(ρ)² = dr − i·pi, H = p0 − u and g = u(d − H) + Hd, whose modulus is M = H(2u + H). The mean
    phase m of the paths is half the argument of g. Half their difference is γ with cos γ = u·Re((H + d)·exp(−im)) / 2M.
    The amplitudes are a, b = (p0 ± u·sin m / sin γ)/2. The larger of |cos m| and |sin m| is √((M + |Re g|)/2M), and the
    other one follows from Im g. Taking m + π instead of m would only swap the two paths.

    NaN in gives NaN out. The caller silences warnings about divisions by zero, which come from the pixels in `single`.
    """
    u, pi = frame.u, frame.pi
    dr, single = u - frame.pr, is_single(frame)
    h = np.where(single, 0.0, _excess(u, dr, frame.d2))
    p0 = u + h
    product = (p0 + u) * h
    re = p0 * dr - u * h
    double_square = product + np.abs(re)
    norm = inverse_root(2.0 * product * double_square)
    large, small = double_square * norm, p0 * pi * norm
    cos_m, sin_m = np.where(re >= 0.0, large, small), np.where(re >= 0.0, small, large)
    cos_half = ((h + dr) * cos_m + pi * sin_m) * u * (norm * large)
    square = np.maximum((1.0 - cos_half) * (1.0 + cos_half), SMALLEST_SINE)
    inverse = inverse_root(square)
    sin_half, split = square * inverse, sin_m * u * inverse
    cos_m, sin_m = np.where(single, 1.0, cos_m), np.where(single, 0.0, sin_m)
    cos_half, sin_half = np.where(single, 1.0, cos_half), np.where(single, 0.0, sin_half)
    # rounding must not let an amplitude fall below 0
    split = np.maximum(np.minimum(np.where(single, u, split), p0), -p0)
    return TwoPaths(
        np.stack([0.5 * (p0 + split), 0.5 * (p0 - split)]),
        cos_m * frame.cos + sin_m * frame.sin,
        cos_m * frame.sin - sin_m * frame.cos,
        cos_half,
        sin_half,
        single,
    )


def _excess(u: Float, dr: Float, d2: Float) -> Float:
    """Return H = p0 − u, the positive root of f = H³ + 3uH² + (2u·Re d − |d|²)H − u|d|², by a fixed number of steps.

    A step is Householder's of third order, H ← H − f·(f′² − f·f″/2) / (f′·(f′² − f·f″) + f²·f‴/6), with f‴/6 = 1. The
    start is |d|²(|d| + αu) / (|d|² + u(β|d| + γ·Re d)). It is the root if u = 0. α, β and γ are chosen so that it is
    never more than 8.5 % off the root.
    """
    constant, linear = u * d2, 2.0 * (u * dr) - d2
    modulus = d2 * rough_inverse_root(d2)
    h = (modulus + 2.17 * u) * d2 / ((4.06 * modulus + 2.06 * dr) * u + d2)
    for _ in range(EXCESS_STEPS):
        value = ((h + 3.0 * u) * h + linear) * h - constant
        slope, half_curvature = (h + (u + u)) * (3.0 * h) + linear, 3.0 * (h + u)
        bent = value * half_curvature
        least = slope * slope - bent
        h = h - value * least / (slope * (least - bent) + value * value)
    return h
