"""How many paths a pixel has: thresholds on what a simpler model leaves over the known noise."""

import math
from functools import lru_cache


def second_path_threshold(false_alarm: float) -> float:
    """Return the χ² (2 degrees of freedom) that one path exceeds with probability `false_alarm`: 9.21 at 1 %."""
    return -2.0 * math.log(false_alarm)


@lru_cache
def signal_threshold(false_alarm: float, *, harmonics: int) -> float:
    """Return the χ² (2·harmonics degrees of freedom) that noise without a signal exceeds with that probability.

    The survival function at t is exp(−t/2)·Σ_{k<harmonics} (t/2)^k/k!; it falls with t, so bisection finds the threshold.
    """
    low, high = 0.0, 2.0 * (harmonics - math.log(false_alarm)) * 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        half = 0.5 * middle
        survival = math.exp(-half) * sum(half**k / math.factorial(k) for k in range(harmonics))
        low, high = (middle, high) if survival > false_alarm else (low, middle)
    return 0.5 * (low + high)
