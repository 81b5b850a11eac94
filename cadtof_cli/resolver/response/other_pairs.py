"""Other pairs of paths that explain the phasors nearly as well, and the standard deviations that they leave.

A triangle is made of straight pieces, and there phasors do not determine two paths: if the paths lie on neighbouring
pieces of harmonic 2, and on one piece of harmonic 1, all pairs on a line give the same phasors of both. The pulse rounds
the corners off, so that one of these pairs fits best. But what noise does to that pair does not say how far the line
leads. So the line is followed: one path is moved by δ, the other path and both amplitudes are fitted, and the growth of
the misfit, Δχ², gives a standard deviation |δ|/√Δχ². Where phasors are linear in the paths, it is the same for every δ.
If all δ up to some length are as likely, it is that length over √3. This is a profile likelihood (Venzon and Moolgavkar
1988, doi:10.2307/2347496).

All numbers have single precision, as in `newton.py`. `_other_pairs.h` is the compiled twin of `reach`; `reached` calls it.
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float32, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous, extension, is_compiled_for
from cadtof_cli.resolver.paths import CLOSE_ENOUGH, FULL_TURN, Fit
from cadtof_cli.resolver.response.newton import LARGEST_TURN
from cadtof_cli.resolver.response.table import STEP, ResponseBlock
from cadtof_cli.resolver.settings import ResolverSettings

MOVE = np.float32(FULL_TURN / 128)
"""How far a path is moved at a time, rad. One Gauss–Newton step of the other path follows; it can follow corners only in
short moves."""

MOVES = 16
"""Number of moves to either side. A straight piece of harmonic 2 is as long as all of them."""

SETTLED = np.float32(0.15)
"""Turn of the other path in a step, rad, above which it is not fitted, so that the pair does not count."""

FLAT = np.float32(3.0)
"""Least Δχ² by which a move counts: of a line of pairs that are all as likely, the root mean square distance is its length
over √3."""

MOST_MISFIT = np.float32(9.0)
"""Δχ² above which noise hardly makes one pair of paths look like another: three standard deviations."""

SURE_MOVES, LEAST_SHARE = 3, np.float32(0.5)
"""A path is moved on after `SURE_MOVES` as long as Δχ² is below `MOST_MISFIT`, or below this share of what it would be if
phasors were linear in the paths: beyond a corner, it may become small again."""

Pair = tuple[Float32, Float32]
"""Values of both paths, float32 (m,) each."""

Vector = list[Float32]
"""Real and imaginary part at each harmonic, float32 (m,) each. They are multiplied by `WeightedPhasors.ratios`, so that all have
the same noise."""


def widen(
    fit: Fit, phasors: Complex, /, *, noise: NoiseModel, response: ResponseBlock, settings: ResolverSettings
) -> None:
    """Widen the standard deviations of two paths to those of the other pairs that explain their phasors, complex128 (H, n).

    The doubt follows from them. Pixels with one path, or with three and more, stay as they are. By the `settings`, the
    other path may be the direct one in another pair.
    """
    one, two, *more = np.isfinite(fit.paths.amplitude)
    pixels = np.flatnonzero(one & two & ~np.any(more, axis=0))
    if not pixels.size:
        return
    phase_rad, sigma_rad = fit.paths.phase_rad[:2, pixels], fit.paths.sigma_rad[:2, pixels]
    weighted = WeightedPhasors.of(response.block(pixels), phasors[:, pixels], noise[pixels])
    farthest = reached(weighted, phase_rad.astype(np.float32), sigma_rad.astype(np.float32), Rule.of(settings))
    sigma_rad = np.maximum(sigma_rad, farthest)
    fit.paths.sigma_rad[:2, pixels] = sigma_rad
    half = np.abs(np.sin(0.5 * (phase_rad[0] - phase_rad[1])))
    fit.doubt[pixels] = np.maximum(fit.doubt[pixels], np.maximum(*sigma_rad) / (CLOSE_ENOUGH * half))


@dataclass(frozen=True)
class Rule:
    """Which of two paths is the direct one: the first (`sign` 1) or the last (`sign` -1) of those that have at least the
    share `least_ratio` of the other's amplitude. With a share of 1, it is the strongest."""

    least_ratio: np.float32
    sign: np.float32

    @classmethod
    def of(cls, settings: ResolverSettings, /) -> "Rule":
        """Return the rule of the settings, without what `direct_first` does with late echoes."""
        ratio = 1.0 if settings.returns == "strongest" else settings.min_return_ratio
        return cls(np.float32(ratio), np.float32(-1.0 if settings.returns == "last" else 1.0))

    def errors(self, amplitude: Pair, by_rad: Pair, gap_rad: Float32, /) -> Pair:
        """Return how far the direct path and the MPI path of a pair are from those found, rad.

        Both are given in the order of the pair found, whose MPI path comes `gap_rad` after its direct path: their amplitudes,
        and by how much they have moved. If the other path is the direct one in this pair, the two change places.
        """
        direct, mpi = amplitude
        direct_by, mpi_by = by_rad
        order = (gap_rad + mpi_by - direct_by) * self.sign
        swapped = (direct < self.least_ratio * mpi) | ((mpi >= self.least_ratio * direct) & (order < 0.0))
        errors = np.where(swapped, gap_rad + mpi_by, direct_by), np.where(swapped, direct_by - gap_rad, mpi_by)
        return np.abs(errors[0]), np.abs(errors[1])


