"""Paths under a response that is no pure sine: Gauss–Newton on the exact equations, from the sine's answer.

p_h = Σ_paths a·f_h(x), with f_h tabulated. Subtracting the higher terms again and again does not converge for triangles
(their third harmonic changes four times as fast as the phase it disturbs, by a ninth of the amplitude); Newton's steps do.
Single precision throughout: its rounding is far below the noise of any frame, and it halves the time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Complex, Float32
from cadtof_cli.resolver.closed_form import TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.noise import NoiseModel
from cadtof_cli.resolver.one_path import OnePath
from cadtof_cli.resolver.response_table import STAGES, Answer, ResponseBlock

MOST_STEPS = 6
"""Most steps a pixel gets from one start, halvings among them; two or three are what it takes."""

STAGE_STEPS = 8
"""Most steps at each stage on the way from a sine to the response."""

STAGE_TOLERANCE = 10.0
"""How much more than `TOLERANCE` may be left where the next stage moves the paths anyway."""

LARGEST_TURN = 0.4
"""Most that one step may turn a path, in rad: a third of the way between neighbouring extremes of a triangle's slope."""

TOLERANCE = 0.03
"""A pixel has converged when what is left of its equations is this share of the noise …"""

ROUNDING = 2e-6
"""… or, for noise-free frames, this share of its phasors: the rounding of single precision."""

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
        steps: Gauss–Newton steps, 1 or more.
    """
    observed = response.observed(phasors)
    amplitude, phase = start.amplitude.astype(np.float32), _angle(start.cos, start.sin)
    tiny = np.finfo(np.float32).tiny
    for _ in range(steps):
        step = _one_path_step(amplitude, phase, observed, response, noise)
        inverse = 1.0 / np.maximum(amplitude, tiny)
        sigma = step.spread * inverse
        phase = phase + np.clip(step.turn * inverse, -LARGEST_TURN, LARGEST_TURN)
        amplitude = np.maximum(amplitude + step.growth, 0.0)
    return OnePath(
        amplitude.astype(np.float64),
        np.cos(phase, dtype=np.float64),
        np.sin(phase, dtype=np.float64),
        sigma.astype(np.float64),
        step.chi_squared.astype(np.float64),
    )


@dataclass(frozen=True, eq=False)
class _OnePathStep:
    """Changes of amplitude and of amplitude × phase, the latter's standard deviation, and χ² after the step: (n,) each."""

    growth: Float32
    turn: Float32
    spread: Float32
    chi_squared: Float32


def _one_path_step(
    amplitude: Float32,
    phase: Float32,
    observed: tuple[tuple[Float32, Float32], ...],
    response: ResponseBlock,
    noise: NoiseModel,
) -> _OnePathStep:
    """Return one Gauss–Newton step; each harmonic's equations are turned so that its answer is real."""
    n11, n12, n22, g1, g2, chi = np.zeros((6, amplitude.size), np.float32)
    for row, harmonic in enumerate(noise.harmonics):
        f = response.at(row, phase, _EVERYWHERE)
        re, im = observed[row]
        left_re, left_im = re - amplitude * f.re, im - amplitude * f.im
        modulus = np.sqrt(f.re * f.re + f.im * f.im)
        cos, sin = f.re / modulus, f.im / modulus
        left_re, left_im = left_re * cos + left_im * sin, left_im * cos - left_re * sin
        slope_re, slope_im = f.slope_re * cos + f.slope_im * sin, f.slope_im * cos - f.slope_re * sin
        along, across = harmonic.one_path_variances(amplitude)
        w_along, w_across = 1.0 / along, 1.0 / across
        n11 += modulus * modulus * w_along
        n12 += modulus * slope_re * w_along
        n22 += slope_re * slope_re * w_along + slope_im * slope_im * w_across
        g1 += modulus * left_re * w_along
        g2 += slope_re * left_re * w_along + slope_im * left_im * w_across
        chi += left_re * left_re * w_along + left_im * left_im * w_across
    scale = 1.0 / (n11 * n22 - n12 * n12)
    growth, turn = (n22 * g1 - n12 * g2) * scale, (n11 * g2 - n12 * g1) * scale
    return _OnePathStep(growth, turn, np.sqrt(n11 * scale), chi - growth * g1 - turn * g2)


