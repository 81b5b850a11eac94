"""Direct light and its tail under a response that is no pure sine: what its other terms make of both.

Term k of harmonic h sees light at k·h times the fundamental. With direct light a·exp(ix), and H_kh the light at that
multiple over the direct light,

    p_h = a·Σ_k c_hk·H_kh·exp(ikθ_h)        θ_h = hx plus the pixel's own phase; c_h1 = 1; H_−m is the conjugate of H_m

If the tail is predicted, only a and x are unknown, and p_1 alone determines them. The other terms of every harmonic
follow from a and x. So no path is fitted to the noise of a pixel, nor to a tail, which is no path.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.elementary import exponential, phase_of, rotor
from cadtof_cli.resolver.diffuse.records import Parts, PixelTails

if TYPE_CHECKING:
    from cadtof_cli.resolver.response.table import ResponseBlock, ResponseTable

LEAST_TERM = 0.03
"""Least |c_hk| of terms that see a tail. The light that weaker terms see is taken for direct light, within .5 cm."""

HIGHEST = 9
"""Highest multiple of the fundamental at which a tail is predicted: little of it is left beyond."""

STEPS = 3
"""Newton steps for the direct phase. They start from the phase of a single path minus the lag, and leave less than the
noise of any frame."""

LARGEST_TURN = 0.5
"""Largest change of the direct phase in a step, rad: half the distance between neighbouring extremes of a triangle's slope."""

LEAST_SLOPE = 0.2
"""Least slope of arg p_1 over the direct phase that is used. For a triangle without a tail, the slope is .6 to 1.3."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """Σ_k c_hk·H_kh·exp(ikθ) of n pixels without exp(iθ), its derivative by x, and exp(iθ), which a sine alone would see."""

    value: Parts
    slope: Parts
    sine: Parts


def harmonics_seen(response: "ResponseBlock", /) -> tuple[tuple[int, float], ...]:
    """Return the multiples of the fundamental at which other terms of a response see a tail, with the largest |c_hk|.

    The multiples are in ascending order.
    """
    seen: dict[int, float] = {}
    for table in response.stages[-1]:
        for k, share in _orders(table).items():
            multiple = abs(k) * table.harmonic
            seen[multiple] = max(abs(share), seen.get(multiple, 0.0))
    return tuple(sorted(seen.items()))


def freed_of_other_terms(
    phasors: Complex, tails: PixelTails, /, *, response: "ResponseBlock", alone_rad: Float
) -> tuple[Complex, Float32]:
    """Return what a sine would have recorded, complex128 (H, n), and a ratio of variances of the direct phase, (n,).

    The ratio says by how much the noise of the phase exceeds that of a sine. NaN stays NaN.

    Args:
        phasors: (H, n), of the same pixels as the response.
        tails: predicted for these pixels.
        response: of the channel pairs.
        alone_rad: phases of a single path, (n,): `response.as_sine.first_phase` of the first phasors.
    """
    first_re, first_im = rotor(tails.lag_rad)
    strength = exponential(tails.size)
    first = strength * first_re, strength * first_im
    observed = response.observed(phasors)
    phase = (alone_rad - tails.lag_rad).astype(np.float32)
    for step in range(STEPS + 1):
        seen = _seen(0, phase, tails, response)
        of_sine = _times(first, seen.sine)
        total = _plus(seen.value, of_sine)
        # i·H_1·exp(ix) is the derivative of H_1·exp(ix) by x
        slope = _over(_plus(seen.slope, (-of_sine[1], of_sine[0])), total)
        turn = np.maximum(slope[1], np.float32(LEAST_SLOPE))
        if step < STEPS:
            left = phase_of(*_over(observed[0], total)) / turn
            phase = phase + np.fmin(np.fmax(left, np.float32(-LARGEST_TURN)), np.float32(LARGEST_TURN))
    power = _power(total)
    amplitude = np.sqrt(_power(observed[0]) / power)
    sine = np.empty(phasors.shape, np.complex128)
    for row, (re, im) in enumerate(observed):
        if row == 0:
            re, im = amplitude * of_sine[0], amplitude * of_sine[1]
        else:
            other = _seen(row, phase, tails, response).value
            re, im = re - amplitude * other[0], im - amplitude * other[1]
        sine.real[row], sine.imag[row] = response.turned_back(row, re, im)
    return sine, strength * strength / (power * turn * turn)


def _seen(row: int, phase: Float32, tails: PixelTails, response: "ResponseBlock") -> _Seen:
    """Return what one harmonic sees of direct light of phase x and amplitude 1, and of its tail."""
    table, theta = response.stages[-1][row], response.theta(row, phase)
    harmonic, direct, sine = table.harmonic, response.at(row, phase), rotor(theta)
    speed = np.float32(harmonic)
    value = direct.re - sine[0], direct.im - sine[1]
    slope = direct.slope_re + speed * sine[1], direct.slope_im - speed * sine[0]
    for k, share in _orders(table).items():
        light_re, light_im = tails.of_terms[abs(k) * harmonic]
        tail = light_re - np.float32(1.0), math.copysign(1.0, k) * light_im
        term = _times(_times(rotor(np.float32(k) * theta), tail), (np.float32(share.real), np.float32(share.imag)))
        value = _plus(value, term)
        slope = _plus(slope, (-np.float32(k * harmonic) * term[1], np.float32(k * harmonic) * term[0]))
    return _Seen(value, slope, sine)


def _orders(table: "ResponseTable") -> dict[int, complex]:
    """Return the terms k of a harmonic that see a tail, and their c_hk."""
    return {
        k: share
        for k, share in table.other_terms.items()
        if abs(share) >= LEAST_TERM and 0 < abs(k) * table.harmonic <= HIGHEST
    }


def _plus(first: Parts, second: Parts) -> Parts:
    return first[0] + second[0], first[1] + second[1]


def _times(first: Parts, second: Parts) -> Parts:
    (a, b), (c, d) = first, second
    return a * c - b * d, a * d + b * c


def _over(first: Parts, second: Parts) -> Parts:
    """Return the quotient of complex numbers."""
    power = _power(second)
    re, im = _times(first, (second[0], -second[1]))
    return re / power, im / power


def _power(z: Parts) -> Any:
    return z[0] * z[0] + z[1] * z[1]
