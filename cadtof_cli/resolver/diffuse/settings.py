"""Settings of the prediction, and the conversion of phases to metres."""

import math

import numpy as np

from cadtof_cli.arrays import Values
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.units import C_M_PER_NS, metres_per_radian

CHOSEN_NS = 40.0
"""Period of the fundamental, in ns, for which all constants of the prediction were chosen."""

NEAREST_M = 0.05
"""Smallest range of a pixel, in m. A phase of 0 would otherwise give the range 0, and the prediction divides by ranges."""


@dataclass(frozen=True, kw_only=True)
class DiffuseSettings:
    """Which model is asked for, and the harmonics from which the tail is predicted.

    Attributes:
        model: `discrete` leaves every pixel to the solver of separate paths. `diffuse` predicts a tail for every pixel.
            `auto` lets the data decide, first for every patch and then for the frame.
        period_ns: T1, period of the fundamental.
        harmonics: numbers h of the phasors; the first two must be 1 and 2.
        terms: for a response that is no pure sine: the multiples of the fundamental at which its other terms see the
            tail, in ascending order, each with the magnitude |c| of its term. None for a sine.
    """

    model: MpiModel = "auto"
    period_ns: float
    harmonics: tuple[int, ...]
    terms: tuple[tuple[int, float], ...] | None = None

    @property
    def rad_per_ns(self) -> float:
        """ω1: phase of the fundamental per ns of delay."""
        return 2.0 * math.pi / self.period_ns

    @property
    def slowness(self) -> float:
        """Period of the fundamental over `CHOSEN_NS`, but at least 1."""
        return max(self.period_ns / CHOSEN_NS, 1.0)

    @property
    def rad_per_m(self) -> float:
        """ω1/c: phase of the fundamental per metre that light travels one way, from surface to surface."""
        return self.rad_per_ns / C_M_PER_NS

    @property
    def m_per_rad(self) -> float:
        """Range per radian of the fundamental's phase, for light that goes out and back."""
        return metres_per_radian(self.period_ns)


def range_from_phase(phase_rad: Values, settings: DiffuseSettings, /) -> Values:
    """Return the range of a fundamental phase, in [0, c·T1/2)."""
    turns = phase_rad / (2.0 * np.pi)
    range_m: Values = (turns - np.floor(turns)) * (2.0 * np.pi) * settings.m_per_rad
    return range_m
