"""What the fit of the patches computes patch by patch: the same few operations for each, in their own order.

`_patch_steps.h` is the compiled twin, and this module is its front. Sums are written out term by term: the rounding in
numpy's matrix products differs from machine to machine.
"""

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.tail import phase_data, residuals
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous, extension
from cadtof_cli.resolver.paths import FULL_TURN

LARGEST_STEP = 0.8
"""Largest change of a component per step (ln or ns): the model bends over a factor of two."""


@dataclass(frozen=True, eq=False)
class PatchSteps:
    """The steps of a fit of n patches to their data.

    Attributes:
        data: the data, (data, n).
        error: covariance of the errors of the model's values, and of noise, (data + 2, data + 2, n).
        within: variances of the states in one room, (6,).
        pattern: how states differ between patches by rule, (6, n).
    """

    data: Float
    error: Float
    within: Float
    pattern: Float

    def evidence(self, values: Float, jacobian: Float, state: Float, /) -> tuple[Float, Float]:
        """Return what the patches tell of the room's state, whitened, (data, 7, n), and their linearised data, (data, n).

        The whitened part holds the Jacobians of the patches, then their data.

        Args:
            values: values of the model at the states, (data + 2, n).
            jacobian: of these values, (6, data + 2, n).
            state: (6, n).
        """
        seen, noise = self._of_data(jacobian)
        linear = residuals(self.data, values[: len(self.data)]) + _total((state - self.pattern)[:, None] * seen)
        scatter = _total((self.within[:, None, None] * seen)[:, :, None] * seen[:, None]) + noise
        return whitened(scatter, _with(seen.swapaxes(0, 1), linear)), linear

    def moved(self, state: Float, linear: Float, jacobian: Float, room: Float, spread: Float, /) -> Float:
        """Return the states after a step towards the most probable ones, (6, n), given the room's state.

        Args:
            state: before the step, (6, n).
            linear: linearised data, from `evidence`.
            jacobian: of the model's values, (6, data + 2, n).
            room: the room's state, (6,).
            spread: covariance of a patch's state before its own data are seen, (6, 6).
        """
        seen, noise = self._of_data(jacobian)
        missed = linear - _total(room[:, None, None] * seen)
        white = whitened(_scatter(spread, seen) + noise, _with(seen.swapaxes(0, 1), missed))
        pull = _total(white[:, :-1] * white[:, -1:])
        change = room[:, None] + self.pattern - state + _times(spread, pull)
        return state + np.maximum(np.minimum(change, LARGEST_STEP), -LARGEST_STEP)

    def posterior(
        self, values: Float, jacobian: Float, state: Float, room: Float, spread: Float, /
    ) -> tuple[Float, Float, Float]:
        """Return the model's values before and after a patch's own data are seen, and their covariance before.

        The values, (data + 2, n) each, are those of the linear model. The covariance, (data + 2, data + 2, n), is
        without noise. Phases get the whole turns that bring `values` next to the data: the linear model may be off by
        more than half a turn before the data are seen.
        """
        count = len(self.data)
        expected = values + _total((room[:, None] + self.pattern - state)[:, None] * jacobian)
        phases = phase_data(count)
        expected[phases] += FULL_TURN * np.rint((self.data - values[:count])[phases] / FULL_TURN)
        covariance = _scatter(spread, jacobian)
        joint = covariance[:count] + self.error[:count]
        white = whitened(joint[:, :count].copy(), _with(joint, self.data - expected[:count]))
        return expected, expected + _total(white[:, :-1] * white[:, -1:]), covariance

    def _of_data(self, jacobian: Float) -> tuple[Float, Float]:
        """Return the parts of Jacobians and errors that belong to the data, without those of ln H_1."""
        count = len(self.data)
        return jacobian[:, :count], self.error[:count, :count]


@dataclass(frozen=True, eq=False)
class CompiledSteps(PatchSteps):
    """`PatchSteps` by the compiled kernel, with the same bits."""

    def evidence(self, values: Float, jacobian: Float, state: Float, /) -> tuple[Float, Float]:
        """Return the same as `PatchSteps.evidence`."""
        white, linear = np.empty((len(self.data), 7, self.data.shape[1])), np.empty(self.data.shape)
        given = self._given(values, jacobian, state, None, None, None)
        extension().step_patches(chosen_kernel(), 0, *given, white, linear, None)
        return white, linear

    def moved(self, state: Float, linear: Float, jacobian: Float, room: Float, spread: Float, /) -> Float:
        """Return the same as `PatchSteps.moved`."""
        moved = np.empty(state.shape)
        given = self._given(None, jacobian, state, linear, room, spread)
        extension().step_patches(chosen_kernel(), 1, *given, moved, None, None)
        return moved

    def posterior(
        self, values: Float, jacobian: Float, state: Float, room: Float, spread: Float, /
    ) -> tuple[Float, Float, Float]:
        """Return the same as `PatchSteps.posterior`."""
        expected, posterior, covariance = np.empty(values.shape), np.empty(values.shape), np.empty(self.error.shape)
        given = self._given(values, jacobian, state, None, room, spread)
        extension().step_patches(chosen_kernel(), 2, *given, expected, posterior, covariance)
        return expected, posterior, covariance

    def _given(self, *given: Float | None) -> list[Float | None]:
        """Return what a step in `_patch_steps.h` takes; None stands for an array that the step does not need."""
        return contiguous(self.data, self.error, self.within, self.pattern, *given)


def whitened(covariance: Float, right: Float, /) -> Float:
    """Return L⁻¹·right for covariances L·Lᵀ, (data, data, n), and right sides, (data, k, n); both arrays are overwritten."""
    left, white = covariance, right
    for i, row in enumerate(left):
        scale = 1.0 / np.sqrt(row[i])
        white[i] *= scale
        left[i + 1 :, i] *= scale
        for j in range(i + 1, len(left)):
            white[j] -= left[j, i] * white[i]
            left[j, i + 1 : j + 1] -= left[j, i] * left[i + 1 : j + 1, i]
    return white


def _with(vectors: Float, last: Float) -> Float:
    """Return vectors (data, k, n) and one more, (data, n), in C order; matrix products may round another order differently."""
    together = np.empty((vectors.shape[0], vectors.shape[1] + 1, *vectors.shape[2:]))
    together[:, :-1], together[:, -1] = vectors, last
    return together


def _scatter(spread: Float, jacobian: Float) -> Float:
    """Return the covariance (k, k, n) of values with these Jacobians, (6, k, n), for states of covariance `spread`, (6, 6)."""
    return _total(_times(spread, jacobian)[:, :, None] * jacobian[:, None])


def _times(matrix: Float, vectors: Float) -> Float:
    """Return a symmetric matrix (6, 6) times vectors (6, …)."""
    return _total(matrix.reshape(6, 6, *(1 for _ in vectors.shape[1:])) * vectors[:, None])


def _total(terms: Float) -> Float:
    """Return the sum over the first axis, along which numpy adds one term after the other."""
    total: Float = terms.sum(axis=0)
    return total
