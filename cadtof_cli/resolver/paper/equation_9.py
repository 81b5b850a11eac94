"""The paper's solver: two paths reduced to one complex unknown z, Eq. (9), by Levenberg–Marquardt from random starts.

With z the share of the first phasor that one path makes up, and 1 − z that of the other, every higher harmonic gives an
equation q_j = z^j/|z|^(j−1) + (1−z)^j/|1−z|^(j−1), where q_j = p_j·|p_1|^(j−1)/p_1^j. The first phasor is taken to be free of
noise, and the others to have the same; so for more than two harmonics this is not the most likely answer (`likelihood`).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.phasors.rotors import Rotor, powers, unit_rotor
from cadtof_cli.resolver.likelihood.compiled import SHARES, Planes
from cadtof_cli.resolver.likelihood.levenberg_marquardt import LevenbergMarquardt, Linearised, Minimum
from cadtof_cli.resolver.likelihood.mixture import Mixture
from cadtof_cli.resolver.likelihood.normal_equations import entry
from cadtof_cli.resolver.paper.starts import Starts

SOLVER = LevenbergMarquardt(max_steps=100, relative=1e-2, absolute=1e-29)
"""A start on its way to the answer lowers its cost by a share of it with every step; one that does not is in a false minimum."""

START_COLUMNS = 32768
"""Pixels times starts solved at a time."""

STAGES = (0, 1, 3, 5)
"""Starts at which it is asked anew which pixels need more."""


@dataclass(frozen=True)
class EliminatedPath:
    """Eq. (9) for n pixels; a `Problem` whose points are Re z and Im z.

    `harmonics` are the j of the equations, `right` the real and imaginary parts of their q_j, (n,) each.
    """

    harmonics: tuple[int, ...]
    right: tuple[Rotor, ...]

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations of Eq. (9) at z."""
        re, im = points
        radius, rotor = unit_rotor(re, im)
        other_radius, other_rotor = unit_rotor(1.0 - re, -im)
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

    def moved(self, points: Float, steps: Float, /) -> Float:
        """Return z after a step."""
        return points + steps

    def planes(self, points: Float, /) -> Planes:
        """Return them for the compiled search."""
        del points
        re, im = zip(*self.right, strict=True)
        return Planes(SHARES, 1, self.harmonics, np.stack(re), np.stack(im))

    def __getitem__(self, chosen: Index, /) -> Self:
        return type(self)(self.harmonics, tuple((re[chosen], im[chosen]) for re, im in self.right))


@dataclass(frozen=True)
class TwoShares:
    """Two paths of n pixels, and what Eq. (9) leaves, (n,): 0 where it is met.

    `converged` is not set where every start ran out of steps.
    """

    paths: Mixture
    cost: Float
    converged: Bool


def two_shares(
    phasors: Complex, /, *, harmonics: tuple[int, ...], starts: Starts, solver: LevenbergMarquardt = SOLVER
) -> TwoShares:
    """Solve Eq. (9) for every pixel of phasors, complex128 (N, n), from each of its starts, (S, n), and keep the best.

    A pixel whose first phasor is 0 has no q_j: it gets NaN, and is not converged. The first start is tried alone,
    then the next two, and so on: a pixel that has met its equations to rounding error, which no start can better,
    tries no more.
    """
    count = phasors.shape[1]
    first = (np.ascontiguousarray(phasors[0].real), np.ascontiguousarray(phasors[0].imag))
    modulus, rotor = unit_rotor(*first)
    problem = EliminatedPath(harmonics[1:], _right_sides(phasors, harmonics, modulus, rotor))
    best = np.full((2, count), np.nan)
    cost, converged = np.full(count, np.inf), np.zeros(count, np.bool_)
    for begin_row, end_row in zip(STAGES, (*STAGES[1:], len(starts)), strict=True):
        open_: Index = np.flatnonzero((cost > solver.absolute) & (modulus > 0.0))
        if not open_.size or begin_row >= len(starts):
            break
        some = starts[begin_row:end_row]
        step = max(1, START_COLUMNS // len(some))
        for begin in range(0, open_.size, step):
            pixels = open_[begin : begin + step]
            found = _best_of(some[:, pixels], problem[pixels], solver)
            better = found.cost < cost[pixels]
            chosen = pixels[better]
            best[:, chosen], cost[chosen] = found.points[:, better], found.cost[better]
            converged[chosen] = found.converged[better]
    return _shares(best, modulus, rotor, cost, converged)


def steps_of_starts(
    phasors: Complex, /, *, harmonics: tuple[int, ...], starts: Starts, solver: LevenbergMarquardt = SOLVER
) -> Index:
    """Return after how many steps each start of every pixel ends, (S, n): all of them, as the paper runs all ten."""
    first = (np.ascontiguousarray(phasors[0].real), np.ascontiguousarray(phasors[0].imag))
    modulus, rotor = unit_rotor(*first)
    problem = EliminatedPath(harmonics[1:], _right_sides(phasors, harmonics, modulus, rotor))
    found = [solver.solve(problem, np.stack([row.real, row.imag])).steps for row in starts[:]]
    return np.stack(found)


def _best_of(starts: Complex, problem: EliminatedPath, solver: LevenbergMarquardt) -> Minimum:
    """Solve every pixel from its starts, (S, n), at once, and return the best end of each; the earlier start of equal ones."""
    count, pixels = starts.shape
    column = np.tile(np.arange(pixels), count)
    found = solver.solve(problem[column], np.stack([starts.real.ravel(), starts.imag.ravel()]))
    best = found.cost.reshape(count, pixels).argmin(axis=0) * pixels + np.arange(pixels)
    return found[best]


def _right_sides(phasors: Complex, harmonics: tuple[int, ...], modulus: Float, rotor: Rotor) -> tuple[Rotor, ...]:
    scale = 1.0 / modulus
    right = []
    for phasor, (cos, sin) in zip(phasors[1:], powers(rotor, harmonics[1:]), strict=True):
        re, im = phasor.real * scale, phasor.imag * scale
        right.append((re * cos + im * sin, im * cos - re * sin))
    return tuple(right)


def _shares(z: Float, modulus: Float, rotor: Rotor, cost: Float, converged: Bool) -> TwoShares:
    """Return α = z·p_1 and β = (1 − z)·p_1 as amplitudes and rotors."""
    amplitudes, cosines, sines = [], [], []
    for re, im in ((z[0], z[1]), (1.0 - z[0], -z[1])):
        share, (cos, sin) = unit_rotor(re, im)
        amplitudes.append(share * modulus)
        cosines.append(cos * rotor[0] - sin * rotor[1])
        sines.append(sin * rotor[0] + cos * rotor[1])
    return TwoShares(Mixture(np.stack(amplitudes), np.stack(cosines), np.stack(sines)), cost, converged)


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
