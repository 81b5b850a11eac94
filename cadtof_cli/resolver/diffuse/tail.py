"""The model: the light of a surface at every harmonic over its direct light, and how it depends on the state of the room.

    H_h = 1 + s·(g_h + b·b_h) + s²u·m_h + v·(τ/τ0)·exp(ihωt − (hωΔ)²/2)/(1 − ihωτ)
              surfaces in the view and beside it    unseen surfaces (the room around and behind)

g_h, b_h and m_h come from `radiosity`. s is the mean albedo. b is the light on surfaces beside the view, over what it
would be if the lamp lit them as it lights the view. u is the strength of later bounces. The last term is the light of
surfaces of which nothing is known. It starts t after the direct light, over Δ rather than at once, has the height v and
decays with τ. Between rooms, its height at the start and its decay are independent; its sum and its decay are not.

The state of n patches is (ln s, ln b, ln u, ln v, ln τ, t), float64 (6, n). The data are ln|p_h/p_1| and arg p_h −
h·arg p_1, which do not depend on the direct phase. The model has to tell ln H_1; its imaginary part arg H_1 is the lag.
"""

from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Complex, Float, Values
from cadtof_cli.phasors.rotors import product
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.radiosity import Interreflections
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous, extension, is_compiled_for

STATE = ("ln s", "ln b", "ln u", "ln v", "ln τ", "t")
"""The state's components, in this order everywhere."""

ONSET_NS = 2.0
"""Δ: how long unseen light takes to set in, because it comes from many surfaces."""

REFERENCE_DECAY_NS = 12.0
"""τ0: decay for which v is the sum of unseen over direct light; the median of rendered rooms."""


@dataclass(frozen=True)
class TailModel:
    """The model of n patches: their interreflections, the numbers of the harmonics, and the fundamental's ω.

    Its values are the data of a patch, 2·H − 2 numbers, then ln|H_1| and arg H_1.
    """

    light: Interreflections
    harmonics: tuple[int, ...]
    rad_per_ns: float

    @cached_property
    def _harmonic(self) -> Float:
        return np.array(self.harmonics, np.float64)[:, None]

    @cached_property
    def _rad_per_ns(self) -> Float:
        """hω of every harmonic, (H, 1), in rad/ns."""
        return self._harmonic * self.rad_per_ns

    @cached_property
    def _onset(self) -> Float:
        """Factor by which unseen light is weaker because it sets in slowly, over τ0, (H, 1)."""
        return np.exp(-0.5 * (self._rad_per_ns * ONSET_NS) ** 2) / REFERENCE_DECAY_NS

    def values(self, state: Float, /) -> tuple[Float, Float]:
        """Return the values at a state (6, n), (data + 2, n), and their Jacobian, (6, data + 2, n)."""
        phase = self._rad_per_ns * state[5]
        slopes = self._compiled_slopes if is_compiled_for(len(self.harmonics)) else self._slopes
        (re, im, power), jacobian = slopes(np.exp(state[:5]), np.cos(phase), np.sin(phase))
        return free_of_direct(0.5 * np.log(power), np.arctan2(im, re), self._harmonic), jacobian

    def light_at(self, state: Float, /) -> Float:
        """Return the real and imaginary parts of H_h at a state (6, n), (2, H, n)."""
        phase = self._rad_per_ns * state[5]
        answer, _ = self._slopes(np.exp(state[:5]), np.cos(phase), np.sin(phase))
        return answer[:2]

    def lag_parts(self, state: Float, guessed: Complex, /) -> tuple[Float, Float, Float, Float]:
        """Return the parts of arg H_1 by surfaces in the view, beside it, unseen, and guessed ones, in rad, (n,) each.

        The state is (6, n). `guessed`, (n,), is the light of guessed surfaces, in units of `Interreflections.beyond`.
        It is not in H_1 itself.
        """
        s, b, u, v, decay = np.exp(state[:5])
        light, turn = self.light, 1j * self.rad_per_ns
        seen, beyond, later = s * light.seen[0], s * b * light.beyond[0], s * s * u * light.later[0]
        unseen = self._onset[0] * v * decay * np.exp(turn * state[5]) / (1.0 - turn * decay)
        inverse = 1.0 / (1.0 + seen + beyond + later + unseen)
        shown, beside, behind, would = ((part * inverse).imag for part in (seen, beyond, unseen, s * b * guessed))
        return shown, beside, behind, would

    def _slopes(self, natural: Float, cos: Float, sin: Float) -> tuple[Float, Float]:
        """Return the real part, the imaginary part and the squared magnitude of H_h, (3, H, n), and the Jacobian of the values.

        The computation uses real numbers, whose operations are each rounded alone: numpy's products of complex numbers
        differ from machine to machine. `natural`, (5, n), is s, b, u, v and τ; `cos` and `sin`, (H, n), are those of hωt.
        """
        s, b, u, v, decay = natural
        # 1/(1 − ihωτ)
        turns = self._rad_per_ns * decay
        decayed = np.empty((2, *cos.shape))
        np.divide(1.0, 1.0 + turns * turns, out=decayed[0])
        np.multiply(turns, decayed[0], out=decayed[1])
        start = np.empty_like(decayed)
        start[0], start[1] = cos, sin
        unseen = _product(self._onset * (v * decay) * start, decayed)
        seen, beyond, later = self._light
        seen, beyond, later = s * seen, (s * b) * beyond, (s * s * u) * later
        answer = np.empty((3, *cos.shape))
        total, power = answer[:2], answer[2]
        np.add(seen + beyond + later, unseen, out=total)
        total[0] += 1.0
        np.add(total[0] * total[0], total[1] * total[1], out=power)
        terms = np.empty((2, len(STATE), *cos.shape))
        terms[:, 0] = seen + beyond + 2.0 * later
        terms[:, 1], terms[:, 2], terms[:, 3], terms[:, 4] = beyond, later, unseen, _product(unseen, decayed)
        terms[0, 5], terms[1, 5] = self._rad_per_ns * -unseen[1], self._rad_per_ns * unseen[0]
        inverse = total / power
        np.negative(inverse[1], out=inverse[1])
        size, phase = _product(terms, inverse[:, None])
        return answer, free_of_direct(size, phase, self._harmonic)

    def _compiled_slopes(self, natural: Float, cos: Float, sin: Float) -> tuple[Float, Float]:
        """Return the same as `_slopes`, with the same bits, by the compiled twin, `_patch_steps.h`."""
        answer, jacobian = np.empty((3, *cos.shape)), np.empty((len(STATE), 2 * len(cos), cos.shape[1]))
        constants = self._harmonic, self._rad_per_ns, self._onset
        given = natural, cos, sin, self.light.seen, self.light.beyond, self.light.later
        extension().tail_slopes(chosen_kernel(), *contiguous(*constants, *given), answer, jacobian)
        return answer, jacobian

    @cached_property
    def _light(self) -> list[Float]:
        """Real and imaginary parts of the light seen, beyond and later, (2, H, n) each."""
        return [np.stack([z.real, z.imag]) for z in (self.light.seen, self.light.beyond, self.light.later)]


