"""How many paths a pixel has: thresholds on what a simpler model leaves over the known noise."""

import numpy as np

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.paths import Path
from cadtof_cli.resolver.two_path.closed_form import FULL_TURN


def worth_another(direct: Path, fewer: Path, /) -> Bool:
    """Return where another path moves the direct one by more than the scatter that it costs; `fewer` is that without it.

    One path is biased by δ, two scatter more: E(difference²) = δ² + σ2² − σ1², so the mean squared error of the direct phase is
    the smaller with two where difference² > 2(σ2² − σ1²): the focused information criterion (Claeskens and Hjort 2003,
    doi:10.1198/016214503000000819) for that phase. It stops splits of one path into two all but coinciding ones, a hundredth of
    all pixels by the misfit alone, from doubling the error of all.
    """
    difference = np.abs(direct.phase_rad - fewer.phase_rad)
    difference = np.minimum(difference, FULL_TURN - difference)
    cost = np.square(direct.sigma_rad, dtype=np.float64) - np.square(fewer.sigma_rad)
    worth: Bool = difference * difference > 2.0 * cost
    return worth
