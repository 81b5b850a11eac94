"""K paths on N harmonics as a least-squares problem: p_h = Σ_k a_k·exp(i h x_k) with known noise, for Levenberg–Marquardt.

The step of a path has a part along its direction and a part across it, (da, a·dx); in these, no derivative vanishes as
a → 0. An amplitude that would fall below zero becomes positive half a turn away, so that a ≥ 0 needs no bounds.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from cadtof_cli.arrays import Complex, Float, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import Rotor, powers, product, unit_rotor
from cadtof_cli.resolver.kernels import chosen_kernel
from cadtof_cli.resolver.likelihood.kernel import WEIGHTED, WHITE, compiled_search
from cadtof_cli.resolver.likelihood.normal_equations import Linearised, entry


@dataclass(frozen=True)
class Mixture:
    """K paths of n pixels: amplitudes in units of the phasors, and the rotors of their phases; float64 (K, n) each."""

    amplitude: Float
    cos: Float
    sin: Float

    @classmethod
    def of_points(cls, points: Float, /) -> "Mixture":
        """Return the paths from the solver's points (3·K, n)."""
        amplitude, cos, sin = np.split(points, 3)
        return cls(amplitude, cos, sin)

    @property
    def points(self) -> Float:
        """The paths as the solver's points (3·K, n)."""
        return np.concatenate((self.amplitude, self.cos, self.sin))

    def joined(self, other: "Mixture", /) -> "Mixture":
        """Return these paths and the other ones."""
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return Mixture(*map(np.concatenate, both))

    def __getitem__(self, chosen: Index, /) -> "Mixture":
        return Mixture(self.amplitude[:, chosen], self.cos[:, chosen], self.sin[:, chosen])

    def phasors(self, harmonics: tuple[int, ...], /) -> tuple[Float, Float]:
        """Return real and imaginary part, (N, n) each, of Σ_k a_k·exp(i h x_k)."""
        re, im = np.empty((2, len(harmonics), self.amplitude.shape[1]))
        for row, (cos, sin) in enumerate(powers((self.cos, self.sin), harmonics)):
            re[row], im[row] = _summed(self.amplitude * cos), _summed(self.amplitude * sin)
        return re, im


@dataclass(frozen=True)
class Measured:
    """Phasors of n pixels in real and imaginary parts, float64 (N, n) each, and the numbers of their harmonics."""

    harmonics: tuple[int, ...]
    re: Float
    im: Float

    @classmethod
    def of_phasors(cls, phasors: Complex, /, *, harmonics: tuple[int, ...]) -> "Measured":
        """Return the real and imaginary parts of phasors, complex128 (N, n)."""
        return cls(harmonics, np.ascontiguousarray(phasors.real), np.ascontiguousarray(phasors.imag))

    def __getitem__(self, chosen: Index, /) -> "Measured":
        return Measured(self.harmonics, self.re[:, chosen], self.im[:, chosen])

    def phasors(self, rows: int | None = None, /) -> Complex:
        """Return the phasors of the first rows, or of all, complex128."""
        return self.re[:rows] + 1j * self.im[:rows]

    def rest(self, row: int, amplitude: Float, rotor: Rotor, /) -> Rotor:
        """Return the phasor of a row minus paths with these amplitudes and rotors at its harmonic, (n,) each part."""
        cos, sin = rotor
        return self.re[row] - _summed(amplitude * cos), self.im[row] - _summed(amplitude * sin)

    def without(self, paths: Mixture, /) -> "Measured":
        """Return the phasors minus the phasors of the paths."""
        re, im = paths.phasors(self.harmonics)
        return Measured(self.harmonics, self.re - re, self.im - im)


def moved_paths(points: Float, steps: Float, /) -> Float:
    """Return points (3·K, n) after steps (2·K, n): first the parts along the K paths, then the parts across them."""
    paths = Mixture.of_points(points)
    along, across = np.split(steps, 2)
    amplitude, turn = unit_rotor(paths.amplitude + along, across)
    return Mixture(amplitude, *product((paths.cos, paths.sin), turn)).points


