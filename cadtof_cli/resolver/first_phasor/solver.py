"""One path from the fundamental's phase alone, as an ordinary time-of-flight camera has it."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.paths import FULL_TURN, Fit, Paths
from cadtof_cli.resolver.settings import ResolverSettings


class FirstPhasor:
    """The first phasor as a solver."""

    def __init__(self, phasors: Complex, noise: NoiseModel, /) -> None:
        self._phasors, self._noise = phasors, noise
        self.modulus, self.powers = np.abs(phasors[0]), tuple(np.abs(phasor) ** 2 for phasor in phasors)

    def fit(self, _count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit one path (see `Solver`), however badly it fits."""
        del limit
        chosen = np.flatnonzero(pixels)
        amplitude, phase = self.modulus[chosen], np.mod(np.angle(self._phasors[0, chosen]), FULL_TURN)
        _, across = self._noise.each[0].one_path_variances(amplitude)
        paths = Paths(amplitude[np.newaxis], phase[np.newaxis], (np.sqrt(across) / amplitude)[np.newaxis])
        nothing = np.zeros(chosen.size)
        return chosen, Fit(paths, nothing, np.ones(chosen.size, np.bool_), nothing)


def solver(phasors: Complex, /, *, noise: NoiseModel, settings: ResolverSettings, response: object) -> FirstPhasor:
    """Return the solver for a block of phasors, complex128 (H, n)."""
    del settings, response
    return FirstPhasor(phasors, noise)
