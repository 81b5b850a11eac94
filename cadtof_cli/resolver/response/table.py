"""The response of the channel pairs as tables, so that its evaluation costs the same for any number of terms."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Float32, SomePixels, sealed
from cadtof_cli.phasors.response import NEGLIGIBLE_TERM, HarmonicResponse
from cadtof_cli.records import dataclass

ENTRIES = 1 << 14
"""Entries per turn. For a triangle, the error of linear interpolation is then less than 1e-7 of the amplitude."""

STAGES = (0.5, 0.7, 0.87, 1.0)
"""Shares of the higher terms on the way from a sine to the full response, for pixels that do not converge at once. The
stages are closer together towards the end, because there, paths that lie near each other move fastest."""

STEP = 2.0 * np.pi / ENTRIES
"""Phase between neighbouring entries of a table, rad."""

FARTHEST = np.float32(1e9)
"""Number of entries from phase 0 beyond which a phase takes the entry of 0: single precision does not know it to a turn."""


@dataclass(frozen=True, eq=False)
class Answer:
    """The answers f and their derivatives df/dx for a path in n pixels: real and imaginary parts, float32 (n,) each."""

    re: Float32
    im: Float32
    slope_re: Float32
    slope_im: Float32


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """f(h·x): the answer to a path of amplitude 1 and phase x, after the linear part of the response has been inverted.

    `planes` is float32 (4, ENTRIES): real and imaginary part of f and of df/dx at h·x = 0, 2π/ENTRIES, …. A sine with
    only gain and imbalance has f = exp(ihx). The rounding of single precision is 1/10,000 of the noise at n_av = 1e5.
    """

    harmonic: int
    planes: Float32

    @cached_property
    def entries(self) -> Float32:
        """The planes transposed, (ENTRIES, 4), so that the four values of a look-up lie together in memory."""
        return np.ascontiguousarray(self.planes.T)

    @cached_property
    def other_terms(self) -> dict[int, complex]:
        """The coefficients c_k of f(θ) = exp(iθ) + Σ_k c_k·exp(ikθ) by order k, without negligible ones."""
        # rounded, because the last bits of a Fourier transform differ between machines
        series = np.round(np.fft.fft(self.planes[0].astype(np.float64) + 1j * self.planes[1]) / ENTRIES, 6)
        orders = np.flatnonzero(np.abs(series) > NEGLIGIBLE_TERM)
        signed = np.where(orders < ENTRIES // 2, orders, orders - ENTRIES)
        return {int(k): complex(series[k]) for k in signed if k != 1}

    @cached_property
    def recorded_rotor(self) -> complex:
        """Rotor that gives the phasors of a triangle their recorded phases back, up to quarter turns.

        A delay φ of the channel pair turns its terms k by k·φ, and all of them are divided by that of k = 1.
        """
        return complex(np.exp(-0.25j * np.angle(self.other_terms.get(-3, 1.0))))

    @cached_property
    def phases(self) -> Float:
        """The unwrapped phase of f at every entry and after a full turn, float64 (ENTRIES + 1,)."""
        phases = np.angle(self.planes[0].astype(np.float64) + 1j * self.planes[1])
        return sealed(np.unwrap(np.append(phases, phases[0])))

    def at(self, theta: Float32, /) -> Answer:
        """Return the answer at phases θ = h·x of any size, in rad; NaN gives NaN."""
        place = theta * np.float32(1.0 / STEP)
        nearest = np.rint(place)
        place -= nearest
        place *= np.float32(STEP / self.harmonic)
        # what a conversion makes of NaN and of numbers beyond int32 depends on the processor
        index = np.where(np.abs(nearest) < FARTHEST, nearest, np.float32(0.0)).astype(np.int32)
        index &= ENTRIES - 1
        re, im, slope_re, slope_im = (plane.take(index) for plane in self.planes)
        re += place * slope_re
        im += place * slope_im
        return Answer(re, im, slope_re, slope_im)


@dataclass(frozen=True, eq=False)
class ResponseBlock:
    """A response for n pixels.

    `stages` are the tables of every stage, `phase_rad` is the own phase that each pixel adds, (H, n), or None, and
    `rotors` are its rotors.
    """

    stages: tuple[tuple[ResponseTable, ...], ...]
    phase_rad: Float32 | None
    rotors: Complex | None

    @cached_property
    def longest(self) -> float:
        """Largest modulus of the first phasor of a path of amplitude 1."""
        re, im, _, _ = self.stages[-1][0].planes
        return float(np.hypot(re, im).max())

    @cached_property
    def entries(self) -> Float32:
        """The entries of the tables of all harmonics, (H, ENTRIES, 4), as compiled code takes them."""
        return np.stack([table.entries for table in self.stages[-1]])

    @property
    def without_phases(self) -> "ResponseBlock":
        """The same response for pixels without own phases."""
        return ResponseBlock(self.stages, None, None)

    def block(self, pixels: SomePixels | Bool, /) -> "ResponseBlock":
        """Return the response for some of the pixels."""
        if self.phase_rad is None or self.rotors is None:
            return self
        return ResponseBlock(self.stages, self.phase_rad[:, pixels], self.rotors[:, pixels])

    def observed(self, phasors: Complex, /) -> tuple[tuple[Float32, Float32], ...]:
        """Return phasors, (H, n), as the pixels recorded them, before they were turned by the pixels' own phases.

        The result is re and im of each harmonic, (n,) each. The products are real, because numpy rounds complex
        products differently at the end of an array than within it.
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
        """Return phasors of one harmonic turned by the pixels' own phases, the inverse of `observed`: float64 (n,)."""
        if self.rotors is None:
            return re.astype(np.float64), im.astype(np.float64)
        rotor = self.rotors[row]
        return re * rotor.real + im * rotor.imag, im * rotor.real - re * rotor.imag

    def added_by(self, row: int, phase: Float32, /) -> tuple[Float, Float]:
        """Return what paths of amplitude 1 and fundamental phase x, (n,), add to one harmonic's phasors: re and im, float64."""
        f = self.at(row, phase)
        return self.turned_back(row, f.re, f.im)

    def at(self, row: int, phase: Float32, /, *, stage: int = -1) -> Answer:
        """Return the answer of one harmonic to paths with fundamental phase x, (n,)."""
        return self.stages[stage][row].at(self.theta(row, phase))

    def theta(self, row: int, phase: Float32, /) -> Float32:
        """Return θ = h·x plus the own phases of the pixels, for paths with fundamental phase x, (n,)."""
        theta = phase * np.float32(self.stages[0][row].harmonic)
        if self.phase_rad is not None:
            theta += self.phase_rad[row]
        return theta


def response_block(responses: Sequence[HarmonicResponse], phase_rad: Float | None, /) -> ResponseBlock:
    """Return the responses as tables, for all pixels of a frame; these add `phase_rad`, (H, n), to every path."""
    stages = tuple(tuple(_table(response, share) for response in responses) for share in STAGES)
    if phase_rad is None:
        return ResponseBlock(stages, None, None)
    return ResponseBlock(stages, phase_rad.astype(np.float32), np.exp(1j * phase_rad))


def _table(response: HarmonicResponse, share: float) -> ResponseTable:
    """Return the table of exp(iθ) + share·(f − exp(iθ)) and of its derivative by x."""
    theta = STEP * np.arange(ENTRIES, dtype=np.float64)
    sine = np.exp(1j * theta)
    value = sine + share * (response.without_mirror(response.at(theta)) - sine)
    slope = 1j * sine + share * (response.without_mirror(response.slope_at(theta)) - 1j * sine)
    slope = slope * response.harmonic
    return ResponseTable(
        response.harmonic, np.stack([value.real, value.imag, slope.real, slope.imag]).astype(np.float32)
    )
