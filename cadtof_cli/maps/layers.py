"""The layers of a depth map, and the buffer they are computed in."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.files.maps import DepthMaps

DIRECT_DEPTH = "direct.depth"
MPI_DEPTH = "mpi.depth"
DIRECT_AMPLITUDE = "direct.amplitude"
MPI_AMPLITUDE = "mpi.amplitude"
DIRECT_SIGMA = "direct.sigma"
MPI_SIGMA = "mpi.sigma"
CONFIDENCE = "confidence"

CHI_SQUARED = "chi_squared"
EFFECTIVE_PIXELS = "effective_pixels"

_ALWAYS = (DIRECT_DEPTH, MPI_DEPTH, DIRECT_AMPLITUDE, MPI_AMPLITUDE, DIRECT_SIGMA, MPI_SIGMA, CONFIDENCE)


@dataclass(frozen=True, kw_only=True)
class LayerChoice:
    """Which float32 layers a map has.

    Attributes:
        paths: how many paths a pixel may have, 2 or more.
        chi_squared: with what the paths leave over the noise, where the solver does not always leave nothing.
        effective_pixels: with how many recorded pixels each has been averaged over.
    """

    paths: int = 2
    chi_squared: bool = False
    effective_pixels: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the layers in the order in which they are written; `status` follows them."""
        later = [
            f"path{number}.{what}" for number in range(3, self.paths + 1) for what in ("depth", "amplitude", "sigma")
        ]
        asked = ((CHI_SQUARED, self.chi_squared), (EFFECTIVE_PIXELS, self.effective_pixels))
        return (*_ALWAYS, *later, *(name for name, wanted in asked if wanted))

    @property
    def units(self) -> dict[str, str]:
        """Names and units of the layers."""
        return {name: layer_unit(name) for name in self.names}


def layer_unit(name: str, /) -> str:
    """Return the unit of a layer's values, by what its name ends with; empty where they are pure numbers."""
    return {"depth": "m", "sigma": "m", "amplitude": "V", CONFIDENCE: "V"}.get(name.rpartition(".")[2], "")


def empty_maps(height: int, width: int, /, *, layers: LayerChoice) -> DepthMaps:
    """Return uninitialised maps of the given size, for a frame's blocks to be written into."""
    names = layers.names
    return DepthMaps(names, np.empty((len(names) + 1, height, width), np.float32), np.empty((height, width), np.uint32))
