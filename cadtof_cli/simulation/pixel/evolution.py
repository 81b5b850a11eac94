"""What a pixel's recording looks like on paper: arrival histogram, voltages and phase, the paper's Fig. 2."""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.simulation.pixel.mix import PhotonMix
from cadtof_cli.simulation.pixel.pixel import PixelModel, trace_pixel

BINS = 128

MOST_ROWS = 1000
"""Rows of an evolution that are kept; a picture shows no more."""


@dataclass(frozen=True)
class Evolution:
    """One recording of the fundamental.

    Attributes:
        bin_ns: (BINS,), middle of each bin of the histogram.
        counts: (BINS,), photons in each.
        photons: (n,), photons sampled so far, evenly thinned.
        voltages_v: (2, n), SC1 and SC2 after that many photons.
    """

    bin_ns: Float
    counts: Float
    photons: Float
    voltages_v: Float
    period_ns: float

    @property
    def phase_deg(self) -> Float:
        """Phase of the voltages, 0° to 360°, (n,)."""
        return np.asarray(np.degrees(np.arctan2(self.voltages_v[1], self.voltages_v[0])) % 360.0)

    @property
    def settled_phase_deg(self) -> float:
        """Phase of the mean voltages over the later half, when the average has settled."""
        half = self.voltages_v.shape[1] // 2
        first, second = self.voltages_v[:, half:].mean(axis=1)
        return math.degrees(math.atan2(second, first)) % 360.0


def evolution(model: PixelModel, mix: PhotonMix, generator: np.random.Generator, /) -> Evolution:
    """Record the fundamental once, photon by photon, and keep what a picture needs."""
    times_ns, voltages_v = trace_pixel(model, mix, generator, harmonic=1)
    period = model.modulation.periods_ns[0]
    counts, _ = np.histogram(times_ns, bins=BINS, range=(0.0, period))
    middles = np.linspace(0.5, BINS - 0.5, BINS) * (period / BINS)
    count = voltages_v.shape[1]
    kept = np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(np.intp))
    return Evolution(middles, counts.astype(np.float64), (kept + 1).astype(np.float64), voltages_v[:, kept], period)
