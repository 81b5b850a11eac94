"""The records of the resolver: the paths of a block of pixels, a fit of them, and what is resolved."""

from collections.abc import Iterator
from types import EllipsisType
from typing import TypeAlias

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, SomePixels, Status
from cadtof_cli.records import dataclass

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
        doubt: (n,), above 1 where the answer is doubtful and the standard deviations are only a lower bound. Of two paths or
            more: the largest standard deviation over a quarter of the distance of two (by the sine of half of it). Of one
            path: by how much its harmonics fall off, as they do where another path is close by (`doubt_of_one`).
    """

    paths: Paths
    chi_squared: Float
    converged: Bool
    doubt: Float

    @classmethod
    def none(cls, paths: int, pixels: int, /) -> "Fit":
        """Return a fit of nothing, to be filled in: NaN."""
        return cls(Paths.none((paths, pixels)), np.full(pixels, np.nan), np.ones(pixels, np.bool_), np.zeros(pixels))

    def __getitem__(self, pixels: Index, /) -> "Fit":
        # take is several times as fast as an index of two axes
        paths = Paths(
            self.paths.amplitude.take(pixels, axis=1),
            self.paths.phase_rad.take(pixels, axis=1),
            self.paths.sigma_rad.take(pixels, axis=1),
        )
        return Fit(paths, self.chi_squared[pixels], self.converged[pixels], self.doubt[pixels])

    def __setitem__(self, pixels: SomePixels, other: "Fit", /) -> None:
        """Write over the fit of some pixels; it may have fewer paths."""
        for row, path in enumerate(self.paths):
            path[pixels] = other.paths[row] if row < len(other.paths) else NO_PATH
        self.chi_squared[pixels], self.doubt[pixels] = other.chi_squared, other.doubt
        self.converged[pixels] = other.converged


CLOSE_ENOUGH = 0.5
"""Standard deviations over half the distance of two paths from which on their errors are often larger: from a half on one in
twenty-five is beyond three standard deviations, and what the order test lets pass is the farther apart the worse it is."""

PER_FALL_OFF = 1.0 / 1.2815515655446004**2
"""One over the square of what a normal deviate exceeds once in ten times."""


def doubt_of_one(fall_off: Float, /) -> Float:
    """Return the doubt of one path from how much more its harmonics fall off than noise lets them, (n,).

    `fall_off` is the square of a deviate of unit variance without MPI, with its sign: positive where higher harmonics are the
    shorter. Paths close together (D rad apart, with shares a and b of their light) leave |p_h| = (a+b)·(1 − h²·D²·ab/2(a+b)²) and
    next to nothing in the phases, so this sees them where χ², which looks in all directions, does not. One pixel in ten without
    MPI is in doubt.
    """
    return fall_off * PER_FALL_OFF


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
