"""Paths under a response that is no pure sine: Gauss–Newton on the exact equations, from the sine's answer.

p_h = Σ_paths a·f_h(x), with f_h tabulated. Subtracting the higher terms again and again does not converge for triangles
(their third harmonic changes four times as fast as the phase it disturbs, by a ninth of the amplitude); Newton's steps do.
The fit of one path is here; two paths are searched for in `search`, which is handed its starts from here.
"""

from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.response.newton import LARGEST_TURN, Equations, SearchState, search
from cadtof_cli.resolver.response.table import STAGES, ResponseBlock
from cadtof_cli.resolver.two_path.closed_form import FULL_TURN, TwoPaths, fundamental_frame, two_paths
from cadtof_cli.resolver.two_path.one_path import OnePath

MOST_STEPS = 6
"""Most steps a pixel gets from one start, halvings among them; two or three are what it takes."""

STAGE_STEPS = 8
"""Most steps at each stage on the way from a sine to the response."""

STAGE_TOLERANCE = 10.0
"""How much more may be left of the equations where the next stage moves the paths anyway."""

_EVERYWHERE = slice(None)


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
    n11, n12, n22, g1, g2, chi = (np.zeros_like(amplitude) for _ in range(6))
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
    scale: Float32 = np.reciprocal(n11 * n22 - n12 * n12)
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
    equations = Equations.of(response, phasors, pixels, noise)
    found = search(equations, _values(start, pixels), steps=MOST_STEPS)
    again = np.flatnonzero(~found.done)
    if again.size:
        led = _led_by_stages(equations.chosen(again), phasors[:, pixels[again]])
        better = led.misfit < found.misfit[again]
        found.put(again[better], SearchState(led.values[:, better], led.misfit[better], led.done[better]))
    failed[pixels] = ~found.done
    return RefinedPaths(_with(start, pixels, found.values), failed)


def _led_by_stages(equations: Equations, phasors: Complex) -> SearchState:
    """Return the state at the end of the stages, from the sine's answer."""
    values = _values(two_paths(fundamental_frame(*np.ascontiguousarray(phasors))), _EVERYWHERE)
    coarse = replace(equations, enough=equations.enough * np.float32(STAGE_TOLERANCE**2))
    for stage in range(len(STAGES) - 1):
        values = search(coarse, values, steps=STAGE_STEPS, stage=stage).values
    return search(equations, values, steps=STAGE_STEPS)


def _values(paths: TwoPaths, pixels: Index | slice) -> Float32:
    """Return a, x, b, y of some pixels, (4, m)."""
    x, y = paths.phases()
    return np.stack([paths.a[pixels], x[pixels], paths.b[pixels], y[pixels]]).astype(np.float32)


def _with(paths: TwoPaths, pixels: Index, values: Float32) -> TwoPaths:
    """Return the paths with a, x, b, y of some pixels replaced."""
    x, y = values[1].astype(np.float64), values[3].astype(np.float64)
    half = 0.5 * ((x - y) % FULL_TURN)
    refined = (values[0], values[2], np.cos(y + half), np.sin(y + half), np.cos(half), np.sin(half))
    planes = (paths.a, paths.b, paths.cos_mean, paths.sin_mean, paths.cos_half, paths.sin_half)
    changed = [plane.copy() for plane in planes]
    for plane, new in zip(changed, refined, strict=True):
        plane[pixels] = new
    a, b, cos_mean, sin_mean, cos_half, sin_half = changed
    return TwoPaths(a, b, cos_mean, sin_mean, cos_half, sin_half, paths.single)


def _sine_part(alone: OnePath, phasors: Complex, response: ResponseBlock) -> Complex:
    """Return what phasors, (2, n), would be with k = 1 alone, if all light came by the best single path."""
    phase = _angle(alone.cos, alone.sin)
    cleaned = np.empty_like(phasors)
    cos, sin = alone.cos, alone.sin
    for row, phasor in enumerate(phasors):
        if row:
            cos, sin = cos * cos - sin * sin, 2.0 * cos * sin
        f = response.at(row, phase, _EVERYWHERE)
        re, im = response.turned_back(row, f.re, f.im)
        cleaned[row].real = phasor.real - alone.amplitude * (re - cos)
        cleaned[row].imag = phasor.imag - alone.amplitude * (im - sin)
    return cleaned


def _angle(cos: Float, sin: Float) -> Float32:
    return np.arctan2(sin.astype(np.float32), cos.astype(np.float32))