@dataclass(frozen=True, eq=False)
class WeightedPhasors:
    """The phasors of m pixels as recorded, and their response.

    `per_variance`, (m,), is one over the variance of the first harmonic per channel; `ratios` are the standard deviations
    of the first harmonic over those of each.
    """

    response: ResponseBlock
    phasor: Vector
    per_variance: Float32
    ratios: tuple[np.float32, ...]

    @classmethod
    def of(cls, response: ResponseBlock, phasors: Complex, noise: NoiseModel, /) -> "WeightedPhasors":
        """Return the phasors, complex128 (H, m), as recorded."""
        first = noise.each[0].dark_variance
        ratios = tuple(np.float32(np.sqrt(first / one.dark_variance)) for one in noise.each)
        seen = zip(response.observed(phasors), ratios, strict=True)
        samples = np.ones(phasors.shape[1]) if noise.samples is None else noise.samples
        per_variance: Float32 = (samples / first).astype(np.float32)
        return cls(response, [part * ratio for parts, ratio in seen for part in parts], per_variance, ratios)

    def __getitem__(self, some: Index, /) -> "WeightedPhasors":
        phasor = [part[some] for part in self.phasor]
        return WeightedPhasors(self.response.block(some), phasor, self.per_variance[some], self.ratios)

    def answers(self, phase_rad: Float32, /) -> tuple[Vector, Vector]:
        """Return what paths of amplitude 1 give, and its derivative by the phase."""
        found: Vector = []
        slopes: Vector = []
        for row, ratio in enumerate(self.ratios):
            f = self.response.at(row, phase_rad)
            found += [f.re * ratio, f.im * ratio]
            slopes += [f.slope_re * ratio, f.slope_im * ratio]
        return found, slopes


