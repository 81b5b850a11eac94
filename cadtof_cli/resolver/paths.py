"""What resolving gives: the paths of a block of pixels."""

from dataclasses import dataclass, fields

import numpy as np

from cadtof_cli.arrays import Bool, Float, Float32, Index, Status


@dataclass(frozen=True)
class Path:
    """One path of n pixels: amplitude in units of the phasors, phase in rad, its standard deviation in rad, (n,) each.

    Phases lie in [0, 2π), but that of an MPI path that is known to lie behind the direct one may go on to 4π.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float | Float32

    def at(self, pixels: Index | Bool, /) -> "Path":
        """Return the path of some of the pixels."""
        return Path(self.amplitude[pixels], self.phase_rad[pixels], self.sigma_rad[pixels])

    def put(self, pixels: Index, other: "Path", /) -> None:
        """Overwrite the path of some of the pixels."""
        self.amplitude[pixels] = other.amplitude
        self.phase_rad[pixels] = other.phase_rad
        self.sigma_rad[pixels] = other.sigma_rad

    def spread(self, pixels: Index, count: int, /) -> "Path":
        """Return a path of `count` pixels that holds this one's at these indices, and anything elsewhere."""
        whole = Path(np.empty(count), np.empty(count), np.empty(count, self.sigma_rad.dtype))
        whole.put(pixels, self)
        return whole


@dataclass(frozen=True)
class PathSet:
    """Up to K paths of n pixels in no particular order: float64 (K, n) each, NaN where a pixel has fewer.

    `chi_squared`, (n,), is what they leave over the noise; `converged` is not set where the solver gave up; `doubtful` where
    two paths are closer than their standard deviations, so that these are only a lower bound.
    """

    amplitude: Float
    phase_rad: Float
    sigma_rad: Float
    chi_squared: Float
    converged: Bool
    doubtful: Bool

    def at(self, pixels: Index, /) -> "PathSet":
        """Return the paths of some of the pixels."""
        return PathSet(*(getattr(self, name)[..., pixels] for name in _FIELDS))

    def put(self, pixels: Index, others: "PathSet", /) -> None:
        """Overwrite the paths of some of the pixels with others, of which there may be fewer."""
        for name in _FIELDS:
            mine, new = getattr(self, name), getattr(others, name)
            if mine.ndim == 2:
                mine[len(new) :, pixels] = np.nan
                mine[: len(new), pixels] = new
            else:
                mine[pixels] = new


_FIELDS = tuple(field.name for field in fields(PathSet))


@dataclass(frozen=True)
class ResolvedPaths:
    """The answer for n pixels: the direct and the MPI path, float64 (n,) each, NaN where there is none.

    `confidence` is the magnitude of the first phasor; `status` holds bits of `StatusBit`; `others` are the third path and so
    on; `chi_squared` is what the paths leave over the noise, where the solver does not always leave nothing.
    """

    direct: Path
    mpi: Path
    confidence: Float
    status: Status
    others: tuple[Path, ...] = ()
    chi_squared: Float | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """All paths, the direct one first."""
        return (self.direct, self.mpi, *self.others)
