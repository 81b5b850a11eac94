"""Newton's method on the four real equations of two paths under any response, for many pixels at once.

The unknowns are amplitude and fundamental phase of both paths: p_h = a·f_h(x) + b·f_h(y), h = 1, 2, with f_h tabulated.
All numbers have single precision: the rounding is far below the noise of any frame, and it halves the time. `_newton.h`
is the compiled twin of `search`; `searched` calls it.
"""

from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float32, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, contiguous, extension
from cadtof_cli.resolver.response.table import STEP, Answer, ResponseBlock

LARGEST_TURN = 0.4
"""Largest turn of a path in one step, rad: a third of the way between neighbouring extremes of a triangle's slope."""

LARGEST_LOSS = 0.1
"""Smallest share of its amplitude that a path keeps in one step, so that no path vanishes when a step overshoots."""

TOLERANCE = 0.3
"""A pixel has converged when the residual before its last step is at most this share of the noise of its phasors …"""

ROUNDING = 2e-6
"""… or, in frames without noise, this share of its phasors: the rounding of single precision."""

STILL_WORTH = 0.8
"""Pixels that are done are dropped when the share of pixels still in work falls below this."""


@dataclass(frozen=True, eq=False)
class SearchState:
    """State of the search for m pixels: rows a, x, b, y of `values`, float32 (4, m); misfit; which pixels are done."""

    values: Float32
    misfit: Float32
    done: Bool

    def put(self, some: Index, other: "SearchState", /) -> None:
        """Overwrite the pixels with these indices."""
        self.values[:, some], self.misfit[some], self.done[some] = other.values, other.misfit, other.done


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of m pixels: their response, their phasors, and the misfit at which a pixel is done.

    `observed` is float32 (4, m): real and imaginary part of the first phasor, then of the second. `enough`, (m,), is
    that misfit.
    """

    response: ResponseBlock
    observed: Float32
    enough: Float32
    weights: tuple[np.float32, ...]

    @staticmethod
    def of(response: ResponseBlock, phasors: Complex, noise: NoiseModel, /) -> "Equations":
        """Return the equations of pixels with these phasors, (2, m)."""
        observed = response.observed(phasors)
        weights = tuple(np.float32(1.0 / harmonic.dark_variance) for harmonic in noise.each)
        power = sum(weight * (re**2 + im**2) for weight, (re, im) in zip(weights, observed, strict=True))
        samples = np.float32(1.0) if noise.samples is None else noise.samples.astype(np.float32)
        enough = np.maximum(np.float32(TOLERANCE**2) / samples, np.float32(ROUNDING**2) * power)
        return Equations(response, np.concatenate(observed), enough, weights)

    def __getitem__(self, some: Bool | Index) -> "Equations":
        return replace(
            self, response=self.response.block(some), observed=self.observed[:, some], enough=self.enough[some]
        )

    def fields(self, values: Float32, row: int, stage: int, /) -> "Fields":
        """Return the answers and residuals of one harmonic for paths `values`, (4, m)."""
        a, x, b, y = values
        fx, fy = (self.response.at(row, phase, stage=stage) for phase in (x, y))
        left_re = self.observed[2 * row] - a * fx.re
        left_im = self.observed[2 * row + 1] - a * fx.im
        left_re -= b * fy.re
        left_im -= b * fy.im
        return Fields(fx, fy, left_re, left_im)


@dataclass(frozen=True, eq=False)
class Fields:
    """The answers of one harmonic to the two paths, and the residual of its phasor: float32 (m,)."""

    x: Answer
    y: Answer
    left_re: Float32
    left_im: Float32

    @property
    def left2(self) -> Float32:
        """Squared modulus of the residual."""
        return self.left_re * self.left_re + self.left_im * self.left_im


def search(equations: Equations, start: Float32, /, *, steps: int, stage: int = -1) -> SearchState:
    """Return the state after at most `steps` steps from the start, values (4, m).

    A step that does not lower the misfit is halved. A pixel that is done takes one more step, which is not evaluated:
    it starts from a tiny residual, and Newton's steps leave second-order errors. Pixels that are done stay in the
    arrays until dropping them pays off.
    """
    count = start.shape[1]
    found = SearchState(start.copy(), np.full(count, np.inf, np.float32), np.zeros(count, np.bool_))
    where, going = np.arange(count), np.ones(count, np.bool_)
    trial, values, misfit, step = start, start, found.misfit, np.zeros_like(start)
    for number in range(steps + 1):
        first, second = (equations.fields(trial, row, stage) for row in range(2))
        left = equations.weights[0] * first.left2 + equations.weights[1] * second.left2
        closer = left < misfit
        values, misfit = np.where(closer, trial, values), np.where(closer, left, misfit)
        step = np.where(closer, newton_step(first, second, trial), np.float32(0.5) * step)
        trial = stepped(values, step)
        done = going & (left <= equations.enough)
        if done.any():
            # if the two paths coincide, there is no finite step
            unseen = np.where(np.isfinite(trial).all(axis=0), trial, values)
            found.put(where[done], SearchState(unseen[:, done], misfit[done], done[done]))
            going = going & ~done
        remaining = np.count_nonzero(going)
        if number == steps or not remaining:
            break
        if remaining < STILL_WORTH * where.size:
            where, equations, misfit = where[going], equations[going], misfit[going]
            trial, values, step = trial[:, going], values[:, going], step[:, going]
            going = going[going]
    found.put(where[going], SearchState(values[:, going], misfit[going], np.zeros(remaining, np.bool_)))
    return found


def stepped(values: Float32, step: Float32, /) -> Float32:
    """Return values + step, (4, m); amplitudes stay above 0."""
    after = values + step
    amplitudes, least = after[::2], np.float32(LARGEST_LOSS) * values[::2]
    # not `np.maximum`: which of 0 and -0 it returns depends on the processor
    np.copyto(amplitudes, least, where=amplitudes <= least)
    return after


def newton_step(first: Fields, second: Fields, values: Float32, /) -> Float32:
    """Solve the four real equations for the changes of a, x, b, y, (4, m).

    This is Cramer's rule with Laplace's expansion of the determinants: det(A, B, C, D) is a sum over pairs of columns.
    Each term is a minor of the first harmonic times the complementary minor of the second, with alternating signs.
    """
    ab1, ac1, ad1, bc1, bd1, cd1, ra1, rb1, rc1, rd1 = _minors(first)
    ab2, ac2, ad2, bc2, bd2, cd2, ra2, rb2, rc2, rd2 = _minors(second)
    scale = 1.0 / (ab1 * cd2 - ac1 * bd2 + ad1 * bc2 + bc1 * ad2 - bd1 * ac2 + cd1 * ab2)
    step = np.empty_like(values)
    step[0] = (rb1 * cd2 - rc1 * bd2 + rd1 * bc2 + bc1 * rd2 - bd1 * rc2 + cd1 * rb2) * scale
    step[1] = (ad1 * rc2 + rc1 * ad2 - ra1 * cd2 - ac1 * rd2 - rd1 * ac2 - cd1 * ra2) * scale / values[0]
    step[2] = (ab1 * rd2 + ra1 * bd2 - ad1 * rb2 - rb1 * ad2 + bd1 * ra2 + rd1 * ab2) * scale
    step[3] = (ac1 * rb2 - ab1 * rc2 - ra1 * bc2 - bc1 * ra2 + rb1 * ac2 - rc1 * ab2) * scale / values[2]
    step *= np.minimum(1.0, LARGEST_TURN / np.maximum(np.abs(step[1]), np.abs(step[3])))
    return step


def _minors(fields: Fields) -> tuple[Float32, ...]:
    """Return the determinants of pairs of columns of one harmonic: ab, ac, ad, bc, bd, cd, then ra, rb, rc, rd.

    The columns are the real and imaginary parts of A = f(x), B = f'(x), C = f(y), D = f'(y) and the residual R.
    """
    x, y = fields.x, fields.y
    a, b, c, d = (x.re, x.im), (x.slope_re, x.slope_im), (y.re, y.im), (y.slope_re, y.slope_im)
    r = (fields.left_re, fields.left_im)
    pairs = ((a, b), (a, c), (a, d), (b, c), (b, d), (c, d), (r, a), (r, b), (r, c), (r, d))
    return tuple(p[0] * q[1] - p[1] * q[0] for p, q in pairs)


def searched(equations: Equations, start: Float32, /, *, steps: int, stage: int = -1) -> SearchState:
    """Return the result of `search`, computed by the chosen kernel; all kernels give the same bits."""
    response, kernel = equations.response, chosen_kernel()
    if kernel == NUMPY:
        return search(equations, start, steps=steps, stage=stage)
    tables = response.stages[stage]
    numbers = [table.harmonic for table in tables]
    constants = [*numbers, *(STEP / number for number in numbers), 1.0 / STEP, *equations.weights]
    count = start.shape[1]
    values, misfit, done = np.empty((4, count), np.float32), np.empty(count, np.float32), np.empty(count, np.bool_)
    given = (*(table.entries for table in tables), response.phase_rad, equations.observed, equations.enough, start)
    extension().search(
        kernel,
        steps,
        np.array(constants, np.float32),
        *contiguous(*given),
        values,
        misfit,
        done,
    )
    return SearchState(values, misfit, done)