@dataclass(frozen=True, eq=False)
class RefinedPaths:
    """Two paths under the full response; `failed` marks pixels whose equations were not met, bool (n,)."""

    paths: TwoPaths
    failed: Bool


def refined_two_paths(
    alone: OnePath, phasors: Complex, chosen: Bool, /, *, response: ResponseBlock, noise: NoiseModel
) -> RefinedPaths:
    """Return two paths that meet the four exact equations in the chosen pixels; in the others, the sine's.

    The search starts from the closed form after the higher terms of the best single path have been subtracted. A step that
    does not bring a pixel closer is halved; a pixel is done, and costs nothing more, when what is left of its equations is
    well below the noise. Those that are not done are led from the sine's answer to the response's in `STAGES`. What
    still is not done keeps its best and is marked.

    Args:
        alone: the best single path.
        phasors: complex128 (2, n), normalised.
        chosen: bool (n,), pixels that have two paths.
        response: of the same n pixels.
        noise: of the phasors; it decides when a pixel is done.
    """
    start = two_paths(fundamental_frame(*_sine_part(alone, phasors, response)))
    pixels = np.flatnonzero(chosen & ~start.single)
    failed = np.zeros(chosen.shape, np.bool_)
    if not pixels.size:
        return RefinedPaths(start, failed)
    equations = _Equations(response, response.observed(phasors), noise)
    found = _search(equations, _State.of(start, pixels), pixels, steps=MOST_STEPS)
    again = np.flatnonzero(~found.done)
    if again.size:
        places = pixels[again]
        turned = fundamental_frame(np.ascontiguousarray(phasors[0, places]), np.ascontiguousarray(phasors[1, places]))
        led = _State.of(two_paths(turned), _EVERYWHERE)
        for stage in range(len(STAGES)):
            led = _search(equations, led, places, steps=STAGE_STEPS, stage=stage)
        better = led.misfit < found.misfit[again]
        found.values[:, again[better]] = led.values[:, better]
        found.done[again[better]] = led.done[better]
    failed[pixels] = ~found.done
    return RefinedPaths(found.put_into(start, pixels), failed)


def _sine_part(alone: OnePath, phasors: Complex, response: ResponseBlock) -> Complex:
    """Return what phasors, (2, n), would be with k = 1 alone, if all light came by the best single path."""
    phase = _angle(alone.cos, alone.sin)
    cleaned = np.empty_like(phasors)
    turn = alone.cos + 1j * alone.sin
    for row in range(len(phasors)):
        f = response.at(row, phase, _EVERYWHERE)
        higher = f.re + 1j * f.im
        if response.rotors is not None:
            higher = higher * np.conj(response.rotors[row])
        harmonic = response.stages[-1][row].harmonic
        cleaned[row] = phasors[row] - alone.amplitude * (higher - turn**harmonic)
    return cleaned


@dataclass(frozen=True, eq=False)
class _State:
    """Amplitudes and phases of two paths: rows a, x, b, y of `values`, float32 (4, m); their misfit; whether it is done."""

    values: Float32
    misfit: Float32
    done: Bool

    @staticmethod
    def of(paths: TwoPaths, pixels: Index | slice) -> "_State":
        x = _angle(paths.cos_x[pixels], paths.sin_x[pixels])
        y = _angle(paths.cos_y[pixels], paths.sin_y[pixels])
        values = np.stack([paths.a[pixels], x, paths.b[pixels], y]).astype(np.float32)
        return _State(values, np.full(x.shape, np.inf, np.float32), np.zeros(x.shape, np.bool_))

    def put_into(self, paths: TwoPaths, pixels: Index) -> TwoPaths:
        a, x, b, y = self.values.astype(np.float64)
        half = 0.5 * (x - y)
        values = (a, b, np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(half), np.sin(half))
        planes = (paths.a, paths.b, paths.cos_x, paths.sin_x, paths.cos_y, paths.sin_y, paths.cos_half, paths.sin_half)
        changed = []
        for plane, refined in zip(planes, values, strict=True):
            changed.append(plane.copy())
            changed[-1][pixels] = refined
        return TwoPaths(*changed, paths.single)


