"""Paths from other harmonics than 1 and 2, for channel pairs whose response is no pure sine: maximum likelihood.

Two paths have as many unknowns as two harmonics give equations, and `two_paths.py` solves these. More harmonics give more
equations. The search here minimises their misfit, as `likelihood/` does for a sine, with the answers f_h of the response
and their derivatives in place of exp(ihx).
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import Rotor
from cadtof_cli.resolver.kernels import contiguous
from cadtof_cli.resolver.likelihood.k_paths import SEARCH, LikelyPaths, acceptable_misfit, likely_paths
from cadtof_cli.resolver.likelihood.k_paths import found_paths as paths_of_sine
from cadtof_cli.resolver.likelihood.kernel import RESPONSE
from cadtof_cli.resolver.likelihood.mixture import Measured, Mixture, WeightedFit, equations_of, moved_paths
from cadtof_cli.resolver.likelihood.normal_equations import Linearised
from cadtof_cli.resolver.likelihood.solver import SURELY_MORE
from cadtof_cli.resolver.likelihood.starts import exact_start, strongest_path
from cadtof_cli.resolver.paths import Fit, Paths
from cadtof_cli.resolver.response.as_sine import phasors_of_sine
from cadtof_cli.resolver.response.table import ResponseBlock
from cadtof_cli.resolver.two_path.arcsine import phase_of

SHARES = (0.7, 0.3)
"""Shares of the light of a path that the first of two near paths gets, when the path is split into them."""

DISTANCES_RAD = tuple(math.pi / 16.0 * steps for steps in (1, 2, 3, 4, 6, 8))
"""Distances of two such paths, from a 32nd to a quarter of the longest period."""


class ResponseLikelihood:
    """Maximum likelihood with the full response as a solver for a block of phasors, complex128 (N, n)."""

    def __init__(self, phasors: Complex, /, *, noise: NoiseModel, response: ResponseBlock, **_others: object) -> None:
        self._recorded = Recorded(phasors, noise, response)
        measured = self._recorded.measured
        self.powers = [re * re + im * im for re, im in zip(measured.re, measured.im, strict=True)]
        self.modulus = np.sqrt(self.powers[0])

    def fit(self, count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit any number of paths (see `Solver`)."""
        chosen: Index = np.flatnonzero(pixels)
        found, misfit = found_paths(self._recorded[chosen], count)
        if limit is not None:
            maybe = np.flatnonzero(misfit <= SURELY_MORE * np.broadcast_to(limit, pixels.shape)[chosen])
            chosen, found = chosen[maybe], found[maybe]
        return chosen, most_likely(self._recorded[chosen], found).fit()


solver = ResponseLikelihood


@dataclass(frozen=True)
class Recorded:
    """Phasors of n pixels, complex128 (N, n), with their noise and response."""

    phasors: Complex
    noise: NoiseModel
    response: ResponseBlock

    def __getitem__(self, chosen: Index, /) -> "Recorded":
        return Recorded(self.phasors[:, chosen], self.noise[chosen], self.response.block(chosen))

    @property
    def measured(self) -> Measured:
        """The phasors as the search needs them."""
        return Measured.of_phasors(self.phasors, harmonics=self.noise.harmonics)

    @property
    def weights(self) -> list[float]:
        """The weight of each harmonic with white noise."""
        return [1.0 / one.dark_variance for one in self.noise.each]

    def as_sine(self, paths: Mixture, /) -> Measured:
        """Return the phasors without the terms beyond a sine that light on these paths gives."""
        light = Paths(paths.amplitude, phase_of(paths.cos, paths.sin), np.zeros_like(paths.amplitude))
        sine = phasors_of_sine(self.phasors, light, response=self.response)
        return Measured.of_phasors(sine, harmonics=self.noise.harmonics)

    def searched(self, starts: Mixture, /) -> tuple[Mixture, Float]:
        """Return where a search with white noise ends, and the misfit there, (n,)."""
        weights = np.zeros((3, *self.phasors.shape))
        for row, weight in enumerate(self.weights):
            weights[::2, row] = weight
        problem = ResponseFit(self.measured, weights, self.response)
        end = SEARCH.solve(problem, starts.points, samples=self.noise.samples)
        return Mixture.of_points(end.points), end.cost


