"""The response of the channel pairs as tables, so that evaluating it costs the same for any number of terms."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Complex, Float, Float32, SomePixels, sealed
from cadtof_cli.phasors.response import NEGLIGIBLE_TERM, HarmonicResponse
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import NUMPY

ENTRIES = 1 << 14
"""Entries per turn. Linear interpolation is then wrong by less than 1e-7 of the amplitude for a triangle."""

STAGES = (0.5, 0.7, 0.87, 1.0)
"""Shares of the higher terms on the way from a sine to the response, for pixels that do not converge at once: closer towards
the end, where paths that lie near each other move fastest."""

STEP = 2.0 * np.pi / ENTRIES
"""Phase from one entry of a table to the next, rad."""


@dataclass(frozen=True, eq=False)
class Answer:
    """f and df/dx of a path in n pixels, real and imaginary parts, float32 (n,) each."""

    re: Float32
    im: Float32
    slope_re: Float32
    slope_im: Float32


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """f(h·x), to which a path of amplitude 1 and phase x is mapped once the linear part of the response is inverted.

    `planes` is float32 (4, ENTRIES): real and imaginary part of f and of df/dx at h·x = 0, 2π/ENTRIES, …; a sine with
    nothing but gain and imbalance has f = exp(ihx). Single precision is 1/10,000 of the noise at n_av = 1e5.
    """

    harmonic: int
    planes: Float32

    @cached_property
    def entries(self) -> Float32:
        """The planes by entries, (ENTRIES, 4): what a look-up needs lies together."""
        return np.ascontiguousarray(self.planes.T)

    @cached_property
    def other_terms(self) -> dict[int, complex]:
        """c_k of f(θ) = exp(iθ) + Σ_k c_k·exp(ikθ) by order k, those that are not negligible."""
        # rounded: the last bits of a transform are not the same on every machine
        series = np.round(np.fft.fft(self.planes[0].astype(np.float64) + 1j * self.planes[1]) / ENTRIES, 6)
        orders = np.flatnonzero(np.abs(series) > NEGLIGIBLE_TERM)
        signed = np.where(orders < ENTRIES // 2, orders, orders - ENTRIES)
        return {int(k): complex(series[k]) for k in signed if k != 1}

    @cached_property
    def phases(self) -> Float:
        """The phase of f at every entry and after a turn, without jumps, float64 (ENTRIES + 1,)."""
        phases = np.angle(self.planes[0].astype(np.float64) + 1j * self.planes[1])
        return sealed(np.unwrap(np.append(phases, phases[0])))

    def at(self, theta: Float32, /) -> Answer:
        """Return the answer at phases θ = h·x of any size, in rad; NaN gives NaN."""
        place = theta * np.float32(1.0 / STEP)
        nearest = np.rint(place)
        place -= nearest
        place *= np.float32(STEP / self.harmonic)
        with np.errstate(invalid="ignore"):
            index = nearest.astype(np.int32)
        index &= ENTRIES - 1
        re, im, slope_re, slope_im = (plane.take(index) for plane in self.planes)
        re += place * slope_re
        im += place * slope_im
        return Answer(re, im, slope_re, slope_im)


@dataclass(frozen=True, eq=False)
class ResponseBlock:
    """A response for n pixels: tables at every stage, and what a pixel adds to phases, (H, n), or None.

    `kernel`, of `available_kernels`, is what searches for paths there.
    """

    stages: tuple[tuple[ResponseTable, ...], ...]
    phase_rad: Float32 | None
    rotors: Complex | None
    kernel: str = NUMPY

    @cached_property
    def longest(self) -> float:
        """Length of the longest first phasor that a path of amplitude 1 gives."""
        re, im, _, _ = self.stages[-1][0].planes
        return float(np.hypot(re, im).max())

    @property
    def without_phases(self) -> "ResponseBlock":
        """The response of pixels that add nothing to phases."""
        return ResponseBlock(self.stages, None, None, self.kernel)

    def block(self, pixels: SomePixels, /, *, kernel: str = NUMPY) -> "ResponseBlock":
        """Return the response for some of the pixels, and what is to search there."""
        if self.phase_rad is None or self.rotors is None:
            return replace(self, kernel=kernel)
        return ResponseBlock(self.stages, self.phase_rad[:, pixels], self.rotors[:, pixels], kernel)

    def observed(self, phasors: Complex, /) -> tuple[tuple[Float32, Float32], ...]:
        """Return phasors, (H, n), as the pixel saw them before they were turned by its own phase: re and im, (n,) each.

        In real numbers, as numpy's complex products round differently at the end of an array than within it.
        """
        if self.rotors is None:
            return tuple((plane.real.astype(np.float32), plane.imag.astype(np.float32)) for plane in phasors)
        return tuple(
            (
                (plane.real * rotor.real - plane.imag * rotor.imag).astype(np.float32),
                (plane.real * rotor.imag + plane.imag * rotor.real).astype(np.float32),
            )
            for plane, rotor in zip(phasors, self.rotors, strict=True)
        )

    def turned_back(self, row: int, re: Float32, im: Float32, /) -> tuple[Float, Float]:
        """Return what a pixel of one harmonic saw as `observed` phasors have it, turned by its own phase: float64 (n,)."""
        if self.rotors is None:
            return re.astype(np.float64), im.astype(np.float64)
        rotor = self.rotors[row]
        return re * rotor.real + im * rotor.imag, im * rotor.real - re * rotor.imag

    def at(self, row: int, phase: Float32, pixels: SomePixels, /, *, stage: int = -1) -> Answer:
        """Return the answer of one harmonic to paths of fundamental phase x in some of the pixels."""
        return self.stages[stage][row].at(self.theta(row, phase, pixels))

    def theta(self, row: int, phase: Float32, pixels: SomePixels, /) -> Float32:
        """Return the phases θ = h·x plus the pixels' own, of paths of fundamental phase x."""
        theta = phase * np.float32(self.stages[0][row].harmonic)
        if self.phase_rad is not None:
            theta += self.phase_rad[row][pixels]
        return theta


def response_block(responses: Sequence[HarmonicResponse], phase_rad: Float | None, /) -> ResponseBlock:
    """Return the responses, tabulated, for all pixels of a frame, which add `phase_rad`, (H, n), to every path."""
    stages = tuple(tuple(_table(response, share) for response in responses) for share in STAGES)
    if phase_rad is None:
        return ResponseBlock(stages, None, None)
    return ResponseBlock(stages, phase_rad.astype(np.float32), np.exp(1j * phase_rad))


def _table(response: HarmonicResponse, share: float) -> ResponseTable:
    """Return exp(iθ) + share·(f − exp(iθ)), and its derivative by x."""
    theta = STEP * np.arange(ENTRIES, dtype=np.float64)
    sine = np.exp(1j * theta)
    value = sine + share * (response.without_mirror(response.at(theta)) - sine)
    slope = 1j * sine + share * (response.without_mirror(response.slope_at(theta)) - 1j * sine)
    slope = slope * response.harmonic
    return ResponseTable(
        response.harmonic, np.stack([value.real, value.imag, slope.real, slope.imag]).astype(np.float32)
    )
