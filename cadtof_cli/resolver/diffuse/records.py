"""Records that the prediction returns: the model of a frame, and the answers of its pixels."""

from typing import Any

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, Index
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
from cadtof_cli.resolver.diffuse.coarse import CoarsePlanes
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.diffuse.upsampling import Upsampler


@dataclass(frozen=True, eq=False)
class Tails:
    """H_h of the nearer and of the farther of two paths, complex (H,) each, at the given harmonics."""

    near: Complex
    far: Complex
    harmonics: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Nets:
    """A surface that lets light through, such as a net.

    Attributes:
        found: patches that the surface covers, (rows, columns).
        near_m: range of the surface in these patches and in the patches around them; NaN elsewhere.
        tails: H_h of the light that the surface sends back, and H_h of the light from behind it.
        variance: variance of the phase of the direct light, rad², in addition to that of noise.
    """

    found: Bool
    near_m: Float
    tails: Tails
    variance: float


Parts = tuple[Any, Any]
"""Real part and imaginary part, float32 (n,) each. numpy's products of complex numbers differ from machine to machine."""


@dataclass(frozen=True, eq=False)
class PixelTails:
    """The tail of n pixels.

    `size` is ln|H_1| and `lag_rad` is arg H_1, (n,) each. `of_terms` gives H_m for every multiple m of the fundamental
    that other terms of the response see.
    """

    size: Float32
    lag_rad: Float32
    of_terms: dict[int, Parts]

    @classmethod
    def of(cls, planes: Float32, harmonics: tuple[int, ...], /) -> "PixelTails":
        """Return the tail from `planes`, (2 + 2·M, n), for the M multiples in `harmonics`.

        The planes are ln|H_1|, arg H_1, then the real parts of all H_m, then their imaginary parts.
        """
        size, lag, *parts = planes
        count = len(harmonics)
        return cls(size, lag, dict(zip(harmonics, zip(parts[:count], parts[count:], strict=True), strict=True)))


@dataclass(frozen=True, eq=False)
class TermTails:
    """The tail of patches at the multiples m of the fundamental that other terms of a response see; `harmonics` lists them.

    `planes`, float32 (2 + 2·M, rows, columns), are ln|H_1|, arg H_1, then the real parts of all H_m, then their
    imaginary parts. `upsampler` interpolates them at the pixels.
    """

    harmonics: tuple[int, ...]
    planes: Float32
    upsampler: Upsampler


@dataclass(frozen=True, eq=False)
class DiffuseModel:
    """The coarse model of a whole frame, from which each pixel is answered.

    Attributes:
        settings: what was asked for.
        choice: which model the frame got, and why.
        variances: noise variance of one channel of one recorded pixel, for each harmonic, in squared units of the phasors.
        coarse: planes over the patches, and what they mean.
        upsampler: interpolates these planes at the pixels.
        separate: patches with separate paths, (rows, columns). The solver of separate paths answers their pixels.
        separate_variance: variance in rad² that the room's tail adds to the direct phase of these pixels.
        range_offset_m: correction that is added to the range of every pixel, (Y, X); None if there is none.
        nets: the surface that lets light through; None if there is none.
        terms: the tail at the multiples of the fundamental that other terms of the response see; None for a sine.
    """

    settings: DiffuseSettings
    choice: DiffuseChoice
    variances: tuple[float, ...]
    coarse: CoarsePlanes
    upsampler: Upsampler
    separate: Bool
    separate_variance: float
    range_offset_m: Float | None = None
    nets: Nets | None = None
    terms: TermTails | None = None

    def tails_of_patches(self, pixels: Index, /) -> PixelTails:
        """Return the tail of pixels, given by flat indices; each pixel gets the tail of its patch. Not for a sine."""
        assert self.terms is not None
        row, column = self.upsampler.grid.patch_of(pixels)
        return PixelTails.of(self.terms.planes[:, row, column], self.terms.harmonics)

    def of_paths(self, pixels: Index, /) -> Bool:
        """Return which pixels, given by flat indices, have light that a tail alone does not explain, (n,).

        These are the pixels of patches with separate paths, or with a surface that lets light through.
        """
        found = self.separate if self.nets is None else self.separate | self.nets.found
        return np.asarray(found[self.upsampler.grid.patch_of(pixels)])

    def range_offset(self, pixels: slice, /) -> Float32 | float:
        """Return what is added to the ranges of consecutive pixels, flat indices row by row, (n,)."""
        return 0.0 if self.range_offset_m is None else self.range_offset_m.ravel()[pixels].astype(np.float32)

    def is_separate(self, pixels: slice, /) -> Bool:
        """Return which of consecutive pixels, flat indices row by row, lie in patches with separate paths, (n,)."""
        return np.asarray(self.separate[self.upsampler.grid.patch_of(np.arange(pixels.start, pixels.stop))])


@dataclass(frozen=True, eq=False)
class DiffusePixels:
    """Answers for n pixels, float32 (n,) each, NaN where `answered` is not set; amplitudes in units of the phasors.

    `direct_phase_rad` lies in [0, 2π). The MPI light is given by its phasor at the fundamental; its phase lies between
    the direct phase and a turn later. `chi_squared` is χ² of the pixel's data about the values that its patches expect.
    """

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
