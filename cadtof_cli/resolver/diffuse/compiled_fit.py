"""The front of the compiled twin of the computations patch by patch in `tail` and `patch_steps`, `_patch_steps.h`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, extension

MOST_HARMONICS = 8
"""Largest number of harmonics for which the compiled twins have room; numpy has no limit."""


def is_compiled_for(harmonics: int, /) -> bool:
    """Return whether the chosen kernel has compiled twins for so many harmonics: numpy has none."""
    return chosen_kernel() != NUMPY and harmonics <= MOST_HARMONICS


def compiled_slopes(
    given: tuple[Float, Float, Float, Complex, Complex, Complex], constants: tuple[Float, Float, Float], /
) -> tuple[Float, Float]:
    """Return the same as `TailModel._slopes`, with the same bits.

    Args:
        given: state, (5, n); cosines and sines, (H, n) each; and the light of n patches, three times (H, n).
        constants: for each harmonic, (H, 1) each: its number, hω, and the factor `TailModel._onset`.
    """
    harmonics, patches = given[1].shape
    total, jacobian = np.empty((3, harmonics, patches)), np.empty((6, 2 * harmonics, patches))
    extension().tail_slopes(chosen_kernel(), *_contiguous(*constants, *given), total, jacobian)
    return total, jacobian


@dataclass(frozen=True, eq=False)
class CompiledSteps:
    """`PatchSteps` by the compiled kernel, with the same bits."""

    data: Float
    error: Float
    within: Float
    pattern: Float

    def evidence(self, values: Float, jacobian: Float, state: Float, /) -> tuple[Float, Float]:
        """Return the same as `PatchSteps.evidence`."""
        white, linear = np.empty((len(self.data), 7, self.data.shape[1])), np.empty(self.data.shape)
        self._step(0, (values, jacobian, state, None, None, None), (white, linear, None))
        return white, linear

    def moved(self, state: Float, linear: Float, jacobian: Float, room: Float, spread: Float, /) -> Float:
        """Return the same as `PatchSteps.moved`."""
        moved = np.empty(state.shape)
        self._step(1, (None, jacobian, state, linear, room, spread), (moved, None, None))
        return moved

    def posterior(
        self, values: Float, jacobian: Float, state: Float, room: Float, spread: Float, /
    ) -> tuple[Float, Float, Float]:
        """Return the same as `PatchSteps.posterior`."""
        expected, posterior, covariance = np.empty(values.shape), np.empty(values.shape), np.empty(self.error.shape)
        self._step(2, (values, jacobian, state, None, room, spread), (expected, posterior, covariance))
        return expected, posterior, covariance

    def _step(self, step: int, given: tuple[Float | None, ...], answers: tuple[Float | None, ...]) -> None:
        """Take one of the steps in `_patch_steps.h`; None stands for an array that the step does not need."""
        fixed = (self.data, self.error, self.within, self.pattern)
        extension().step_patches(chosen_kernel(), step, *_contiguous(*fixed, *given), *answers)


def _contiguous(*arrays: NDArray[Any] | None) -> list[NDArray[Any] | None]:
    return [None if array is None else np.ascontiguousarray(array) for array in arrays]
