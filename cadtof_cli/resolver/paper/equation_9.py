"""The paper's solver: two paths reduced to one complex unknown z, Eq. (9), by Levenberg–Marquardt from random starts.

Let z be the share of one path in the first phasor, and 1 − z the share of the other path. Then every higher harmonic
gives an equation q_j = z^j/|z|^(j−1) + (1−z)^j/|1−z|^(j−1), where q_j = p_j·|p_1|^(j−1)/p_1^j. The method assumes that
the first phasor has no noise and that all other phasors have equal noise. So for more than two harmonics, its answer is
not the most likely one (see `likelihood`).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cadtof_cli.arrays import Complex, Float, Index
from cadtof_cli.phasors.rotors import Rotor, powers, unit_rotor
from cadtof_cli.resolver.likelihood.normal_equations import Linearised, entry


@dataclass(frozen=True)
class EliminatedPath:
    """Eq. (9) for n pixels.

    `harmonics` are the j of the equations. `right` holds the real and imaginary parts of their q_j, (n,) each.
    """

    harmonics: tuple[int, ...]
    right: tuple[Rotor, ...]

    @classmethod
    def of_phasors(cls, phasors: Complex, /, *, harmonics: tuple[int, ...]) -> Self:
        """Return the equations of phasors, complex128 (N, n); NaN where the first phasor is 0."""
        modulus, rotor = first_rotor(phasors)
        scale = 1.0 / modulus
        right = []
        for phasor, (cos, sin) in zip(phasors[1:], powers(rotor, harmonics[1:]), strict=True):
            re, im = phasor.real * scale, phasor.imag * scale
            right.append((re * cos + im * sin, im * cos - re * sin))
        return cls(harmonics[1:], tuple(right))

    def linearised(self, z: Float, /) -> Linearised:
        """Return the normal equations of Eq. (9) at z, given as Re z and Im z, (2, n)."""
        re, im = z
        (radius, rotor), (other_radius, other_rotor) = rotors_of(re, im)
        first, second = powers(rotor, self.harmonics), powers(other_rotor, self.harmonics)
        matrix, gradient = np.zeros((3, re.size)), np.zeros((2, re.size))
        cost = np.zeros(re.size)
        for j, q, z_j, w_j in zip(self.harmonics, self.right, first, second, strict=True):
            along_re, along_im = _derivatives(j, rotor, z_j)
            other_re, other_im = _derivatives(j, other_rotor, w_j)
            slope_re = (along_re[0] - other_re[0], along_re[1] - other_re[1])
            slope_im = (along_im[0] - other_im[0], along_im[1] - other_im[1])
            rest = (
                q[0] - radius * z_j[0] - other_radius * w_j[0],
                q[1] - radius * z_j[1] - other_radius * w_j[1],
            )
            cost += _dot(rest, rest)
            matrix[entry(0, 0)] += _dot(slope_re, slope_re)
            matrix[entry(1, 0)] += _dot(slope_re, slope_im)
            matrix[entry(1, 1)] += _dot(slope_im, slope_im)
            gradient[0] += _dot(slope_re, rest)
            gradient[1] += _dot(slope_im, rest)
        return Linearised(matrix, gradient, cost)

    def moved(self, z: Float, steps: Float, /) -> Float:
        """Return z after a step."""
        return z + steps

    def __getitem__(self, chosen: Index, /) -> Self:
        return type(self)(self.harmonics, tuple((re[chosen], im[chosen]) for re, im in self.right))


def first_rotor(phasors: Complex, /) -> tuple[Float, Rotor]:
    """Return modulus and direction of the first phasor of phasors, complex128 (N, n)."""
    return unit_rotor(np.ascontiguousarray(phasors[0].real), np.ascontiguousarray(phasors[0].imag))


def rotors_of(re: Float, im: Float, /) -> tuple[tuple[Float, Rotor], tuple[Float, Rotor]]:
    """Return modulus and direction of z and of 1 − z as `unit_rotor` does, but with a single division."""
    other = 1.0 - re
    radius, other_radius = np.sqrt(re * re + im * im), np.sqrt(other * other + im * im)
    none, other_none = radius == 0.0, other_radius == 0.0
    divisor, other_divisor = radius + none, other_radius + other_none
    scale = 1.0 / (divisor * other_divisor)
    here, there = scale * other_divisor, scale * divisor
    return (radius, (re * here + none, im * here)), (other_radius, (other * there + other_none, -im * there))


def _derivatives(j: int, rotor: Rotor, rotor_j: Rotor) -> tuple[Rotor, Rotor]:
    """Return the derivatives of |z|·exp(i j θ) by Re z and by Im z: exp(i j θ)·(cos θ − i j sin θ) and ·(sin θ + i j cos θ)."""
    cos, sin = rotor
    cos_j, sin_j = rotor_j
    return (
        (cos_j * cos + j * sin_j * sin, sin_j * cos - j * cos_j * sin),
        (cos_j * sin - j * sin_j * cos, sin_j * sin + j * cos_j * cos),
    )


def _dot(a: Rotor, b: Rotor) -> Float:
    return a[0] * b[0] + a[1] * b[1]
