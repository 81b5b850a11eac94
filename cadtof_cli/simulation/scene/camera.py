"""The camera that looks at a scene: array, pinhole, field curvature, analogue-to-digital converter, fixed patterns."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Optics, Voltage
from cadtof_cli.errors import require
from cadtof_cli.optics import curvature_m, ray_slopes
from cadtof_cli.records import setting
from cadtof_cli.units import C_M_PER_NS

FOCAL_LENGTH_PER_WIDTH = 0.875
"""Focal length over the width of the array: a horizontal field of view of 59.5°, as of a QVGA array with 280 px focal length."""

_DARK_KEY, _DELAY_KEY = 1, 2
"""Branches of the seed for the fixed patterns of the array; frames draw from branch 0."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera; the default has a QVGA array and a 14-bit converter.

    Attributes:
        focal_length_px: of the pinhole; None keeps the default field of view.
        petzval_m: k2, k4 of the field curvature, which adds k2 ρ² + k4 ρ⁴ metres to the measured range; ρ is the
            distance from the principal point over half the diagonal.
        bits: resolution of the converter.
        volts_per_count, zero_counts: volts = (counts − zero_counts) · volts_per_count.
        dark_offset_v: standard deviation of the offsets; each pixel has its own offset per harmonic and channel.
        fixed_delay_ns: standard deviation of the delays; each pixel has its own delay, the fixed-pattern phase.
    """

    width: int = setting(320, "Columns of the frames.")
    height: int = setting(240, "Rows of the frames.")
    focal_length_px: float | None = None
    petzval_m: tuple[float, float] = setting((0.0, 0.0), "Field curvature k2,k4 of the lens.")
    bits: int = 14
    volts_per_count: float = 6.0e-5
    zero_counts: float = 8192.0
    dark_offset_v: float = setting(0.0, "Standard deviation of the offset from pixel to pixel.")
    fixed_delay_ns: float = setting(0.0, "Standard deviation of the delay from pixel to pixel.")

    def __post_init__(self) -> None:
        for name, pixels in (("width", self.width), ("height", self.height)):
            require(1 <= pixels <= 16384, name, f"{pixels} pixels", "1 to 16384 pixels")
        focal = self.focal_length_px
        require(focal is None or 1.0 <= focal < math.inf, "focal length", f"{focal} px", "1 px or more")
        require(
            all(abs(k) <= 1e9 for k in self.petzval_m), "Petzval curvature", self.petzval_m, "two numbers up to 1e9 m"
        )
        require(1 <= self.bits <= 16, "converter", f"{self.bits} bits", "1 to 16 bits")
        most, zero = 2**self.bits - 1, self.zero_counts
        require(0 <= zero <= most, "zero counts", zero, f"0 to {most}, the counts of a converter of {self.bits} bits")
        require(1e-12 <= self.volts_per_count < math.inf, "volts a count", self.volts_per_count, "a value above 0")
        require(0.0 <= self.dark_offset_v <= 1e6, "dark offsets", f"{self.dark_offset_v} V", "0 to 1e6 V")
        require(0.0 <= self.fixed_delay_ns <= 1e9, "fixed pattern", f"{self.fixed_delay_ns} ns", "0 to 1e9 ns")

    @property
    def optics(self) -> Optics:
        """The pinhole as `capture.toml` describes it."""
        focal = self.focal_length_px or FOCAL_LENGTH_PER_WIDTH * self.width
        return Optics(focal_length_px=focal, principal_point_px=((self.width - 1) / 2, (self.height - 1) / 2))

    @property
    def voltage(self) -> Voltage:
        """The converter as `capture.toml` describes it."""
        return Voltage(
            zero_counts=self.zero_counts,
            volts_per_count=self.volts_per_count,
            saturated_counts=(0.0, float(2**self.bits - 1)),
        )

    def rays(self, rows: slice) -> Float:
        """Return the directions in which the pixels of some rows look, (3, Y, X): x right, y down, z = 1 forward."""
        x, y = ray_slopes(self.optics, (self.height, self.width))
        return np.stack(np.broadcast_arrays(x, y[rows], 1.0))

    def curvature_delay_ns(self, rows: slice) -> Float:
        """Return the delay that field curvature adds to every path, (Y, X): 2(k2 ρ² + k4 ρ⁴)/c."""
        pixels = (self.height, self.width)
        added_m = curvature_m(pixels, self.optics.principal_point(pixels), self.petzval_m)
        return np.asarray(2.0 / C_M_PER_NS * added_m[rows])

    def fixed_delays_ns(self, seed: int) -> Float:
        """Return each pixel's own delay, (Y, X), the same in all frames of a seed."""
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_DELAY_KEY,)))
        return self.fixed_delay_ns * generator.standard_normal((self.height, self.width))

    def dark_offsets_v(self, seed: int, harmonics: int) -> Float:
        """Return each pixel's own offsets, (H, 2, Y, X), the same in all frames of a seed."""
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_DARK_KEY,)))
        return self.dark_offset_v * generator.standard_normal((harmonics, 2, self.height, self.width))

    def counts_from_voltages(self, voltages_v: Float, /) -> NDArray[np.uint16]:
        """Return the counts that the converter stores, uint16 of the same shape; voltages outside its range saturate."""
        counts = np.rint(voltages_v / self.volts_per_count + self.zero_counts)
        return np.clip(counts, 0, 2**self.bits - 1).astype(np.uint16)
