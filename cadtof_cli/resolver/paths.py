"""The records of the resolver: the paths of a block of pixels, a solver's fit, and the answer for each pixel."""

from collections.abc import Iterator
from types import EllipsisType
from typing import TypeAlias

import numpy as np

from cadtof_cli.arrays import Bool, Float, Index, SomePixels, Status
from cadtof_cli.records import dataclass

Some: TypeAlias = int | slice | Index | Bool | EllipsisType
Where: TypeAlias = Some | tuple[Some, ...]
"""Allowed indices of an array of shape (K, n)."""

FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Paths:
    """K paths of n pixels, (K, n) each: amplitude in units of the phasors, phase in rad, its standard deviation in rad.

    `paths[0]` is the first path, `paths[..., pixels]` are all paths of some pixels. If a pixel has fewer than K paths,
    its last rows are NaN. Phases lie in [0, 2π). Only the phase of an MPI path that is known to arrive after the direct
    path may reach 4π.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float

    @classmethod
    def none(cls, shape: tuple[int, ...], /) -> "Paths":
        """Return paths whose values are all NaN."""
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
"""A path of NaN, for the rows that a pixel with fewer paths does not use."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What a solver returns: the K paths that fit n pixels, before the order test and the choice of the direct path.

    Attributes:
        paths: in any order, with the standard deviations for the noise of one recorded pixel.
        chi_squared: (n,), misfit of the paths in units of the noise of one recorded pixel.
        converged: (n,), False where the solver gave up. If its last attempt is of no use, the paths are NaN there.
        doubt: (n,). If it is above 1, the answer is doubtful and the standard deviations are only a lower bound. With
            two paths or more it is the largest standard deviation over a quarter of the distance of two paths (the sine
            of half the distance is used). With one path it is how much the harmonics fall off with frequency, because a
            second path close by makes them fall off (`doubt_of_one`).
    """

    paths: Paths
    chi_squared: Float
    converged: Bool
    doubt: Float

    @classmethod
    def none(cls, paths: int, pixels: int, /) -> "Fit":
        """Return a fit to be filled in: all paths are NaN."""
        return cls(Paths.none((paths, pixels)), np.full(pixels, np.nan), np.ones(pixels, np.bool_), np.zeros(pixels))

    def __getitem__(self, pixels: Index, /) -> "Fit":
        # take is several times as fast as an index of two axes
        paths = Paths(
            self.paths.amplitude.take(pixels, axis=1),
            self.paths.phase_rad.take(pixels, axis=1),
            self.paths.sigma_rad.take(pixels, axis=1),
        )
        return Fit(paths, self.chi_squared[pixels], self.converged[pixels], self.doubt[pixels])

    def __setitem__(self, pixels: SomePixels | Bool, other: "Fit", /) -> None:
        """Overwrite the fit of some pixels. `other` may have fewer paths; the remaining rows become NaN."""
        for row, path in enumerate(self.paths):
            path[pixels] = other.paths[row] if row < len(other.paths) else NO_PATH
        self.chi_squared[pixels], self.doubt[pixels] = other.chi_squared, other.doubt
        self.converged[pixels] = other.converged


CLOSE_ENOUGH = 0.5
"""Threshold on the standard deviation over half the distance of two paths. Above it, errors are often larger than
predicted: from one half on, one pixel in twenty-five is off by more than three standard deviations. Among the pairs of
paths that the order test accepts, the pairs with the larger errors lie farther apart."""

PER_FALL_OFF = 1.0 / 1.2815515655446004**2
"""1/q², where q is the value that a standard normal deviate exceeds with probability 1/10."""


def doubt_of_one(fall_off: Float, /) -> Float:
    """Return the doubt of one path, (n,), from how much more its harmonics fall off with frequency than noise explains.

    `fall_off` is z·|z|, where z has unit variance without MPI; it is positive if the higher harmonics are the shorter
    ones. Two paths close together (D rad apart, with amplitudes a and b) give |p_h| = (a+b)·(1 − h²·D²·ab/2(a+b)²) and
    change the phases by next to nothing. So `fall_off` shows such paths where χ², which looks in all directions, does
    not. Without MPI, one pixel in ten is in doubt.
    """
    return fall_off * PER_FALL_OFF


@dataclass(frozen=True, eq=False)
class ResolvedPaths:
    """The answer for n pixels.

    Attributes:
        paths: 2 rows or more: row 0 is the direct path, row 1 the MPI path, and the other paths follow in falling
            amplitude.
        confidence: magnitude of the first phasor, (n,); NaN if the pixel's values are unusable (saturated, hot, not
            finite).
        status: bits of `StatusBit`, (n,).
        chi_squared: misfit of the paths in units of the noise, (n,); NaN without an answer.
    """

    paths: Paths
    confidence: Float
    status: Status
    chi_squared: Float
