"""The model: a surface's light at every harmonic over its direct light, and how that depends on the state of the room.

    H_h = 1 + s·(g_h + b·b_h) + s²u·m_h + v·(τ/τ0)·exp(ihωt − (hωΔ)²/2)/(1 − ihωτ)
              surfaces in the view and beside it    unseen surfaces (the room around and behind)

g_h, b_h and m_h come from `radiosity`. s is the mean albedo; b the light on surfaces beside the view, over what it would be
if the lamp lit them as it lights the view; u the strength of later bounces. Light of surfaces that nothing is known of starts
t behind the direct light, not at once but over Δ, at a height v, and decays with τ. The height of its start and its decay are
independent between rooms; its sum and its decay are not.

The state of n patches is (ln s, ln b, ln u, ln v, ln τ, t), float64 (6, n). What is seen of it are ln|p_h/p_1| and
arg p_h − h·arg p_1, which do not depend on the direct phase; what is wanted is ln H_1.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32
from cadtof_cli.resolver.diffuse.radiosity import Interreflections

Values = TypeVar("Values", Float, Float32)
"""float64 for patches, float32 for pixels."""

STATE = ("ln s", "ln b", "ln u", "ln v", "ln τ", "t")
"""The state's components, in this order everywhere."""

ONSET_NS = 2.0
"""Δ: over how long unseen light sets in, for it is many surfaces and not one."""

REFERENCE_DECAY_NS = 12.0
"""τ0: decay for which v is the sum of unseen over direct light; the median of rendered rooms."""


@dataclass(frozen=True)
class TailModel:
    """The model of n patches: their interreflections, the harmonics' numbers and the fundamental's ω."""

    light: Interreflections
    harmonics: tuple[int, ...]
    rad_per_ns: float

    @property
    def data(self) -> int:
        """How many numbers are seen per patch; the model's values are these, then ln|H_1| and arg H_1."""
        return 2 * (len(self.harmonics) - 1)

    @cached_property
    def _harmonic(self) -> Float:
        return np.array(self.harmonics, np.float64)[:, None]

    def values(self, state: Float, /) -> tuple[Float, Float]:
        """Return the values at a state (6, n), (data + 2, n), and their Jacobian, (6, data + 2, n)."""
        seen, beyond, later, unseen, held = self._terms(state)
        total = 1.0 + seen + beyond + later + unseen
        slopes = np.empty((len(STATE), *total.shape), np.complex128)
        terms = (seen + beyond + 2.0 * later, beyond, later, unseen, unseen * held)
        for slope, term in zip(slopes, terms, strict=False):
            slope[:] = term
        np.multiply(unseen, 1j * self._harmonic * self.rad_per_ns, out=slopes[-1])
        slopes *= 1.0 / total
        values = free_of_direct(_logarithm(total), self._harmonic)
        phases = phase_data(self.data)
        values[phases] = wrapped(values[phases])
        return values, free_of_direct(slopes, self._harmonic)

    def lag_parts(self, state: Float, guessed: Complex, /) -> tuple[Float, Float, Float]:
        """Return how much of arg H_1 is due to surfaces beside the view and to unseen ones, and would be to guessed ones.

        In rad, (n,) each, at a state (6, n); `guessed`, (n,), is the light of the last as `Interreflections.beyond` has it.
        """
        seen, beyond, later, unseen, _ = (term[0] for term in self._terms(state))
        share = 1.0 / (1.0 + seen + beyond + later + unseen)
        beside, behind, would_be = (light * share for light in (beyond, unseen, np.exp(state[0] + state[1]) * guessed))
        return beside.imag, behind.imag, would_be.imag

    def _terms(self, state: Float) -> tuple[Complex, Complex, Complex, Complex, Complex]:
        """Return the four terms of H_h, (H, n) each, in the order above, and 1/(1 − ihωτ)."""
        s, b, u, v, decay = np.exp(state[:5])
        rad_per_ns = self._harmonic * self.rad_per_ns
        turns = rad_per_ns * decay
        held = np.empty(turns.shape, np.complex128)
        held.real = 1.0 / (1.0 + turns * turns)
        held.imag = turns * held.real
        onset = np.exp(-0.5 * (rad_per_ns * ONSET_NS) ** 2) / REFERENCE_DECAY_NS
        unseen = (onset * (v * decay)) * _rotors(rad_per_ns * state[5]) * held
        return s * self.light.seen, (s * b) * self.light.beyond, (s * s * u) * self.light.later, unseen, held


def _rotors(phase_rad: Float) -> Complex:
    """Return exp(i·phase), (…), several times faster than the complex exponential does it."""
    rotors = np.empty(phase_rad.shape, np.complex128)
    rotors.real, rotors.imag = np.cos(phase_rad), np.sin(phase_rad)
    return rotors


def _logarithm(z: Complex) -> Complex:
    """Return ln z, (…), several times faster than the complex logarithm does it."""
    found = np.empty_like(z)
    found.real, found.imag = 0.5 * np.log(z.real * z.real + z.imag * z.imag), np.arctan2(z.imag, z.real)
    return found


def free_of_direct(logarithm: Complex, harmonic: Float, /) -> Float:
    """Return from ln H_h or its derivatives, (…, H, n), what does not depend on the direct light, and ln H_1 itself.

    The order is ln|H_h/H_1| for h = 2, 3, …; then arg H_h − h·arg H_1; then ln|H_1| and arg H_1.
    """
    first, further = logarithm[..., :1, :], logarithm[..., 1:, :]
    count = further.shape[-2]
    free = np.empty((*logarithm.shape[:-2], 2 * count + 2, logarithm.shape[-1]))
    np.subtract(further.real, first.real, out=free[..., :count, :])
    np.subtract(further.imag, harmonic[1:] * first.imag, out=free[..., count:-2, :])
    free[..., -2:-1, :], free[..., -1:, :] = first.real, first.imag
    return free


def phase_data(data: int, /) -> slice:
    """Return which of the data are phases, for so many of them."""
    return slice(data // 2, data)


def wrapped(phase: Values, /) -> Values:
    """Return phases in rad brought to −π … π."""
    inside: Values = phase - 2.0 * np.pi * np.rint(phase / (2.0 * np.pi))
    return inside


def residuals(observed: Values, predicted: Values, /) -> Values:
    """Return data minus their prediction, (data, …) each, phases by the short way round."""
    difference = observed - predicted
    phases = phase_data(len(observed))
    difference[phases] = wrapped(difference[phases])
    return difference
