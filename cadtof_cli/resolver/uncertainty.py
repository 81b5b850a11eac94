"""Predicted standard deviations of two resolved paths: the noise of the phasors carried through the inverse Jacobian."""

import numpy as np

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.resolver.closed_form import TwoPaths
from cadtof_cli.resolver.noise import NoiseModel


def two_path_sigmas(paths: TwoPaths, /, *, noise: NoiseModel) -> tuple[Float32, Float32]:
    """Return the standard deviations of x and y in rad, float32 (n,) each; infinite where a, b or x − y is 0.

    With D = y − x, c = cos D and s = sin D, the change of x is (α·q1 + β·q2)/a, where q_h is the noise of p_h turned back by
    h·x and · multiplies real with real and imaginary with imaginary parts:

        α = (−(1+c)s,  1+c+c²)/((1−c)(2+c)),   β = ((1+c)s,  ½−c−c²)/((1−c)(2+c))

    For white noise that gives the Cramér–Rao bound of PHYSICS, (σ/a)·√(13+20c+12c²)/(2(1−c)(2+c)); here q_h has the full
    covariance that the averaging leaves for this mix of light, which is narrower across the phasor than along it.
    float32 is enough for a prediction, and halves the time.
    """
    half_sin2 = paths.sin_half * paths.sin_half
    gap = (2.0 * half_sin2).astype(np.float32)
    sin = (-2.0 * paths.sin_half * paths.cos_half).astype(np.float32)
    a, b = paths.a.astype(np.float32), paths.b.astype(np.float32)
    return _sigma(a, b, gap, sin, noise), _sigma(b, a, gap, -sin, noise)


def _sigma(a: Float32, b: Float32, gap: Float32, sin: Float32, noise: NoiseModel) -> Float32:
    """Return the standard deviation of the phase of path a, with 1 − cos D = gap and sin D = sin."""
    cos = 1.0 - gap
    cos2, sin2 = 2.0 * cos * cos - 1.0, 2.0 * sin * cos
    cos4, sin4 = 2.0 * cos2 * cos2 - 1.0, 2.0 * sin2 * cos2
    z1, z2, z4 = (a + b * cos, b * sin), (a + b * cos2, b * sin2), (a + b * cos4, b * sin4)
    in_phase = (1.0 + cos) * sin
    variance = _projected(-in_phase, 1.0 + cos + cos * cos, z1, z2, noise, 0)
    variance += _projected(in_phase, 0.5 - cos - cos * cos, z2, z4, noise, 1)
    result: Float32 = np.sqrt(np.maximum(variance, 0.0)) / (a * gap * (2.0 + cos))
    return result


def _projected(
    re: Float32,
    im: Float32,
    phasor: tuple[Float32, Float32],
    doubled: tuple[Float32, Float32],
    noise: NoiseModel,
    index: int,
) -> Float32:
    """Return the variance of re·Re q + im·Im q for noise q of one harmonic, whose moments are r_h·phasor and r_2h·doubled."""
    harmonic = noise.harmonics[index]
    half = _single(0.5 * harmonic.averaging)
    scale = _single(0.5 * harmonic.averaging / harmonic.pulse**2)
    twice = _single(harmonic.pulse_double / harmonic.pulse**2 * 0.5 * harmonic.averaging)
    floor = _single(harmonic.floor)
    z_re, z_im = phasor
    total = (scale + floor) * (re * re + im * im)
    shape = (re * re - im * im) * doubled[0] + 2.0 * re * im * doubled[1]
    signal = re * z_re + im * z_im
    result: Float32 = total + twice * shape - 2.0 * half * signal * signal
    return result


def _single(level: float | Float) -> Float32:
    return np.asarray(level, np.float32)
