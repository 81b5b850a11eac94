"""Scales of colours: which suits a layer, and the values that it ends at."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

DEPTHS: Final = "viridis"
SIGMAS: Final = "magma"
ERRORS: Final = "RdBu_r"
VOLTAGES: Final = "inferno"
ANGLES: Final = "twilight"
"""Scales of colours: perceptually uniform, and told apart by the colour-blind."""


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
    """Return limits about 0 that hold a share, in %, of each of several maps of differences."""
    sizes = [np.abs(one[np.isfinite(one)]) for one in differences]
    limit = max((float(np.percentile(size, share)) for size in sizes if size.size), default=1.0) or 1e-3
    return -limit, limit


def limits_of(values: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range that all but the outermost half per cent of the finite values lie in, a little widened.

    Where all are the same but for rounding, it reaches a tenth of the value to either side of it.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (0.5, 99.5))
    size = max(abs(low), abs(high))
    margin = 0.02 * (high - low) + 1e-6 if high - low > 1e-6 * size else 0.1 * size or 1.0
    return float(low - margin), float(high + margin)
