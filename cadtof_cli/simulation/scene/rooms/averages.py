"""Averages over traced pixels on the same face: their weights for every pixel of some rows."""

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Float32, Index
from cadtof_cli.errors import require_memory_for_scipy

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROUNDNESS = 8
"""Exponent of the cosine between two normals in a weight: on a ball, a neighbour with another normal counts less."""


@dataclass(frozen=True)
class Faces:
    """The faces that pixels see: their surface, (n,), as in `Meetings`, and their normals, (3, n)."""

    surface: NDArray[np.int32]
    normals: Float32


@dataclass(frozen=True)
class Lattice:
    """A grid of places on a camera's pixels: the middles of squares of step × step pixels.

    Attributes:
        width: width of the camera in pixels.
        step: pixels from one place to the next.
        reach: number of places to each side that an average may include; weights fall linearly to 0 at reach + 1/2 places.
    """

    width: int
    step: int
    reach: int

    @property
    def across(self) -> int:
        """Number of places in a row."""
        return -(-self.width // self.step)

    def rows(self, pixels: range) -> range:
        """Return the rows of places that averages for rows of pixels may include: from row 0 on, but perhaps beyond the last."""
        return range(max(pixels.start // self.step - self.reach, 0), (pixels.stop - 1) // self.step + self.reach + 1)

    def nearness(self, pixels: Index, places: Index, /) -> Float:
        """Return the weight of places within reach for pixels along one axis: 1 if the place is at the pixel, falling linearly
        to 0."""
        middles = self.step * places + (self.step - 1) / 2
        return np.asarray(1.0 - np.abs(pixels - middles) / (self.step * (self.reach + 0.5)))


def neighbour_weights(lattice: Lattice, rows: range, seen: Faces, places: Index, faces: Faces, /) -> "csr_array":
    """Return the weight of each sample for each pixel of the rows, (Y·X, samples).

    The weights of a pixel are all 0 if no sample within reach is on the pixel's face. `seen` has the faces that the pixels see,
    `faces` the faces of the samples. `places`, (samples,), has the number of each sample's place, counted along the rows of
    `lattice.rows(rows)`. The samples are sorted by place and then by surface.
    """
    require_memory_for_scipy()
    from scipy.sparse import csr_array, diags_array

    keys = _keys(places, faces.surface)
    y, x = (part.ravel() for part in np.meshgrid(np.asarray(rows), np.arange(lattice.width), indexing="ij"))
    first, count = lattice.rows(rows).start, len(lattice.rows(rows))
    found: list[tuple[Float, Index, Index]] = []
    for down, right in itertools.product(range(-lattice.reach, lattice.reach + 1), repeat=2):
        row, column = y // lattice.step + down - first, x // lattice.step + right
        share = lattice.nearness(y, row + first) * lattice.nearness(x, column)
        inside = (row >= 0) & (row < count) & (column >= 0) & (column < lattice.across)
        pixels = np.flatnonzero(inside)
        wanted = _keys(row[pixels] * lattice.across + column[pixels], seen.surface[pixels])
        sample = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        there = keys[sample] == wanted
        pixels, sample = pixels[there], sample[there]
        alike = np.maximum((seen.normals[:, pixels] * faces.normals[:, sample]).sum(axis=0), 0.0) ** ROUNDNESS
        found.append((share[pixels] * alike, pixels, sample))
    weights, pixels, sample = (np.concatenate(part) for part in zip(*found, strict=True))
    matrix = csr_array((weights, (pixels, sample)), shape=(len(y), len(keys)))
    whole = np.asarray(matrix.sum(axis=1)).ravel()
    return csr_array(diags_array(1.0 / np.where(whole > 0, whole, 1.0)) @ matrix)


def means_of_cells(faces: Faces, across: int, cell: int, /) -> tuple["csr_array", Index, Faces]:
    """Return weights that average pixels of the same face over square cells, and the place and face of each average.

    `faces` has the faces of whole rows of `across` pixels; the first row begins a cell. A cell has `cell` pixels on each side.
    """
    require_memory_for_scipy()
    from scipy.sparse import csr_array

    number = np.arange(len(faces.surface))
    row, column = number // across // cell, number % across // cell
    keys, which, count = np.unique(
        _keys(row * -(-across // cell) + column, faces.surface), return_inverse=True, return_counts=True
    )
    means = csr_array((1.0 / count[which], (which, number)), shape=(len(keys), len(number)))
    normals = (means @ faces.normals.T).T
    normals /= np.linalg.norm(normals, axis=0)
    surface = (keys % 2**32).astype(np.int32)
    return means, keys // 2**32, Faces(surface, normals.astype(np.float32))


def _keys(places: Index, surface: NDArray[np.int32]) -> Index:
    """Return numbers that are equal where both place and surface are equal."""
    return places.astype(np.int64) * 2**32 + surface
