"""What the prediction gives: the frame's model, the answers of pixels, and the numbers behind them."""

from dataclasses import fields
from typing import Any

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index, Values
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings, range_from_phase
from cadtof_cli.resolver.diffuse.upsampling import Upsampler


@dataclass(frozen=True, eq=False)
class Tails:
    """H_h of the nearer and of the farther of two paths, (H,) each, for so numbered harmonics."""

    near: Complex
    far: Complex
    harmonics: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class SeenThrough:
    """What lets light through, such as a net.

    Attributes:
        found: patches that it covers, (rows, columns).
        near_m: its range there and in the patches around, NaN elsewhere.
        tails: H_h of the light that it sends back, and of what lies behind it.
        variance: of the phase of its direct light, rad², besides that of noise.
    """

    found: Bool
    near_m: Float
    tails: Tails
    variance: float


Parts = tuple[Any, Any]
"""Real and imaginary part, float32 (n,) each: numpy's products of complex numbers differ from machine to machine."""


@dataclass(frozen=True, eq=False)
class PixelTails:
    """The tail of n pixels: ln|H_1| and arg H_1, (n,), and H_m by the multiple m of the fundamental that other terms see."""

    size: Float32
    lag_rad: Float32
    of_terms: dict[int, Parts]

    @classmethod
    def of(cls, planes: Float32, harmonics: tuple[int, ...], /) -> "PixelTails":
        """Return what planes (2 + 2·M, n) hold: ln|H_1|, arg H_1, then the real, then the imaginary parts of H_m."""
        size, lag, *parts = planes
        count = len(harmonics)
        return cls(size, lag, dict(zip(harmonics, zip(parts[:count], parts[count:], strict=True), strict=True)))


@dataclass(frozen=True, eq=False)
class TermTails:
    """The tail of patches as the other terms of a response see it, at so many multiples m of the fundamental, `harmonics`.

    `planes`, float32 (2 + 2·M, rows, columns), are ln|H_1|, arg H_1, then the real, then the imaginary parts of H_m; `upsampler`
    brings them to the pixels.
    """

    harmonics: tuple[int, ...]
    planes: Float32
    upsampler: Upsampler


@dataclass(frozen=True, eq=False)
class DiffuseModel:
    """The coarse model of a whole frame, from which each pixel is answered.

    Attributes:
        settings: what was asked for.
        choice: which model was taken.
        variances: noise of a channel of each harmonic, in squared units of the phasors, of one recorded pixel.
        coarse: what the planes of `upsampler` hold.
        upsampler: brings them to the pixels.
        separate: patches with separate paths, (rows, columns): their pixels are left to the solver of separate paths.
        separate_variance: variance in rad² that the room's tail adds to those pixels' direct phase.
        range_offset_m: what is added to every pixel's range, (Y, X); None for nothing.
        through: what lets light through; None where nothing does.
        terms: the tail at the multiples of the fundamental that other terms of a response see; None for a sine.
    """

    settings: DiffuseSettings
    choice: DiffuseChoice
    variances: tuple[float, ...]
    coarse: CoarsePlanes
    upsampler: Upsampler
    separate: Bool
    separate_variance: float
    range_offset_m: Float | None = None
    through: SeenThrough | None = None
    terms: TermTails | None = None

    def block(self, pixels: slice, /) -> "DiffuseBlock":
        """Return the model for a stretch of the frame's pixels, flat indices row by row."""
        return DiffuseBlock(self, pixels)

    def tails_of_patches(self, pixels: Index, /) -> PixelTails:
        """Return the tail of pixels, flat indices: each has that of its patch.

        Raises:
            ValueError: the model was made for a sine.
        """
        if self.terms is None:
            raise ValueError("the model was made for a sine")
        row, column = self.upsampler.grid.patch_of(pixels)
        return PixelTails.of(self.terms.planes[:, row, column], self.terms.harmonics)

    def of_paths(self, pixels: Index, /) -> Bool:
        """Return which pixels, flat indices, lie in patches whose light is more than what the tail goes with, (n,)."""
        found = self.separate if self.through is None else self.separate | self.through.found
        return np.asarray(found[self.upsampler.grid.patch_of(pixels)])

    def range_m(self, phase_rad: Values, /) -> Values:
        """Return the range of a fundamental phase."""
        return range_from_phase(phase_rad, self.settings)

    def range_offset(self, pixels: slice, /) -> Float32 | float:
        """Return what is added to the ranges of a stretch of pixels, flat indices row by row, (n,)."""
        return 0.0 if self.range_offset_m is None else self.range_offset_m.ravel()[pixels].astype(np.float32)

    def is_separate(self, pixels: slice, /) -> Bool:
        """Return which of a stretch of pixels lie in patches with separate paths, (n,)."""
        return np.asarray(self.separate[self.upsampler.grid.patch_of(np.arange(pixels.start, pixels.stop))])


@dataclass(frozen=True, eq=False)
class DiffuseBlock:
    """A frame's model, and which stretch of its pixels it is to answer: flat indices row by row."""

    model: DiffuseModel
    pixels: slice


@dataclass(frozen=True, eq=False)
class DiffusePixels:
    """Answers for n pixels, float32 (n,) each, NaN where `answered` is not set; amplitudes in units of the phasors.

    `direct_phase_rad` lies in [0, 2π); the MPI light is its phasor at the fundamental, its phase within a turn behind.
    `chi_squared` is the pixel's data against what its patches expect; `separate_variance`, rad², what the room's tail adds to
    the phases of pixels that are left to separate paths.
    """

    separate_variance: float
    answered: Bool
    direct_amplitude: Float32
    direct_phase_rad: Float32
    direct_sigma_rad: Float32
    mpi_amplitude: Float32
    mpi_phase_rad: Float32
    mpi_sigma_rad: Float32
    chi_squared: Float32

    @property
    def direct(self) -> tuple[Float32, Float32, Float32]:
        """Amplitude, phase and standard deviation of the direct light."""
        return self.direct_amplitude, self.direct_phase_rad, self.direct_sigma_rad

    @property
    def mpi(self) -> tuple[Float32, Float32, Float32]:
        """Amplitude, phase and standard deviation of the MPI light."""
        return self.mpi_amplitude, self.mpi_phase_rad, self.mpi_sigma_rad

    def clear(self, pixels: Bool, /) -> None:
        """Take the answers of some pixels back."""
        for field in fields(self)[2:]:
            getattr(self, field.name)[pixels] = np.nan
