"""The registry of layers: for each its name, its unit, its value, and when a map has it."""

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
MISFIT = "chi_squared"
EFFECTIVE_PIXELS = "effective_pixels"

Factors = tuple[Float | float, Float | float]
"""Two factors whose product is the value of a layer."""


def without_offset(phase: Float, offset: Float | None, /) -> Float:
    """Return phases without the phase that the lens adds; a phase below 0 wraps to the end of the unambiguous range."""
    if offset is None:
        return phase
    phase = phase - offset
    return np.where(phase < 0.0, phase + 2.0 * np.pi, phase)


@dataclass(frozen=True, eq=False)
class LayerSource:
    """The source of the layers of a block of n pixels.

    Attributes:
        resolved: the paths of the block's pixels.
        samples: number of recorded pixels that each pixel is a mean of, (n,), or 1.
        metres: c·T1/(4π) in m/rad; for planar depths times z over range, (n,).
        volts: modulation amplitude.
        phase_offset_rad: the phase that the lens adds, (n,); None: 0.
    """

    resolved: "ResolvedPaths"
    samples: Float | float
    metres: Float | float
    volts: float
    phase_offset_rad: Float | None

    def depth(self, path: int, /) -> Factors:
        """Return the factors of a path's depth."""
        return without_offset(self.resolved.paths.phase_rad[path], self.phase_offset_rad), self.metres

    def amplitude(self, path: int, /) -> Factors:
        """Return the factors of a path's amplitude."""
        return self.resolved.paths.amplitude[path], self.volts

    def sigma(self, path: int, /) -> Factors:
        """Return the factors of the standard deviation of a path's depth."""
        return self.resolved.paths.sigma_rad[path], self.metres


@dataclass(frozen=True)
class Layer:
    """A layer of float32 values: its name, its unit, and the function that returns the factors of a block's values."""

    name: str
    unit: str
    value: Callable[[LayerSource], Factors]


def _of_path(path: int, quantity: str) -> Layer:
    """Return the layer of one quantity of a path; `path` is the row of the path in `ResolvedPaths.paths`."""
    unit, value = _QUANTITIES[quantity]
    name = ("direct", "mpi")[path] if path < 2 else f"path{path + 1}"
    return Layer(f"{name}.{quantity}", unit, lambda source: value(source, path))


_QUANTITIES: dict[str, tuple[str, Callable[[LayerSource, int], Factors]]] = {
    "depth": ("m", LayerSource.depth),
    "amplitude": ("V", LayerSource.amplitude),
    "sigma": ("m", LayerSource.sigma),
}
"""Unit and value of each quantity that every path has."""

IN_KERNEL = (
    *(_of_path(path, quantity) for quantity in _QUANTITIES for path in (0, 1)),
    Layer(CONFIDENCE, "V", lambda source: (source.resolved.confidence, source.volts)),
)
"""The first layers of every map: those that the compiled kernel fills (`_kernel_frame.h: LAYERS`)."""

_SEARCHED = Layer(MISFIT, "", lambda source: (source.resolved.chi_squared, 1.0))
"""The layer of the misfit, χ²."""

AVERAGED = Layer(EFFECTIVE_PIXELS, "", lambda source: (source.samples, 1.0))
"""The layer of the number of recorded pixels that each pixel is a mean of."""

_UNITS_BESIDE_MAPS = {"mean": "m", "std": "m", "delay": "ns"}
"""Units of quantities that are in no map: those of truth, and statistics over the frames of a run."""


@lru_cache(maxsize=16)
def wanted_layers(*, paths: int = 2, searched: bool = False, averaged: bool = False) -> tuple[Layer, ...]:
    """Return the layers of a map in the order in which they are written; `status` follows them.

    Args:
        paths: number of paths.
        searched: whether the solver searches, so that its paths leave a misfit.
        averaged: whether pixels are means over frames or neighbours.
    """
    others = (_of_path(path, quantity) for path in range(2, paths) for quantity in _QUANTITIES)
    return (*IN_KERNEL, *others, *(_SEARCHED,) * searched, *(AVERAGED,) * averaged)


def error_unit(unit: str, /) -> tuple[float, str]:
    """Return the factor by which differences of values in a unit are multiplied to be shown, and the unit that they
    then have."""
    return (100.0, "cm") if unit == "m" else (1.0, unit)


def layer_unit(name: str, /) -> str:
    """Return the unit of a layer's values by its name; empty if they are pure numbers."""
    units = {layer.name: layer.unit for layer in wanted_layers(searched=True, averaged=True)} | _UNITS_BESIDE_MAPS
    units |= {quantity: unit for quantity, (unit, _) in _QUANTITIES.items()}
    return units.get(name, units.get(name.rpartition(".")[2], ""))
