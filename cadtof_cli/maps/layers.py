"""The layers of a depth map, and the buffer they are computed in."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float32, Status

DIRECT_DEPTH = "direct.depth"
MPI_DEPTH = "mpi.depth"
DIRECT_AMPLITUDE = "direct.amplitude"
MPI_AMPLITUDE = "mpi.amplitude"
DIRECT_SIGMA = "direct.sigma"
MPI_SIGMA = "mpi.sigma"
CONFIDENCE = "confidence"
STATUS = "status"

LAYER_UNITS: dict[str, str] = {
    DIRECT_DEPTH: "m",
    MPI_DEPTH: "m",
    DIRECT_AMPLITUDE: "V",
    MPI_AMPLITUDE: "V",
    DIRECT_SIGMA: "m",
    MPI_SIGMA: "m",
    CONFIDENCE: "V",
}
"""Names and units of the float32 layers, in the order in which they are written; `status` follows them."""


@dataclass(frozen=True)
class DepthMaps:
    """The maps of one frame.

    `pages` is float32 (layer, Y, X) in the order of `names`, with one page more at its end, which the TIFF writer keeps
    for the `status` bits, uint32 (Y, X).
    """

    names: tuple[str, ...]
    pages: Float32
    status: Status

    @property
    def values(self) -> Float32:
        """The layers, float32 (layer, Y, X)."""
        return self.pages[:-1]

    def layer(self, name: str, /) -> Float32:
        """Return one float32 layer, (Y, X)."""
        plane: Float32 = self.pages[self.names.index(name)]
        return plane


def empty_maps(height: int, width: int, /) -> DepthMaps:
    """Return uninitialised maps of the given size, for a frame's blocks to be written into."""
    names = tuple(LAYER_UNITS)
    return DepthMaps(names, np.empty((len(names) + 1, height, width), np.float32), np.empty((height, width), np.uint32))
