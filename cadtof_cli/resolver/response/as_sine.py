"""What a pure sine would have recorded: the phase of a single path, and phasors freed of the other terms of their response.

The other terms depend on when light arrives, in another way than a sine's does. They are small, and those of paths that fit the
phasors are nearly those of the light: near enough to begin with where it is a tail, whose prediction then says more.
"""

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32
from cadtof_cli.resolver.paths import FULL_TURN, Paths
from cadtof_cli.resolver.response.table import ENTRIES, ResponseBlock


def phasors_of_sine(phasors: Complex, paths: Paths, /, *, response: ResponseBlock) -> Complex:
    """Return phasors (H, n) minus what the response makes of their paths beyond a sine. NaN without a path is no light."""
    there = np.isfinite(paths.amplitude)
    amplitude = np.where(there, paths.amplitude, 0.0).astype(np.float32)
    phase = np.where(there, paths.phase_rad, 0.0).astype(np.float32)
    sine = np.empty_like(phasors)
    for row, (re, im) in enumerate(response.observed(phasors)):
        for strength, x in zip(amplitude, phase, strict=True):
            beyond_re, beyond_im = _beyond_sine(x, row, response)
            re = re - strength * beyond_re
            im = im - strength * beyond_im
        sine.real[row], sine.imag[row] = response.turned_back(row, re, im)
    return sine


def without_own_phases(phasors: Complex, paths: Paths, /, *, response: ResponseBlock) -> Complex:
    """Return phasors (H, n) as pixels would have recorded their paths that add nothing to phases. NaN without a path is no light.

    Those of a sine are so already: a pixel's own phase stands in the other terms alone.
    """
    there = np.isfinite(paths.amplitude)
    amplitude = np.where(there, paths.amplitude, 0.0)
    phase = np.where(there, paths.phase_rad, 0.0).astype(np.float32)
    plain, alike = response.without_phases, phasors.copy()
    for row, phasor in enumerate(alike):
        for strength, x in zip(amplitude, phase, strict=True):
            own, other = (one.at(row, x, slice(None)) for one in (response, plain))
            own_re, own_im = response.turned_back(row, own.re, own.im)
            phasor.real -= strength * (own_re - other.re)
            phasor.imag -= strength * (own_im - other.im)
    return alike


def single_path(phasor: Complex, /, *, response: ResponseBlock) -> Paths:
    """Return the path, (1, n), that alone explains the fundamental's phasor, complex128 (n,); NaN stays NaN."""
    phase = first_phase(phasor, response=response)
    answer = response.at(0, phase.astype(np.float32), slice(None))
    strength = np.abs(phasor) / np.hypot(answer.re, answer.im)
    return Paths(strength[np.newaxis], phase[np.newaxis], np.full((1, phase.size), np.nan))


def _beyond_sine(phase: Float32, row: int, response: ResponseBlock) -> tuple[Float32, Float32]:
    """Return f(θ) − exp(iθ) of one harmonic for paths of fundamental phase x."""
    answer = response.at(row, phase, slice(None))
    theta = response.theta(row, phase, slice(None))
    return answer.re - np.cos(theta), answer.im - np.sin(theta)


def first_phase(phasor: Complex, /, *, response: ResponseBlock | None) -> Float:
    """Return the phase in [0, 2π) of a single path, float64 (n,), from the fundamental's phasor, complex128 (n,); NaN stays NaN.

    Without a response of the same pixels, it is that of a sine, and the phase the phasor's own.
    """
    with np.errstate(invalid="ignore"):
        if response is None:
            return np.asarray(np.mod(np.angle(phasor), FULL_TURN))
        answered, theta = response.stages[-1][0].phases, FULL_TURN / ENTRIES * np.arange(ENTRIES + 1)
        own = 0.0 if response.phase_rad is None else response.phase_rad[0].astype(np.float64)
        seen = np.angle(phasor) + own
        # a turn of θ is a turn of the answer, which begins anywhere
        turned = answered[0] + np.mod(seen - answered[0], FULL_TURN)
        return np.asarray(np.mod(np.interp(turned, answered, theta) - own, FULL_TURN))
