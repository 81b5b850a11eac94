"""Paths under a response that is no pure sine: Gauss–Newton on the exact equations, from the sine's answer.

p_h = Σ_paths a·f_h(x), with f_h tabulated. Subtracting the higher terms again and again does not converge for triangles
(their third harmonic changes four times as fast as the phase it disturbs, by a ninth of the amplitude); Newton's steps do.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.resolver.closed_form import TwoPaths
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath
from cadtof_cli.resolver.response_table import ResponseBlock

TWO_PATH_STEPS = 8
"""Most steps a pixel gets, halvings among them; two or three are what it takes."""

LARGEST_TURN = 0.4
"""Most that one step may turn a path, in rad: a third of the way between neighbouring extremes of a triangle's slope."""

TOLERANCE = 0.03
"""A pixel has converged when what is left of its equations is this share of the noise …"""

ROUNDING = 1e-6
"""… or, for noise-free frames, this share of its phasors: the tables' accuracy."""

_EVERYWHERE = slice(None)

Index = NDArray[np.intp]


def refined_one_path(
    start: OnePath, phasors: Complex, /, *, response: ResponseBlock, noise: NoiseModel, steps: int
) -> OnePath:
    """Return the best single path of every pixel under the full response, from the sine's; NaN stays NaN.

    Least squares of p_h − a·f_h(x) with the noise along and across each phasor as weights. The last step's normal
    equations give the standard deviation, and χ² at the minimum, with 2 degrees of freedom, without evaluating again.

    Args:
        start: the sine's answer.
        phasors: complex128 (2, n), normalised.
        response: of the same pixels.
        noise: of the phasors.
        steps: Gauss–Newton steps.
    """
    observed = response.observed(phasors)
    amplitude, phase = start.amplitude, np.arctan2(start.sin, start.cos)
    chi_squared = sigma = np.empty_like(amplitude)
    for _ in range(steps):
        step = _one_path_step(amplitude, phase, observed, response, noise)
        sigma = step.spread / np.maximum(amplitude, np.finfo(np.float64).tiny)
        turn = np.clip(step.turn / np.maximum(amplitude, np.finfo(np.float64).tiny), -LARGEST_TURN, LARGEST_TURN)
        phase = phase + turn
        amplitude = np.maximum(amplitude + step.growth, 0.0)
        chi_squared = step.chi_squared
    return OnePath(amplitude, np.cos(phase), np.sin(phase), sigma, chi_squared)


@dataclass(frozen=True)
class _OnePathStep:
    """Changes of amplitude and of amplitude × phase, the latter's standard deviation, and χ² after the step: (n,) each."""

    growth: Float
    turn: Float
    spread: Float
    chi_squared: Float


def _one_path_step(
    amplitude: Float, phase: Float, observed: Complex, response: ResponseBlock, noise: NoiseModel
) -> _OnePathStep:
    n11 = n12 = n22 = g1 = g2 = chi = np.float64(0.0)
    for row, harmonic in enumerate(noise.harmonics):
        value, slope = response.at(row, phase, _EVERYWHERE)
        modulus = np.sqrt(value.real**2 + value.imag**2)
        back = np.conj(value) / modulus
        left = (observed[row] - amplitude * value) * back
        column = slope * back
        along, across = harmonic.one_path_variances(amplitude)
        w_along, w_across = 1.0 / along, 1.0 / across
        n11 = n11 + modulus * modulus * w_along
        n12 = n12 + modulus * column.real * w_along
        n22 = n22 + column.real**2 * w_along + column.imag**2 * w_across
        g1 = g1 + modulus * left.real * w_along
        g2 = g2 + column.real * left.real * w_along + column.imag * left.imag * w_across
        chi = chi + left.real**2 * w_along + left.imag**2 * w_across
    scale = 1.0 / (n11 * n22 - n12 * n12)
    growth, turn = (n22 * g1 - n12 * g2) * scale, (n11 * g2 - n12 * g1) * scale
    return _OnePathStep(growth, turn, np.sqrt(n11 * scale), chi - growth * g1 - turn * g2)


@dataclass(frozen=True)
class RefinedPaths:
    """Two paths under the full response; `failed` marks pixels whose equations were not met, bool (n,)."""

    paths: TwoPaths
    failed: Bool


def refined_two_paths(
    start: TwoPaths, phasors: Complex, chosen: Bool, /, *, response: ResponseBlock, noise: NoiseModel
) -> RefinedPaths:
    """Return two paths that meet the four exact equations in the chosen pixels; the others keep their start.

    A step that does not bring a pixel closer is halved; a pixel is done, and costs nothing more, when what is left of its
    equations is well below the noise. Those that are not done after `TWO_PATH_STEPS` keep their best and are marked.

    Args:
        start: the sine's answer.
        phasors: complex128 (2, n), normalised.
        chosen: bool (n,), pixels that have two paths.
        response: of the same n pixels.
        noise: of the phasors; it decides when a pixel is done.
    """
    pixels = np.flatnonzero(chosen)
    failed = np.zeros(chosen.shape, np.bool_)
    if not pixels.size:
        return RefinedPaths(start, failed)
    observed = response.observed(phasors)
    best = _Search(start, observed, pixels, response, noise).run()
    failed[pixels] = ~best.done
    a, x, b, y = best.state
    values = (a, b, np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(0.5 * (x - y)), np.sin(0.5 * (x - y)))
    names = ("a", "b", "cos_x", "sin_x", "cos_y", "sin_y", "cos_half", "sin_half")
    changed = {name: getattr(start, name).copy() for name in names}
    for name, refined in zip(names, values, strict=True):
        changed[name][pixels] = refined
    return RefinedPaths(replace(start, **changed), failed)


