"""Thresholds on a misfit over the known noise."""

import math
from functools import lru_cache


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
