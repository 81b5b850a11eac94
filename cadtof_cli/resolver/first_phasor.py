"""One path from the phase of the fundamental alone, as an ordinary time-of-flight camera has it."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.resolver.paths import FULL_TURN, Fit, Paths


class FirstPhasor:
    """The first phasor as a solver."""

    def __init__(self, phasors: Complex, /, *, noise: NoiseModel, **_others: object) -> None:
        self._phasors, self._noise = phasors, noise
        self.modulus, self.powers = np.abs(phasors[0]), [np.abs(phasor) ** 2 for phasor in phasors]

    def fit(self, _count: int, pixels: Bool, /, *, limit: Float | float | None) -> tuple[Index, Fit]:
        """Fit one path (see `Solver`), however badly it fits."""
        del limit
        chosen = np.flatnonzero(pixels)
        amplitude, phase = self.modulus[chosen], np.mod(np.angle(self._phasors[0, chosen]), FULL_TURN)
        sigma = np.sqrt(self._noise.each[0].dark_variance) / amplitude
        nothing = np.zeros(chosen.size)
        return chosen, Fit(Paths(amplitude[None], phase[None], sigma[None]), nothing, np.ones(chosen.size, np.bool_), nothing)


solver = FirstPhasor
