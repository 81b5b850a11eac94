"""Scales of colours: the colours and the limits that suit a layer; and the colours of the parts of a pixel's light."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

DEPTHS: Final = "viridis"
SIGMAS: Final = "magma"
ERRORS: Final = "RdBu_r"
VOLTAGES: Final = "inferno"
ANGLES: Final = "twilight"
"""Names of colour maps. They are perceptually uniform, and colour-blind people can tell their colours apart."""

DIRECT_COLOUR, MPI_COLOUR, OTHER_COLOUR = "#1b6ca8", "#d1495b", "#7a5195"
MEASURED_COLOUR, AMBIENT_COLOUR = "#222222", "#b8b8b8"
"""Colours of the direct path, the MPI and further paths, and of what is recorded, in pictures of a single pixel."""


@dataclass(frozen=True)
class Scale:
    """A scale of colours.

    Attributes:
        colours: name of the colour map.
        limits: values of the first and the last colour.
        reach: lowest and highest value of all frames of a film or sheet that share the scale; None: those that are drawn.
        ends: texts for the two ends of the bar, which replace its numbers.
    """

    colours: str
    limits: tuple[float, float]
    reach: tuple[float, float] | None = None
    ends: tuple[str, ...] = ()

    @classmethod
    def of_layer(cls, name: str, /, *values: NDArray[np.floating]) -> "Scale":
        """Return the scale that suits a layer by its name and by its values in one map or in several."""
        known = np.concatenate([one.ravel() for one in values])
        if name.endswith(".phase"):
            return cls(ANGLES, (0.0, 2.0 * np.pi))
        if ".SC" in name or ".offset" in name:
            return cls.of_differences(known, share=99.5)
        if name.endswith((".sigma", ".std", ".noise")):
            return cls(SIGMAS, _from_zero(limits_of(known)))
        if name.endswith(("amplitude", "confidence")):
            return cls(VOLTAGES, _from_zero(limits_of(known)))
        return cls(DEPTHS, limits_of(known))

    @classmethod
    def of_differences(cls, *differences: NDArray[np.floating], share: float = 90.0) -> "Scale":
        """Return a scale, symmetric about 0, whose limits contain a `share` in % of the values of each map of differences."""
        sizes = [np.abs(one[np.isfinite(one)]) for one in differences]
        limit = max((float(np.percentile(size, share)) for size in sizes if size.size), default=1.0) or 1e-3
        return cls(ERRORS, (-limit, limit))

    def chosen(self, limits: tuple[float, float] | None, colours: str | None, /) -> "Scale":
        """Return the scale with the limits and colours that a user chose; None: these stay."""
        return replace(self, limits=limits or self.limits, colours=colours or self.colours)


def _from_zero(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits that begin at 0; if no value is above 0, as in files of other programs, they stay."""
    return (0.0, limits[1]) if limits[1] > 0.0 else limits


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