class _Search:
    """The state of a block's search: a, x, b, y of every chosen pixel, and which of them are still going on."""

    def __init__(
        self, start: TwoPaths, observed: Complex, pixels: Index, response: ResponseBlock, noise: NoiseModel
    ) -> None:
        self._response, self._pixels = response, pixels
        self._observed = observed[:, pixels]
        self._weights = tuple(1.0 / harmonic.dark_variance for harmonic in noise.harmonics)
        x = np.arctan2(start.sin_x[pixels], start.cos_x[pixels])
        y = np.arctan2(start.sin_y[pixels], start.cos_y[pixels])
        self.state = np.stack([start.a[pixels], x, start.b[pixels], y])
        self.done = np.zeros(pixels.size, np.bool_)
        power = sum(w * np.abs(p) ** 2 for w, p in zip(self._weights, self._observed, strict=True))
        self._enough = np.maximum(TOLERANCE**2, ROUNDING**2 * np.asarray(power))

    def run(self) -> "_Search":
        """Search until every pixel is done or has had its steps."""
        active = np.arange(self._pixels.size)
        trial, step = self.state.copy(), np.zeros_like(self.state)
        least = np.full(active.size, np.inf)
        for _ in range(TWO_PATH_STEPS + 1):
            fields = [self._fields(trial, row, active) for row in range(2)]
            misfit = sum(w * np.abs(field.left) ** 2 for w, field in zip(self._weights, fields, strict=True))
            better = ~(misfit >= least)
            self.state[:, active[better]] = trial[:, better]
            least = np.where(better, misfit, least)
            self.done[active] = least <= self._enough[active]
            step = np.where(better, _newton_step(fields[0], fields[1], trial), 0.5 * step)
            going = ~self.done[active] & np.isfinite(step).all(axis=0)
            active, step, least = active[going], step[:, going], least[going]
            if not active.size:
                break
            trial = self.state[:, active] + step
            np.maximum(trial[::2], 0.1 * self.state[::2, active], out=trial[::2])
        return self

    def _fields(self, state: Float, row: int, active: Index) -> "_Fields":
        a, x, b, y = state
        pixels = self._pixels[active]
        fx, dx = self._response.at(row, x, pixels)
        fy, dy = self._response.at(row, y, pixels)
        return _Fields(fx, dx, fy, dy, self._observed[row, active] - a * fx - b * fy)


@dataclass(frozen=True)
class _Fields:
    """One harmonic's answer to either path, its derivatives by their phases, and what the paths leave: complex (n,)."""

    fx: Complex
    dx: Complex
    fy: Complex
    dy: Complex
    left: Complex


def _minor(p: Complex, q: Complex) -> Float:
    """Return the determinant of the real 2 × 2 matrix whose columns are p and q."""
    return np.asarray(p.real * q.imag - p.imag * q.real)


def _newton_step(first: _Fields, second: _Fields, state: Float) -> Float:
    """Solve the four real equations for the changes of a, x, b, y, (4, n), by Laplace's expansion into 2 × 2 minors.

    With columns A = f(x), B = f'(x), C = f(y), D = f'(y) in either harmonic, det(A, B, C, D) is the sum over pairs of columns
    of a minor in the first harmonic times the complementary minor in the second.
    """
    pairs = [
        (_minor(f.fx, f.dx), _minor(f.fx, f.fy), _minor(f.fx, f.dy), _minor(f.dx, f.fy), _minor(f.dx, f.dy), _minor(f.fy, f.dy))
        for f in (first, second)
    ]
    (ab1, ac1, ad1, bc1, bd1, cd1), (ab2, ac2, ad2, bc2, bd2, cd2) = pairs
    ra1, rb1, rc1, rd1 = (_minor(first.left, column) for column in (first.fx, first.dx, first.fy, first.dy))
    ra2, rb2, rc2, rd2 = (_minor(second.left, column) for column in (second.fx, second.dx, second.fy, second.dy))
    with np.errstate(all="ignore"):
        scale = 1.0 / (ab1 * cd2 - ac1 * bd2 + ad1 * bc2 + bc1 * ad2 - bd1 * ac2 + cd1 * ab2)
        grow_a = rb1 * cd2 - rc1 * bd2 + rd1 * bc2 + bc1 * rd2 - bd1 * rc2 + cd1 * rb2
        turn_x = -ra1 * cd2 - ac1 * rd2 + ad1 * rc2 + rc1 * ad2 - rd1 * ac2 - cd1 * ra2
        grow_b = ab1 * rd2 + ra1 * bd2 - ad1 * rb2 - rb1 * ad2 + bd1 * ra2 + rd1 * ab2
        turn_y = -ab1 * rc2 + ac1 * rb2 - ra1 * bc2 - bc1 * ra2 + rb1 * ac2 - rc1 * ab2
        step = np.stack([grow_a, turn_x / state[0], grow_b, turn_y / state[2]]) * scale
        return step * np.minimum(1.0, LARGEST_TURN / np.maximum(np.abs(step[1]), np.abs(step[3])))
