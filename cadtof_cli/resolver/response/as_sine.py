"""Phasors as a pure sine would have recorded them, without other terms of the response; the phase of a single path.

The other terms depend on the delay of the light in another way than the sine does. They are small. Paths that fit the
phasors have nearly the same other terms as the light itself. If the light is a tail, this is a good enough start, and
the prediction of the tail then gives more exact terms.
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.paths import FULL_TURN, Paths
from cadtof_cli.resolver.response.table import ENTRIES, ResponseBlock


def phasors_of_sine(phasors: Complex, paths: Paths, /, *, response: ResponseBlock) -> Complex:
    """Return phasors (H, n) minus the terms of their paths beyond a sine. A path of NaN counts as no light."""
    there = np.isfinite(paths.amplitude)
    amplitude = np.where(there, paths.amplitude, 0.0).astype(np.float32)
    phase = np.where(there, paths.phase_rad, 0.0).astype(np.float32)
    sine = np.empty_like(phasors)
    for row, (re, im) in enumerate(response.observed(phasors)):
        for strength, x in zip(amplitude, phase, strict=True):
            answer, theta = response.at(row, x), response.theta(row, x)
            re = re - strength * (answer.re - np.cos(theta))
            im = im - strength * (answer.im - np.sin(theta))
        sine.real[row], sine.imag[row] = response.turned_back(row, re, im)
    return sine


def without_own_phases(phasors: Complex, paths: Paths, /, *, response: ResponseBlock) -> Complex:
    """Return phasors (H, n) as pixels without own phases would have recorded their paths.

    Phasors of a pure sine do not change, because the own phase of a pixel shows only in the other terms. A path of NaN
    counts as no light.
    """
    there = np.isfinite(paths.amplitude)
    amplitude = np.where(there, paths.amplitude, 0.0)
    phase = np.where(there, paths.phase_rad, 0.0).astype(np.float32)
    without, result = response.without_phases, phasors.copy()
    for row, phasor in enumerate(result):
        for strength, x in zip(amplitude, phase, strict=True):
            (own_re, own_im), (re, im) = (block.added_by(row, x) for block in (response, without))
            phasor.real -= strength * (own_re - re)
            phasor.imag -= strength * (own_im - im)
    return result


def single_path(phasor: Complex, /, *, response: ResponseBlock) -> Paths:
    """Return the single path, (1, n), that explains the phasor of the fundamental, complex128 (n,); NaN stays NaN."""
    phase = first_phase(phasor, response=response)
    answer = response.at(0, phase.astype(np.float32))
    strength = np.abs(phasor) / np.hypot(answer.re, answer.im)
    return Paths(strength[np.newaxis], phase[np.newaxis], np.full((1, phase.size), np.nan))


def first_phase(phasor: Complex, /, *, response: ResponseBlock | None) -> Float:
    """Return the phase in [0, 2π) of a single path, float64 (n,), from the phasor of the fundamental, complex128 (n,).

    NaN stays NaN. `response` is that of the same pixels. Without it, the response is a pure sine, and the result is the
    phase of the phasor.
    """
    with np.errstate(invalid="ignore"):
        if response is None:
            return np.asarray(np.mod(np.angle(phasor), FULL_TURN))
        answered, theta = response.stages[-1][0].phases, FULL_TURN / ENTRIES * np.arange(ENTRIES + 1)
        own = 0.0 if response.phase_rad is None else response.phase_rad[0].astype(np.float64)
        seen = np.angle(phasor) + own
        # over one turn of θ the phase of the answer also makes one turn, but it does not start at 0
        turned = answered[0] + np.mod(seen - answered[0], FULL_TURN)
        return np.asarray(np.mod(np.interp(turned, answered, theta) - own, FULL_TURN))