@dataclass(frozen=True, eq=False)
class _Equations:
    """What the paths of a block must meet."""

    response: ResponseBlock
    observed: tuple[tuple[Float32, Float32], ...]
    noise: NoiseModel

    def weights(self) -> list[np.float32]:
        return [np.float32(1.0 / harmonic.dark_variance) for harmonic in self.noise.harmonics]

    def enough(self, pixels: Index) -> Float32:
        """Return the misfit at which a pixel is done."""
        power = np.zeros(pixels.size, np.float32)
        for (re, im), weight in zip(self.observed, self.weights(), strict=True):
            power += weight * (re[pixels] ** 2 + im[pixels] ** 2)
        return np.maximum(np.float32(TOLERANCE**2), np.float32(ROUNDING**2) * power)

    def fields(self, values: Float32, row: int, pixels: Index, stage: int) -> "_Fields":
        a, x, b, y = values
        fx = self.response.at(row, x, pixels, stage=stage)
        fy = self.response.at(row, y, pixels, stage=stage)
        re, im = self.observed[row]
        return _Fields(fx, fy, re[pixels] - a * fx.re - b * fy.re, im[pixels] - a * fx.im - b * fy.im)


@dataclass(frozen=True, eq=False)
class _Fields:
    """One harmonic's answer to either path, and what the paths leave of its phasor: float32 (m,)."""

    x: Answer
    y: Answer
    left_re: Float32
    left_im: Float32

    @property
    def left2(self) -> Float32:
        return self.left_re * self.left_re + self.left_im * self.left_im


def _search(equations: _Equations, start: _State, pixels: Index, *, steps: int, stage: int = -1) -> _State:
    """Return the state after at most so many steps from the start."""
    weights, enough = equations.weights(), equations.enough(pixels)
    if stage not in {-1, len(STAGES) - 1}:
        enough *= np.float32(STAGE_TOLERANCE**2)
    values, misfit, done = start.values.copy(), np.full(pixels.size, np.inf, np.float32), np.zeros(pixels.size, np.bool_)
    active = np.arange(pixels.size)
    trial, step, least = values, np.zeros_like(values), misfit
    for count in range(steps + 1):
        first, second = (equations.fields(trial, row, pixels[active], stage) for row in range(2))
        left = weights[0] * first.left2 + weights[1] * second.left2
        closer = ~(left >= least)
        least = np.where(closer, left, least)
        values[:, active] = np.where(closer, trial, values[:, active])
        misfit[active] = least
        finished = least <= enough[active]
        done[active] = finished
        if count == steps or finished.all():
            break
        step = np.where(closer, _newton_step(first, second, trial), np.float32(0.5) * step)
        going = ~finished & np.isfinite(step).all(axis=0)
        active, step, least = active[going], step[:, going], least[going]
        trial = values[:, active] + step
        np.maximum(trial[::2], np.float32(0.1) * values[::2, active], out=trial[::2])
    return _State(values, misfit, done)


def _minors(fields: _Fields) -> tuple[Float32, ...]:
    """Return the determinants of pairs of columns of one harmonic: ab, ac, ad, bc, bd, cd, then ra, rb, rc, rd.

    The columns are the real and imaginary parts of A = f(x), B = f'(x), C = f(y), D = f'(y), and R, what is left.
    """
    x, y = fields.x, fields.y
    a, b, c, d = (x.re, x.im), (x.slope_re, x.slope_im), (y.re, y.im), (y.slope_re, y.slope_im)
    r = (fields.left_re, fields.left_im)
    pairs = ((a, b), (a, c), (a, d), (b, c), (b, d), (c, d), (r, a), (r, b), (r, c), (r, d))
    return tuple(p[0] * q[1] - p[1] * q[0] for p, q in pairs)


def _newton_step(first: _Fields, second: _Fields, values: Float32) -> Float32:
    """Solve the four real equations for the changes of a, x, b, y, (4, m).

    By Cramer's rule, with determinants by Laplace's expansion: det(A, B, C, D) is the sum over pairs of columns of a
    minor in the first harmonic times the complementary minor in the second, with alternating signs.
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


def _angle(cos: NDArray[np.float64], sin: NDArray[np.float64]) -> Float32:
    return np.arctan2(sin.astype(np.float32), cos.astype(np.float32))
