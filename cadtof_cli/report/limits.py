"""Between which values the colours of a layer lie: the same for all frames of a run."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Limits = tuple[float, float, float, float]
"""1 % and 99 % of the values, the lowest and the highest."""

MOST_PIXELS = 20_000
"""Of a plane; more of them would not move the ends of the colours."""


class LayerLimits:
    """The widest limits of each layer in any frame."""

    def __init__(self) -> None:
        self._known: dict[str, Limits] = {}

    def add(self, name: str, plane: NDArray[np.floating], /) -> None:
        """Add a layer of a frame, of any shape; what is not finite does not count."""
        flat = plane.reshape(-1)
        flat = flat[:: max(1, flat.size // MOST_PIXELS)]
        values = flat[np.isfinite(flat)].astype(np.float64)
        if not values.size:
            return
        low, high = np.quantile(values, (0.01, 0.99))
        found = (float(low), float(high), float(values.min()), float(values.max()))
        before = self._known.get(name, found)
        self._known[name] = (
            min(before[0], found[0]),
            max(before[1], found[1]),
            min(before[2], found[2]),
            max(before[3], found[3]),
        )

    def known(self) -> Mapping[str, Limits]:
        """Return the limits of each layer that has a value somewhere."""
        return dict(self._known)
