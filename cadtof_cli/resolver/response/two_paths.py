"""Two paths under a response that is no pure sine: Newton's method on the exact equations, from the answer for a sine.

p_h = Σ_paths a·f_h(x), with f_h tabulated. Subtracting the higher terms again and again does not converge for
triangles: their third harmonic changes four times as fast as the phase that it disturbs, by a ninth of the amplitude.
Newton's steps converge. The search itself is `newton.search` or its compiled twin; this module gives it the starts.
"""

from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float32, Index, SomePixels
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.paths import FULL_TURN
from cadtof_cli.resolver.response.newton import Equations, SearchState, searched
from cadtof_cli.resolver.response.one_path import angle_of
from cadtof_cli.resolver.response.table import STAGES, ResponseBlock
from cadtof_cli.resolver.two_path.closed_form import TwoPaths
from cadtof_cli.resolver.two_path.decomposition import decomposed
from cadtof_cli.resolver.two_path.one_path import OnePath

MOST_STEPS = 6
"""Largest number of steps of a pixel from one start, including halvings; two or three are enough for most pixels."""

STAGE_STEPS = 8
"""Largest number of steps at each stage on the way from a sine to the full response."""

STAGE_TOLERANCE = 10.0
"""Factor on the allowed residual at all stages but the last, because the next stage moves the paths anyway."""


def two_paths_of_response(
    alone: OnePath, phasors: Complex, chosen: Bool, /, *, response: ResponseBlock, noise: NoiseModel
) -> tuple[TwoPaths, Bool]:
    """Return two paths of phasors, complex128 (2, n), and where they meet the four exact equations in the chosen pixels.

    The other pixels get the answer for a sine. The search starts from the closed form, after the higher terms of the
    best single path, `alone`, have been subtracted. A step that does not lower the misfit of a pixel is halved. A pixel
    is done, and takes no more time, when the residual of its equations is well below the noise. Pixels that are not
    done are led in `STAGES` from the answer for a sine to that for the response. Pixels that are still not done keep
    their best attempt, and the result says so.
    """
    start = decomposed(*_sine_part(alone, phasors, response))
    pixels = np.flatnonzero(chosen & ~start.single)
    converged = np.ones(chosen.shape, np.bool_)
    if not pixels.size:
        return start, converged
    equations = Equations.of(response.block(pixels), phasors[:, pixels], noise[pixels])
    found = searched(equations, _values(start, pixels), steps=MOST_STEPS)
    again = np.flatnonzero(~found.done)
    if again.size:
        led = _led_by_stages(equations[again], phasors[:, pixels[again]])
        better = led.misfit < found.misfit[again]
        found.put(again[better], SearchState(led.values[:, better], led.misfit[better], led.done[better]))
    converged[pixels] = found.done
    return _with(start, pixels, found.values), converged


def _led_by_stages(equations: Equations, phasors: Complex) -> SearchState:
    """Return the state at the end of the stages, which start from the answer for a sine."""
    values = _values(decomposed(*phasors), slice(None))
    coarse = replace(equations, enough=equations.enough * np.float32(STAGE_TOLERANCE**2))
    for stage in range(len(STAGES) - 1):
        values = searched(coarse, values, steps=STAGE_STEPS, stage=stage).values
    return searched(equations, values, steps=STAGE_STEPS)


def _values(paths: TwoPaths, pixels: SomePixels) -> Float32:
    """Return a, x, b, y of some pixels, (4, m)."""
    x, y = paths.phases()
    return np.stack([paths.a[pixels], x[pixels], paths.b[pixels], y[pixels]]).astype(np.float32)


def _with(paths: TwoPaths, pixels: Index, values: Float32) -> TwoPaths:
    """Return the paths with a, x, b, y replaced in some pixels."""
    a, x, b, y = values.astype(np.float64)
    half = 0.5 * ((x - y) % FULL_TURN)
    planes = np.stack([*paths.amplitude, paths.cos_mean, paths.sin_mean, paths.cos_half, paths.sin_half])
    planes[:, pixels] = a, b, np.cos(y + half), np.sin(y + half), np.cos(half), np.sin(half)
    cos_mean, sin_mean, cos_half, sin_half = planes[2:]
    return TwoPaths(planes[:2], cos_mean, sin_mean, cos_half, sin_half, paths.single)


def _sine_part(alone: OnePath, phasors: Complex, response: ResponseBlock) -> Complex:
    """Return phasors, (2, n), minus the terms other than k = 1, as if all light came on the best single path."""
    phase = angle_of(alone.cos, alone.sin)
    cleaned = np.empty_like(phasors)
    cos, sin = alone.cos, alone.sin
    for row, phasor in enumerate(phasors):
        if row:
            cos, sin = cos * cos - sin * sin, 2.0 * cos * sin
        re, im = response.added_by(row, phase)
        cleaned[row].real = phasor.real - alone.amplitude * (re - cos)
        cleaned[row].imag = phasor.imag - alone.amplitude * (im - sin)
    return cleaned
