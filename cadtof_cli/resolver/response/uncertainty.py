"""Predicted standard deviations of two paths of any response: the noise of the phasors carried through the inverse Jacobian."""

from typing import Any

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import powers
from cadtof_cli.resolver.response.table import Answer, ResponseBlock

Array = Any
"""float32 (n,); `Any`, because numpy's stubs take such an array times a Python number for float64, which it is not."""

Vector = tuple[Array, Array]
"""Real and imaginary part."""


def response_sigmas(amplitude: Float, phase_rad: Float, /, *, response: ResponseBlock, noise: NoiseModel) -> Float:
    """Return the standard deviations of x and y in rad, (2, n), of two paths with these amplitudes and phases, (2, n) each.

    With A = f_h(x), B = f_h'(x), C = f_h(y), D = f_h'(y) and the noise q_h of p_h, Cramer's rule gives the change of x as

        Σ_h |q_h w_h| / (a·Σ_h |B_h w_h|),   w_h = C_h|A D| − A_h|C D| − D_h|A C|,

    where |p q| = Re p·Im q − Im p·Re q, and |A D|, |C D| and |A C| are those of the other harmonic. The covariance of
    q_h is the one that the averaging gives for light of these paths. For y, exchange the paths. For a pure sine the
    result equals `two_path_sigmas`. It is infinite where an amplitude or x − y is 0.
    """
    strengths: Array = amplitude.astype(np.float32)
    phases: Array = phase_rad.astype(np.float32)
    answers = [[response.at(row, phase) for row in range(2)] for phase in phases]
    covariances = _covariances(strengths, phases, noise)
    sigmas = []
    for strength, own, other in zip(strengths, answers, reversed(answers), strict=True):
        variance, change = np.zeros_like(strength), np.zeros_like(strength)
        for row, (re_re, re_im, im_im) in enumerate(covariances):
            lever = _lever(own, other, row)
            change += _minor(_slope(own[row]), lever)
            re, im = (part.astype(np.float32) for part in response.turned_back(row, *lever))
            variance += im * (im * re_re - 2.0 * re * re_im) + re * re * im_im
        scale = np.abs(strength * change)
        sigmas.append(np.where(scale == 0.0, np.inf, np.sqrt(np.maximum(variance, 0.0)) / scale))
    return np.stack(sigmas).astype(np.float64)


def _covariances(strengths: Array, phases: Array, noise: NoiseModel) -> list[tuple[Array, Array, Array]]:
    """Return the entries of the covariance of each harmonic for light of two paths.

    No light has a + b > 1, but noise can give such amplitudes (see `two_path_sigmas`).
    """
    rotors = powers((np.cos(phases), np.sin(phases)), (1, 2, 4))
    a, b = strengths / np.maximum(strengths[0] + strengths[1], 1.0)
    light = [(a * cos[0] + b * cos[1], a * sin[0] + b * sin[1]) for cos, sin in rotors]
    return [one.covariance(light[row], light[row + 1]) for row, one in enumerate(noise.each)]


def _lever(own: list[Answer], other: list[Answer], row: int) -> Vector:
    """Return w_h of a harmonic, see `response_sigmas`."""
    a, c, d = _value(own[row]), _value(other[row]), _slope(other[row])
    a_there, c_there, d_there = _value(own[1 - row]), _value(other[1 - row]), _slope(other[1 - row])
    ad, cd, ac = _minor(a_there, d_there), _minor(c_there, d_there), _minor(a_there, c_there)
    return c[0] * ad - a[0] * cd - d[0] * ac, c[1] * ad - a[1] * cd - d[1] * ac


def _minor(p: Vector, q: Vector) -> Array:
    return p[0] * q[1] - p[1] * q[0]


def _value(answer: Answer) -> Vector:
    return answer.re, answer.im


def _slope(answer: Answer) -> Vector:
    return answer.slope_re, answer.slope_im
