"""The records of the resolver: the paths of a block of pixels, a fit of them, and what is resolved."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import EllipsisType
from typing import TypeAlias

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, Status

Some: TypeAlias = int | slice | Index | Bool | EllipsisType
Where: TypeAlias = Some | tuple[Some, ...]
"""What an array of shape (K, n) may be indexed by."""

FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Paths:
    """K paths of n pixels, (K, n) each: amplitude in units of the phasors, phase in rad, its standard deviation in rad.

    `paths[0]` is the first path, `paths[..., pixels]` are all paths of some pixels. NaN stands where a pixel has fewer
    paths, in the last rows. Phases lie in [0, 2π), but that of an MPI path that is known to lie behind the direct one may go
    on to 4π.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float

    @classmethod
    def none(cls, shape: tuple[int, ...], /) -> "Paths":
        """Return paths of which nothing is known: NaN."""
        return cls(np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan))

    def __getitem__(self, where: Where, /) -> "Paths":
        return Paths(self.amplitude[where], self.phase_rad[where], self.sigma_rad[where])

    def __setitem__(self, where: Where, others: "Paths", /) -> None:
        self.amplitude[where] = others.amplitude
        self.phase_rad[where] = others.phase_rad
        self.sigma_rad[where] = others.sigma_rad

    def __len__(self) -> int:
        return len(self.amplitude)

    def __iter__(self) -> Iterator["Paths"]:
        return (self[row] for row in range(len(self)))


NO_PATH = Paths.none((1,))
"""What stands where a pixel has fewer paths than there is room for."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What a solver returns: the K paths that fit n pixels, before anything is decided about them.

    Attributes:
        paths: in any order, with the standard deviations that one recorded pixel's noise gives.
        chi_squared: (n,), what they leave over the noise of one recorded pixel.
        converged: (n,), not set where the solver gave up. Such paths are NaN where the attempt is worth nothing.
        doubt: (n,), the largest standard deviation over half the distance (its sine) of two paths. Above 1 the two cannot be
            told apart, and the standard deviations are only a lower bound. It means nothing where there is one path.
    """

    paths: Paths
    chi_squared: Float
    converged: Bool
    doubt: Float

    def __getitem__(self, pixels: Index, /) -> "Fit":
        # take is several times as fast as an index of two axes
        paths = Paths(
            self.paths.amplitude.take(pixels, axis=1),
            self.paths.phase_rad.take(pixels, axis=1),
            self.paths.sigma_rad.take(pixels, axis=1),
        )
        return Fit(paths, self.chi_squared[pixels], self.converged[pixels], self.doubt[pixels])

    def __setitem__(self, pixels: Index | slice, other: "Fit", /) -> None:
        """Write over the fit of some pixels; it may have fewer paths."""
        for row, path in enumerate(self.paths):
            path[pixels] = other.paths[row] if row < len(other.paths) else NO_PATH
        self.chi_squared[pixels], self.doubt[pixels] = other.chi_squared, other.doubt
        self.converged[pixels] = other.converged


@dataclass(frozen=True, eq=False)
class ResolvedPaths:
    """The answer for n pixels.

    Attributes:
        paths: 2 or more; row 0 is the direct path, row 1 that of the MPI, the others follow in falling amplitude.
        confidence: magnitude of the first phasor, (n,), NaN where it is not sound.
        status: bits of `StatusBit`, (n,).
        chi_squared: what the paths leave over the noise, (n,), NaN without an answer.
    """

    paths: Paths
    confidence: Float
    status: Status
    chi_squared: Float

    @property
    def direct(self) -> Paths:
        """The direct path, (n,) each."""
        return self.paths[0]

    @property
    def mpi(self) -> Paths:
        """The path of the MPI, (n,) each."""
        return self.paths[1]
