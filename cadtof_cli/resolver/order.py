"""How many paths a pixel has: thresholds on what a simpler model leaves over the known noise."""

import math
from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Bool
from cadtof_cli.resolver.closed_form import FULL_TURN
from cadtof_cli.resolver.paths import Path


@lru_cache(maxsize=64)
def chi_squared_threshold(false_alarm: float, *, pairs: int) -> float:
    """Return the χ² (2·pairs degrees of freedom) that noise exceeds with probability `false_alarm`.

    N harmonics without a signal have N pairs; K paths fitted to N harmonics leave N − K. The survival function at t is
    exp(−t/2)·Σ_{k<pairs} (t/2)^k/k!: −2·ln(false alarm) for one pair, 9.21 at 1 %. It falls with t, so bisection finds the
    threshold of more.
    """
    low, high = 0.0, 4.0 * (pairs - math.log(false_alarm))
    for _ in range(80):
        middle = 0.5 * (low + high)
        half = 0.5 * middle
        survival = math.exp(-half) * sum(half**k / math.factorial(k) for k in range(pairs))
        low, high = (middle, high) if survival > false_alarm else (low, middle)
    return 0.5 * (low + high)


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
