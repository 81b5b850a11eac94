"""One path under a response that is no pure sine: Gauss–Newton on the exact equations, from the answer for a sine."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.response.newton import LARGEST_TURN
from cadtof_cli.resolver.response.table import ResponseBlock
from cadtof_cli.resolver.two_path.one_path import OnePath


def one_path_of_response(
    start: OnePath, phasors: Complex, /, *, response: ResponseBlock, noise: NoiseModel, steps: int
) -> OnePath:
    """Return the best single path of phasors, complex128 (2, n), under the full response; NaN stays NaN.

    `start` is the best path for a pure sine. The fit minimises the squares of p_h − a·f_h(x), weighted by the noise
    along and across each phasor, by one Gauss–Newton step or more. The normal equations of the last step give the
    standard deviation and χ² at the minimum, with 2 degrees of freedom, so that the misfit needs no further evaluation.
    """
    observed = response.observed(phasors)
    amplitude, phase = start.amplitude.astype(np.float32), angle_of(start.cos, start.sin)
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
        step.fall_off.astype(np.float64),
    )


@dataclass(frozen=True, eq=False)
class _OnePathStep:
    """One Gauss–Newton step of n pixels, (n,) each.

    `growth` is the change of the amplitude, `turn` the change of amplitude × phase, `spread` the standard deviation of
    that product. `chi_squared` and `fall_off` are those of `OnePath`, after the step.
    """

    growth: Float32
    turn: Float32
    spread: Float32
    chi_squared: Float32
    fall_off: Float32


def _one_path_step(
    amplitude: Float32,
    phase: Float32,
    observed: tuple[tuple[Float32, Float32], ...],
    response: ResponseBlock,
    noise: NoiseModel,
) -> _OnePathStep:
    """Return one Gauss–Newton step. The equations of each harmonic are turned so that its answer is real."""
    n11, n12, n22, g1, g2, chi, shorter, bend, variance = (np.zeros_like(amplitude) for _ in range(9))
    for row, harmonic in enumerate(noise.each):
        f = response.at(row, phase)
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
        shorter += (left_re if row == 0 else -left_re) / modulus
        bend += (slope_re if row == 0 else -slope_re) / modulus
        variance += along / (modulus * modulus)
    scale: Float32 = np.reciprocal(n11 * n22 - n12 * n12)
    growth, turn = (n22 * g1 - n12 * g2) * scale, (n11 * g2 - n12 * g1) * scale
    # the growth changes what is left of both harmonics, over their moduli, alike; the turn does not
    shorter -= turn * bend
    fall_off = shorter * np.abs(shorter) / variance
    return _OnePathStep(growth, turn, np.sqrt(n11 * scale), chi - growth * g1 - turn * g2, fall_off)


def angle_of(cos: Float, sin: Float, /) -> Float32:
    """Return the phase of a rotor in rad, from −π to π."""
    return np.arctan2(sin.astype(np.float32), cos.astype(np.float32))