def _product(first: Float, second: Float) -> Float:
    """Return the products of complex numbers, (2, …) each."""
    return np.stack(product((first[0], first[1]), (second[0], second[1])))


def free_of_direct(size: Float, phase: Float, harmonic: Float, /) -> Float:
    """Return what does not depend on the direct light, and ln H_1, from ln|H_h| and arg H_h or their derivatives, (…, H, n).

    The order is ln|H_h/H_1| for h = 2, 3, …; then arg H_h − h·arg H_1; then ln|H_1| and arg H_1.
    """
    count = size.shape[-2] - 1
    free = np.empty((*size.shape[:-2], 2 * count + 2, size.shape[-1]))
    np.subtract(size[..., 1:, :], size[..., :1, :], out=free[..., :count, :])
    np.subtract(phase[..., 1:, :], harmonic[1:] * phase[..., :1, :], out=free[..., count:-2, :])
    free[..., -2, :], free[..., -1, :] = size[..., 0, :], phase[..., 0, :]
    return free


def phase_data(data: int, /) -> slice:
    """Return which of so many data are phases."""
    return slice(data // 2, data)


def wrapped(phase: Values, /, middle_rad: float = 0.0) -> Values:
    """Return phases in rad brought to at most half a turn from `middle_rad`."""
    inside: Values = phase - 2.0 * np.pi * np.rint((phase - middle_rad) / (2.0 * np.pi))
    return inside


def residuals(observed: Values, predicted: Values, /) -> Values:
    """Return data minus their prediction, (data, …) each; differences of phases are wrapped."""
    difference = observed - predicted
    phases = phase_data(len(observed))
    difference[phases] = wrapped(difference[phases])
    return difference
