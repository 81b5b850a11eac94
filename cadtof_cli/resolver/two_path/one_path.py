"""One path from two harmonics: maximum likelihood."""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.rotors import product
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.paths import Fit, Paths, doubt_of_one
from cadtof_cli.resolver.two_path.arcsine import phase_of
from cadtof_cli.resolver.two_path.closed_form import FundamentalFrame
from cadtof_cli.resolver.two_path.roots import LEAST, inverse_root, inverse_root_or_none

CURVATURE_FLOOR = 0.1
"""Floor for the curvature that a Newton step divides by, as a share of the largest possible curvature. It keeps the
steps near a saddle point short."""


@dataclass(frozen=True)
class OnePath:
    """The best single path of n pixels: float64 (n,) each.

    `amplitude` is in units of the phasors. `cos` and `sin` are the unit rotor of the phase, `sigma_rad` the predicted
    standard deviation of the phase. `chi_squared` is the misfit in units of the noise: if there is only one path, it is
    χ² with 2 degrees of freedom. `fall_off` is the part of `chi_squared` that comes from the moduli; it is positive if
    the second harmonic is shorter than the first, negative if it is longer.
    """

    amplitude: Float
    cos: Float
    sin: Float
    sigma_rad: Float
    chi_squared: Float
    fall_off: Float

    def fit(self) -> Fit:
        """Return the path as the fit that a solver gives."""
        phase_rad = phase_of(self.cos, self.sin)
        paths = Paths(self.amplitude[np.newaxis], phase_rad[np.newaxis], self.sigma_rad[np.newaxis])
        count = phase_rad.size
        return Fit(paths, self.chi_squared, np.ones(count, np.bool_), doubt_of_one(self.fall_off))


def one_path(frame: FundamentalFrame, /, *, noise: NoiseModel, steps: int) -> OnePath:
    """Fit p1 = a·exp(ix), p2 = a·exp(2ix) to every pixel. NaN in gives NaN out.

    The fit maximises w1·Re(p1·exp(−ix)) + w2·Re(p2·exp(−2ix)). This is the likelihood for white noise with the best
    amplitude inserted. The maximum lies between arg p1 and the nearer of the two halves of arg p2. Their mean, weighted
    by their information, is exact to first order in the noise; it is the start, and `steps` Newton steps follow. Each
    step turns by a rational rotation, so no step needs trigonometry. The noise of one path is uncorrelated along and
    across its phasors (see `noise_model`), so the misfit has two independent parts: the amplitudes disagree, and the
    phases disagree.
    """
    first, second = noise.each
    weight = first.dark_variance / second.dark_variance
    cos, sin, top = _start(frame, weight)
    for _ in range(steps):
        along1, across1, along2, across2 = _turned(frame, cos, sin)
        slope = across1 + 2.0 * weight * across2
        curvature = along1 + 4.0 * weight * along2
        cos, sin = _turn(cos, sin, slope / np.maximum(curvature, CURVATURE_FLOOR * top))
    along1, across1, along2, across2 = _turned(frame, cos, sin)
    amplitude = (along1 + weight * along2) * (1.0 / (1.0 + weight))
    amplitude = np.where(amplitude < 0.0, 0.0, amplitude)
    r1, t1 = first.one_path_variances(amplitude)
    r2, t2 = second.one_path_variances(amplitude)
    along, across = r1 + r2, 4.0 * t1 + t2
    amplitudes, phases = along1 - along2, 2.0 * across1 - across2
    per_both = 1.0 / (along * across)
    chi_squared = (amplitudes * amplitudes * across + phases * phases * along) * per_both
    fall_off = amplitudes * np.abs(amplitudes) * across * per_both
    # the variance of (across1 + 2w·across2)/(amplitude·(1 + 4w))
    weighted = t1 + 4.0 * weight * weight * t2
    square = weighted * (amplitude * (1.0 + 4.0 * weight)) ** 2
    sigma = np.where(square < LEAST, np.inf, weighted * inverse_root(square))
    return OnePath(amplitude, *product((cos, sin), (frame.cos, frame.sin)), sigma, chi_squared, fall_off)


def _start(frame: FundamentalFrame, weight: float) -> tuple[Float, Float, Float]:
    """Return the rotor of the weighted mean phase, and u + 4w·|p2|, the largest possible curvature.

    |p2| times the rotor of half its phase has the parts √(½|p2|(|p2| ± pr)). The larger part is computed by the root,
    the smaller one from pi.
    """
    square = frame.pr * frame.pr + frame.pi * frame.pi
    modulus = square * inverse_root(square)
    half = 0.5 * modulus
    square = half * (modulus + np.abs(frame.pr))
    inverse = inverse_root(square)
    large, small, ahead = square * inverse, half * np.abs(frame.pi) * inverse, frame.pr >= 0.0
    from_second = 4.0 * weight
    cos = frame.u + from_second * np.where(ahead, large, small)
    sin = np.copysign(from_second * np.where(ahead, small, large), frame.pi)
    norm = inverse_root_or_none(cos * cos + sin * sin)
    return cos * norm, sin * norm, frame.u + from_second * modulus


def _turned(frame: FundamentalFrame, cos: Float, sin: Float) -> tuple[Float, Float, Float, Float]:
    """Return the parts of p1 along and across the path, then the parts of p2 along and across it."""
    cos2, sin2 = cos * cos - sin * sin, 2.0 * cos * sin
    return (
        frame.u * cos,
        -frame.u * sin,
        frame.pr * cos2 + frame.pi * sin2,
        frame.pi * cos2 - frame.pr * sin2,
    )


def _turn(cos: Float, sin: Float, angle: Float) -> tuple[Float, Float]:
    """Rotate by 2·atan(angle/2), which equals `angle` to second order and is a rotation for an angle of any size."""
    half = 0.5 * angle
    square = half * half
    norm = 1.0 / (1.0 + square)
    return product((cos, sin), ((1.0 - square) * norm, 2.0 * half * norm))