@dataclass(frozen=True)
class WhiteFit:
    """The fit with the noise of ambient light alone, which has one weight per harmonic, equal in all directions."""

    kind: ClassVar[int] = WHITE
    response_arrays: ClassVar[tuple[()]] = ()

    measured: Measured
    weights: tuple[float, ...]

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations; their entries between two paths depend only on the difference of the phases."""
        paths = Mixture.of_points(points)
        k, count = paths.amplitude.shape
        matrix, gradient, cost = np.zeros((entry(2 * k, 0), count)), np.zeros((2 * k, count)), np.zeros(count)
        rotors = powers((paths.cos, paths.sin), self.measured.harmonics)
        for row, (h, weight, (cos, sin)) in enumerate(zip(self.measured.harmonics, self.weights, rotors, strict=True)):
            re, im = self.measured.rest(row, paths.amplitude, (cos, sin))
            cost += weight * (re * re + im * im)
            gradient[:k] += weight * (cos * re + sin * im)
            gradient[k:] += (weight * h) * (cos * im - sin * re)
            for i in range(k):
                matrix[entry(i, i)] += weight
                matrix[entry(k + i, k + i)] += weight * h * h
                for j in range(i):
                    in_phase = weight * (cos[i] * cos[j] + sin[i] * sin[j])
                    quadrature = (weight * h) * (sin[i] * cos[j] - cos[i] * sin[j])
                    matrix[entry(i, j)] += in_phase
                    matrix[entry(k + i, k + j)] += (h * h) * in_phase
                    matrix[entry(k + j, i)] += quadrature
                    matrix[entry(k + i, j)] -= quadrature
        return Linearised(matrix, gradient, cost)

    moved = staticmethod(moved_paths)

    def __getitem__(self, chosen: Index, /) -> Self:
        return type(self)(self.measured[chosen], self.weights)


@dataclass(frozen=True)
class WeightedFit:
    """The fit with the full noise of each harmonic.

    `weights`, (3, N, n), are the entries re·re, re·im and im·im of the inverse covariances.
    """

    kind: ClassVar[int] = WEIGHTED
    response_arrays: ClassVar[tuple[()]] = ()

    measured: Measured
    weights: Float

    @classmethod
    def around(cls, measured: Measured, paths: Mixture, /, *, noise: NoiseModel) -> "WeightedFit":
        """Return the fit with the noise that light of the given paths has; all kernels give the same bits."""
        harmonics, entries = measured.harmonics, np.empty((3, *measured.re.shape))
        if (compiled := compiled_search(harmonics, paths=len(paths.amplitude))) is not None:
            terms, numbers = np.array([one.covariance_terms for one in noise.each]), np.array(harmonics, np.int64)
            compiled.weigh(
                chosen_kernel(), len(paths.amplitude), numbers, terms, np.ascontiguousarray(paths.points), entries
            )
            return cls(measured, entries)
        total = np.maximum(_summed(paths.amplitude), 1.0)
        light = Mixture(paths.amplitude / total, paths.cos, paths.sin)
        single, doubled = light.phasors(harmonics), light.phasors(tuple(2 * h for h in harmonics))
        for row, harmonic in enumerate(noise.each):
            re_re, re_im, im_im = harmonic.covariance(
                (single[0][row], single[1][row]), (doubled[0][row], doubled[1][row])
            )
            scale = 1.0 / (re_re * im_im - re_im * re_im)
            entries[:, row] = im_im * scale, -re_im * scale, re_re * scale
        return cls(measured, entries)

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations with their weights."""
        paths = Mixture.of_points(points)
        harmonics = self.measured.harmonics
        rotors = zip(harmonics, powers((paths.cos, paths.sin), harmonics), strict=True)
        answers = (((cos, sin), (-h * sin, h * cos)) for h, (cos, sin) in rotors)
        return equations_of(self.measured, self.weights, paths.amplitude, answers)

    def strengths(self, path: Mixture, /) -> Iterator[tuple[Float, float]]:
        """Yield, for each harmonic, the amplitude along one path, (n,), and 1, the square of a rotor."""
        (rotor,) = zip(path.cos, path.sin, strict=True)
        rotors = powers(rotor, self.measured.harmonics)
        for re, im, (cos, sin) in zip(self.measured.re, self.measured.im, rotors, strict=True):
            yield re * cos + im * sin, 1.0

    moved = staticmethod(moved_paths)

    def __getitem__(self, chosen: Index, /) -> Self:
        return type(self)(self.measured[chosen], self.weights[:, :, chosen])


def equations_of(
    measured: Measured, weights: Float, amplitude: Float, answers: Iterable[tuple[Rotor, Rotor]], /
) -> Linearised:
    """Return the normal equations of K paths with amplitudes (K, n), and weights as in `WeightedFit`.

    `answers` are, for each harmonic, what a path of amplitude 1 gives and its derivative by the phase, (K, n) each part.
    """
    k, count = amplitude.shape
    matrix, gradient, cost = np.zeros((entry(2 * k, 0), count)), np.zeros((2 * k, count)), np.zeros(count)
    for row, (value, slope) in enumerate(answers):
        re, im = measured.rest(row, amplitude, value)
        a, b, d = weights[:, row]
        slopes_re, slopes_im = map(np.concatenate, zip(value, slope, strict=True))
        weighted_re, weighted_im = a * slopes_re + b * slopes_im, b * slopes_re + d * slopes_im
        cost += (a * re + 2.0 * b * im) * re + d * im * im
        gradient += weighted_re * re + weighted_im * im
        for i in range(2 * k):
            rows = slice(entry(i, 0), entry(i, i) + 1)
            matrix[rows] += weighted_re[i] * slopes_re[: i + 1] + weighted_im[i] * slopes_im[: i + 1]
    return Linearised(matrix, gradient, cost)


def _summed(parts: Float) -> Float:
    """Return the sum over paths, added in their order, because the order of numpy's sum depends on the shape."""
    total: Float = parts[0].copy()
    for part in parts[1:]:
        total += part
    return total
