"""Scales of colours: the colours and the limits that suit a layer."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

DEPTHS: Final = "viridis"
SIGMAS: Final = "magma"
ERRORS: Final = "RdBu_r"
VOLTAGES: Final = "inferno"
ANGLES: Final = "twilight"
"""Names of colour maps. They are perceptually uniform, and colour-blind people can tell their colours apart."""


def default_scale(name: str, values: NDArray[np.floating], /) -> tuple[str, tuple[float, float]]:
    """Return colours and limits that suit a layer by its name and values."""
    if name.endswith(".phase"):
        return ANGLES, (0.0, 2.0 * np.pi)
    if ".SC" in name or ".offset" in name:
        return ERRORS, signed_limits(values, share=99.5)
    if name.endswith((".sigma", ".std", ".noise")):
        return SIGMAS, (0.0, limits_of(values)[1])
    if name.endswith(("amplitude", "confidence")):
        return VOLTAGES, (0.0, limits_of(values)[1])
    return DEPTHS, limits_of(values)


def signed_limits(*differences: NDArray[np.floating], share: float = 90.0) -> tuple[float, float]:
    """Return limits, symmetric about 0, that contain a `share` in % of the values of each map of differences."""
    sizes = [np.abs(one[np.isfinite(one)]) for one in differences]
    limit = max((float(np.percentile(size, share)) for size in sizes if size.size), default=1.0) or 1e-3
    return -limit, limit


def limits_of(values: NDArray[np.floating], /) -> tuple[float, float]:
    """Return the range of the finite values without the lowest and the highest half per cent, a little widened.

    If all values are equal except for rounding, the range extends by a tenth of the value to both sides.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (0.5, 99.5))
    size = max(abs(low), abs(high))
    margin = 0.02 * (high - low) + 1e-6 if high - low > 1e-6 * size else 0.1 * size or 1.0
    return float(low - margin), float(high + margin)
