"""The registry of layers: the name, the unit and the value of each, and when it is wanted."""

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.resolver.paths import ResolvedPaths

DIRECT_DEPTH = "direct.depth"
MPI_DEPTH = "mpi.depth"
DIRECT_AMPLITUDE = "direct.amplitude"
DIRECT_SIGMA = "direct.sigma"
CONFIDENCE = "confidence"
EFFECTIVE_PIXELS = "effective_pixels"

Factors = tuple[Float | float, Float | float]
"""Two factors whose product is the value of a layer."""


def without_offset(phase: Float, offset: Float | None, /) -> Float:
    """Return phases without what the lens adds; what that moves below 0 comes from the end of the unambiguous range."""
    if offset is None:
        return phase
    phase = phase - offset
    return np.where(phase < 0.0, phase + 2.0 * np.pi, phase)


@dataclass(frozen=True, eq=False)
class LayerSource:
    """What the values of a block's layers follow from.

    Attributes:
        resolved: the paths of the block's pixels.
        samples: recorded pixels that each has been averaged over, (n,), or 1.
        metres: c·T1/(4π), for planar depths times z over range, (n,); in m/rad.
        volts: modulation amplitude.
        phase_offset_rad: what the lens adds to every phase, (n,); None: nothing.
    """

    resolved: "ResolvedPaths"
    samples: Float | float
    metres: Float | float
    volts: float
    phase_offset_rad: Float | None

    def depth(self, path: int, /) -> Factors:
        """Depth of a path."""
        return without_offset(self.resolved.paths.phase_rad[path], self.phase_offset_rad), self.metres

    def amplitude(self, path: int, /) -> Factors:
        """Amplitude of a path."""
        return self.resolved.paths.amplitude[path], self.volts

    def sigma(self, path: int, /) -> Factors:
        """Standard deviation of a path's depth."""
        return self.resolved.paths.sigma_rad[path], self.metres


@dataclass(frozen=True)
class Layer:
    """A layer of float32 values: its name, the unit, and how a block's values follow from its paths."""

    name: str
    unit: str
    value: Callable[[LayerSource], Factors]


def _of_path(path: int, quantity: str) -> Layer:
    """Return the layer of one quantity of the path in a row of `ResolvedPaths.paths`."""
    unit, value = _QUANTITIES[quantity]
    name = ("direct", "mpi")[path] if path < 2 else f"path{path + 1}"
    return Layer(f"{name}.{quantity}", unit, lambda source: value(source, path))


_QUANTITIES: dict[str, tuple[str, Callable[[LayerSource, int], Factors]]] = {
    "depth": ("m", LayerSource.depth),
    "amplitude": ("V", LayerSource.amplitude),
    "sigma": ("m", LayerSource.sigma),
}
"""Unit and value of what there is of every path."""

ALWAYS = (
    *(_of_path(path, quantity) for quantity in _QUANTITIES for path in (0, 1)),
    Layer(CONFIDENCE, "V", lambda source: (source.resolved.confidence, source.volts)),
)

_SEARCHED = Layer("chi_squared", "", lambda source: (source.resolved.chi_squared, 1.0))
"""What the paths leave over the noise."""

_AVERAGED = Layer(EFFECTIVE_PIXELS, "", lambda source: (source.samples, 1.0))
"""The layer of how many recorded pixels each pixel is a mean of."""

_UNITS_BESIDE_MAPS = {"mean": "m", "std": "m", "delay": "ns"}
"""Units of quantities of truth, and over the frames of a run."""


@lru_cache(maxsize=16)
def wanted_layers(*, paths: int = 2, searched: bool = False, averaged: bool = False) -> tuple[Layer, ...]:
    """Return the layers of a map of so many paths in the order in which they are written; `status` follows them.

    A solver that searches, so that its paths leave more than nothing, is `searched`; frames or neighbours are `averaged`.
    """
    others = (_of_path(path, quantity) for path in range(2, paths) for quantity in _QUANTITIES)
    return (*ALWAYS, *others, *(_SEARCHED,) * searched, *(_AVERAGED,) * averaged)


def error_unit(unit: str, /) -> tuple[float, str]:
    """Return by what to multiply differences of values in a unit, and the unit that they are shown in then."""
    return (100.0, "cm") if unit == "m" else (1.0, unit)


def layer_unit(name: str, /) -> str:
    """Return the unit of a layer's values by its name; empty where they are pure numbers."""
    units = {layer.name: layer.unit for layer in (*ALWAYS, _SEARCHED, _AVERAGED)} | _UNITS_BESIDE_MAPS
    quantity = name.rpartition(".")[2]
    return units.get(quantity, _QUANTITIES.get(quantity, ("",))[0])
