"""The response of the channel pairs as tables, so that evaluating it costs the same for any number of terms."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.phasors.response import HarmonicResponse

ENTRIES = 1 << 14
"""Entries a turn. Linear interpolation is then wrong by less than 1e-7 of the amplitude for a triangle."""

_STEP = 2.0 * np.pi / ENTRIES


@dataclass(frozen=True)
class ResponseTable:
    """f(θ), to which a path of amplitude 1 is mapped after the linear part of the response has been inverted, and df/dθ.

    Both complex128 (ENTRIES,), at θ = 0, 2π/ENTRIES, …; a sine with nothing but gain and imbalance has f = exp(iθ).
    """

    harmonic: int
    value: Complex
    slope: Complex

    def at(self, theta: Float, /) -> tuple[Complex, Complex]:
        """Return f and df/dθ at phases of any size, in rad."""
        place = theta * (1.0 / _STEP)
        nearest = np.rint(place)
        place -= nearest
        place *= _STEP
        with np.errstate(invalid="ignore"):
            index = nearest.astype(np.int64)
        index &= ENTRIES - 1
        slope = self.slope.take(index)
        return self.value.take(index) + place * slope, slope


@dataclass(frozen=True)
class ResponseModel:
    """Tables of all harmonics, and what each pixel adds to a path's phase at each, float64 (H, n) (None: nothing)."""

    tables: tuple[ResponseTable, ...]
    phase_rad: Float | None = None

    @cached_property
    def rotors(self) -> Complex | None:
        """exp(i·phase_rad), complex128 (H, n)."""
        return None if self.phase_rad is None else np.exp(1j * self.phase_rad)

    def block(self, pixels: slice, /) -> "ResponseBlock":
        """Return the model for some of the pixels."""
        if self.phase_rad is None or self.rotors is None:
            return ResponseBlock(self.tables, None, None)
        return ResponseBlock(self.tables, self.phase_rad[:, pixels], self.rotors[:, pixels])


@dataclass(frozen=True)
class ResponseBlock:
    """A response model for the n pixels of one block."""

    tables: tuple[ResponseTable, ...]
    phase_rad: Float | None
    rotors: Complex | None

    def observed(self, phasors: Complex, /) -> Complex:
        """Return phasors, (H, n), turned back to where the pixel saw them: Σ_paths a·f_h(h·x + pixel's phase)."""
        return phasors if self.rotors is None else phasors * self.rotors

    def at(self, row: int, phase: Float, chosen: slice | np.ndarray[tuple[int], np.dtype[np.intp]]) -> tuple[Complex, Complex]:
        """Return f and df/dx for paths of fundamental phase x in the chosen pixels, at the harmonic of that row."""
        table = self.tables[row]
        theta = phase * table.harmonic
        if self.phase_rad is not None:
            theta += self.phase_rad[row][chosen]
        value, slope = table.at(theta)
        return value, slope * table.harmonic


def response_tables(responses: Sequence[HarmonicResponse], /) -> tuple[ResponseTable, ...] | None:
    """Return the tables of the responses; None where they are linear, so that there is nothing left to refine."""
    if all(response.linear for response in responses):
        return None
    theta = np.arange(ENTRIES) * _STEP
    return tuple(
        ResponseTable(
            response.harmonic,
            response.without_mirror(response.at(theta)),
            response.without_mirror(response.slope_at(theta)),
        )
        for response in responses
    )