def reach(weighted: WeightedPhasors, phase_rad: Float32, sigma_rad: Float32, rule: Rule, /) -> Float32:
    """Return the largest standard deviation of the direct and the MPI path that other pairs leave, rad, float32 (2, m).

    It is 0 where the phasors contradict all pairs that are tried. The phases found, and their standard deviations without
    other pairs, are (2, m).
    """
    farthest = np.zeros_like(phase_rad)
    least, _, _ = fit_beside(weighted, weighted.answers(phase_rad[0])[0], *weighted.answers(phase_rad[1]))
    for moved, other in ((0, 1), (1, 0)):
        for side in (-MOVE, MOVE):
            where, here, found, at = np.arange(phase_rad.shape[1]), weighted, phase_rad, phase_rad[other]
            before, usual = least, np.square(MOVE / sigma_rad[moved]) * LEAST_SHARE
            for number in map(np.float32, range(1, MOVES + 1)):
                turned, _ = here.answers(found[moved] + number * side)
                misfit, amplitudes, step = fit_beside(here, turned, *here.answers(at))
                at, grown = at + step, misfit - before
                positive = (amplitudes[0] > 0.0) & (amplitudes[1] > 0.0)
                alike = positive & (grown < MOST_MISFIT) & (np.abs(step) < SETTLED)
                by_rad = np.full_like(at, number * side), at - found[other]
                errors = rule.errors(_in_order(amplitudes, moved), _in_order(by_rad, moved), found[1] - found[0])
                root = np.sqrt(np.maximum(grown, FLAT))
                for path, error in enumerate(errors):
                    farther = alike & (error / root > farthest[path, where])
                    farthest[path, where[farther]] = (error / root)[farther]
                going = np.flatnonzero(alike | (grown < number * number * usual))
                if number >= SURE_MOVES and going.size < where.size:
                    where, here, found, at = where[going], here[going], found[:, going], at[going]
                    before, usual = before[going], usual[going]
    return farthest


def _in_order(values: Pair, moved: int) -> Pair:
    """Return the values of the path that is moved and of the other one as those of the direct path and of the MPI path."""
    return values if moved == 0 else (values[1], values[0])


def fit_beside(
    weighted: WeightedPhasors, moved: Vector, other: Vector, slope: Vector, /
) -> tuple[Float32, Pair, Float32]:
    """Fit both amplitudes and the phase of the other path beside a path that is `moved`, by linear least squares.

    The columns of the problem are `moved`, `other` and `slope`, the derivative of the other path by its phase. Each is
    made orthogonal to those before it (Gram–Schmidt). Return the misfit that is left, the amplitudes of the path that is
    moved and of the other one, and the turn of the other path, rad.
    """
    per_moved = 1.0 / _dot(moved, moved)
    other_along, slope_along, seen_along = (_dot(v, moved) * per_moved for v in (other, slope, weighted.phasor))
    other, slope = _less(other, other_along, moved), _less(slope, slope_along, moved)
    seen = _less(weighted.phasor, seen_along, moved)
    per_other = 1.0 / _dot(other, other)
    slope_across, seen_across = _dot(slope, other) * per_other, _dot(seen, other) * per_other
    slope, seen = _less(slope, slope_across, other), _less(seen, seen_across, other)
    turned = _dot(seen, slope) / _dot(slope, slope)
    seen = _less(seen, turned, slope)
    amplitude = seen_across - turned * slope_across
    beside = seen_along - amplitude * other_along - turned * slope_along
    step = turned / amplitude
    step = np.clip(step, np.float32(-LARGEST_TURN), np.float32(LARGEST_TURN))
    return _dot(seen, seen) * weighted.per_variance, (beside, amplitude), step


def _dot(u: Vector, v: Vector) -> Float32:
    product: Float32 = u[0] * v[0]
    for one, other in zip(u[1:], v[1:], strict=True):
        product = product + one * other
    return product


def _less(u: Vector, share: Float32, v: Vector) -> Vector:
    """Return u − share·v."""
    return [one - share * other for one, other in zip(u, v, strict=True)]


def reached(weighted: WeightedPhasors, phase_rad: Float32, sigma_rad: Float32, rule: Rule, /) -> Float32:
    """Return the result of `reach`, computed by the chosen kernel; all kernels give the same bits."""
    tables = weighted.response.stages[-1]
    if not is_compiled_for(len(tables)):
        return reach(weighted, phase_rad, sigma_rad, rule)
    numbers = [table.harmonic for table in tables]
    shared = [1.0 / STEP, MOVE, rule.least_ratio, rule.sign]
    constants = [*shared, *numbers, *(STEP / number for number in numbers), *weighted.ratios]
    farthest = np.empty(phase_rad.shape, np.float32)
    given = (
        weighted.response.entries,
        weighted.response.phase_rad,
        np.stack(weighted.phasor),
        weighted.per_variance,
        phase_rad,
        sigma_rad,
    )
    extension().follow_pairs(chosen_kernel(), np.array(constants, np.float32), *contiguous(*given), farthest)
    return farthest