def found_paths(recorded: Recorded, count: int, /) -> tuple[Mixture, Float]:
    """Return the `count` paths that fit best with white noise, and their misfit, (n,).

    One path starts from the best delay of a grid. For more paths, the phasors are freed of the terms beyond a sine, as if
    the light came on one path fewer, and the search starts from the paths that a sine would give then. Where the misfit is
    one that noise seldom has, it starts again, from `_other_starts`: near paths have several minima.
    """
    noise = recorded.noise
    if count == 1:
        return recorded.searched(strongest_path(recorded.measured, weights=recorded.weights))
    fewer, _ = found_paths(recorded, count - 1)
    sine = recorded.as_sine(fewer)
    found, misfit = recorded.searched(exact_start(sine, paths=count) or paths_of_sine(sine, count, noise=noise)[0])
    for other_start in _other_starts(count, len(noise.each)):
        suspect = np.flatnonzero(misfit > acceptable_misfit(count, noise))
        if suspect.size:
            some, points = recorded[suspect], found.points
            again, lower = some.searched(other_start(some, found[suspect], fewer[suspect]))
            better = lower < misfit[suspect]
            points[:, suspect[better]], misfit[suspect[better]] = again.points[:, better], lower[better]
            found = Mixture.of_points(points)
    return found, misfit


def _other_starts(count: int, harmonics: int) -> list[Callable[[Recorded, Mixture, Mixture], Mixture]]:
    """Return the functions that give further starts, from the paths just found and from one path fewer.

    As many paths as harmonics may have several exact answers. Then nothing tells which one is right, and no other start
    finds a better one.
    """
    if count == harmonics:
        return [_of_freed_phasors]
    split = itertools.product(SHARES, DISTANCES_RAD, range(count - 1))
    return [_of_freed_phasors, *(partial(_split, row, share, distance) for share, distance, row in split)]


def _of_freed_phasors(recorded: Recorded, found: Mixture, _fewer: Mixture, /) -> Mixture:
    """Return the paths of a sine, in phasors freed of the terms of the paths just found."""
    return paths_of_sine(recorded.as_sine(found), len(found.amplitude), noise=recorded.noise)[0]


def _split(
    row: int, share: float, distance_rad: float, _recorded: Recorded, _found: Mixture, fewer: Mixture, /
) -> Mixture:
    """Return one path fewer, of which the one in `row` is split into two that keep its light and its mean delay.

    The first of the two has this share of the light, and comes this distance before the second.
    """
    cos, sin, pieces = fewer.cos[row], fewer.sin[row], []
    for part, by_rad in ((share, (share - 1.0) * distance_rad), (1.0 - share, share * distance_rad)):
        c, s = math.cos(by_rad), math.sin(by_rad)
        pieces.append((part * fewer.amplitude[row], cos * c - sin * s, sin * c + cos * s))
    points = np.stack((fewer.amplitude, fewer.cos, fewer.sin))
    points[:, row] = pieces[0]
    return Mixture(*np.concatenate((points, np.stack(pieces[1])[:, np.newaxis]), axis=1))


def most_likely(recorded: Recorded, found: Mixture, /) -> LikelyPaths:
    """Return the maximum of the likelihood next to the paths `found`, with the noise of the light of these paths."""
    measured, noise = recorded.measured, recorded.noise
    weights = WeightedFit.around(measured, found, noise=noise).weights
    return likely_paths(ResponseFit(measured, weights, recorded.response), found, noise=noise)


@dataclass(frozen=True)
class ResponseFit:
    """The fit of paths with the full response, a `Problem` of the search; `weights` are those of `WeightedFit`."""

    kind: ClassVar[int] = RESPONSE

    measured: Measured
    weights: Float
    response: ResponseBlock

    def linearised(self, points: Float, /) -> Linearised:
        """Return the normal equations."""
        paths = Mixture.of_points(points)
        return equations_of(self.measured, self.weights, paths.amplitude, self._answers(paths))

    moved = staticmethod(moved_paths)

    def __getitem__(self, chosen: Index, /) -> Self:
        return type(self)(self.measured[chosen], self.weights[:, :, chosen], self.response.block(chosen))

    @property
    def response_arrays(self) -> tuple[NDArray[Any] | None, ...]:
        """The tables, (N, ENTRIES, 4), and the own phases of the pixels and their rotors, (N, n) each, if they have any."""
        return self.response.entries, *contiguous(self.response.phase_rad, self.response.rotors)

    def strengths(self, path: Mixture, /) -> Iterator[tuple[Float, Float]]:
        """Yield, for each harmonic, the amplitude along one path and the square of its answer to amplitude 1, (n,) each."""
        answers = (value for value, _slope in self._answers(path))
        for re, im, ((f_re,), (f_im,)) in zip(self.measured.re, self.measured.im, answers, strict=True):
            power = f_re * f_re + f_im * f_im
            yield (re * f_re + im * f_im) / power, power

    def _answers(self, paths: Mixture) -> Iterator[tuple[Rotor, Rotor]]:
        """Yield what a path of amplitude 1 gives at each harmonic, and its derivative by the phase, (K, n) each part."""
        phase: Float32 = phase_of(paths.cos, paths.sin).astype(np.float32)
        for row in range(len(self.measured.harmonics)):
            f = self.response.at(row, phase)
            yield self.response.turned_back(row, f.re, f.im), self.response.turned_back(row, f.slope_re, f.slope_im)
