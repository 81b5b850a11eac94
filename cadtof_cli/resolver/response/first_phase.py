"""The phase of the one path that would answer as the fundamental alone does, whatever else was recorded."""

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.resolver.paths import FULL_TURN
from cadtof_cli.resolver.response.table import ENTRIES, ResponseBlock


def first_phase(phasor: Complex, /, *, response: ResponseBlock | None) -> Float:
    """Return the phase in [0, 2π) of a single path, float64 (n,), from the phasors of the fundamental; NaN stays NaN.

    Args:
        phasor: complex128 (n,), normalised.
        response: of the same pixels; None: that of a sine, where the phase is the phasor's own.
    """
    with np.errstate(invalid="ignore"):
        if response is None:
            return np.asarray(np.mod(np.angle(phasor), FULL_TURN))
        table = response.stages[-1][0].planes
        theta = FULL_TURN / ENTRIES * np.arange(ENTRIES + 1)
        answered = np.angle(table[0].astype(np.float64) + 1j * table[1])
        answered = np.unwrap(np.append(answered, answered[0]))
        own = 0.0 if response.phase_rad is None else response.phase_rad[0].astype(np.float64)
        seen = np.angle(phasor) + own
        # a turn of θ is a turn of the answer, which begins anywhere
        turned = answered[0] + np.mod(seen - answered[0], FULL_TURN)
        return np.asarray(np.mod(np.interp(turned, answered, theta) - own, FULL_TURN))
