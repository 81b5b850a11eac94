"""The answer of a channel pair to one path of delay t: the complex Fourier series g_h(t) = Σ_k G[h,k]·exp(i k ω_h t)."""

import itertools
import math
from functools import partial

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.records import dataclass
from cadtof_cli.units import FWHM_PER_SIGMA

NEGLIGIBLE_TERM = 1e-4
"""Terms of a triangle below this share of the fundamental are left out: 0.1 mm of depth at a period of 40 ns."""


@dataclass(frozen=True)
class HarmonicResponse:
    """The response of one harmonic's channel pair, in units of the modulation amplitude.

    `terms` are pairs (k, G[h,k]), k = 1 among them. A path of amplitude a and fundamental phase x gives the voltages
    a·Σ_k G[h,k]·exp(ikθ) with θ = h·x plus the pixel's own phase. k = 0 is an offset that is proportional to the
    laser's light; an offset that does not depend on the light belongs to the dark calibration.
    """

    harmonic: int
    terms: tuple[tuple[int, complex], ...]

    def __post_init__(self) -> None:
        terms = dict(self.terms)
        if len(terms) != len(self.terms):
            raise ValueError(f"harmonic {self.harmonic}: an order occurs twice in {[k for k, _ in self.terms]}")
        if not abs(terms.get(1, 0j)) > abs(terms.get(-1, 0j)):
            raise ValueError(f"harmonic {self.harmonic}: found G[k=1] = {self.main}, expected more than k = -1")

    @property
    def main(self) -> complex:
        """G[h,1]: gain and delay of the channel pair."""
        return dict(self.terms).get(1, 0j)

    @property
    def mirror(self) -> complex:
        """G[h,−1]: imbalance of SC1 and SC2, in gain or in phase."""
        return dict(self.terms).get(-1, 0j)

    @property
    def linear(self) -> bool:
        """Whether there are no terms but k = ±1: then one real matrix turns voltages into phasors."""
        return all(k in {1, -1} for k, _ in self.terms)

    def at(self, theta: Float, /) -> Complex:
        """Return g at phases θ in rad, complex128 of the same shape."""
        return np.asarray(sum(g * np.exp(1j * k * theta) for k, g in self.terms))

    def slope_at(self, theta: Float, /) -> Complex:
        """Return dg/dθ at phases θ in rad."""
        return np.asarray(sum(1j * k * g * np.exp(1j * k * theta) for k, g in self.terms))

    def without_mirror(self, voltages: Complex, /) -> Complex:
        """Solve v = G[h,1]·q + G[h,−1]·conj(q) for q: voltages without imbalance, and with G[h,1] = 1."""
        scale = abs(self.main) ** 2 - abs(self.mirror) ** 2
        return np.asarray((np.conj(self.main) * voltages - self.mirror * np.conj(voltages)) / scale)


def pulse_response(harmonic: int, /, *, fwhm_ns: float, period_ns: float) -> float:
    """Return r_k = exp(−(k·2π·s/T1)²/2), the factor by which a Gaussian pulse of standard deviation s shortens harmonic k.

    The paper's Eq. (3) has another exponent, and takes the factor as common to all harmonics. It is not: r1 = .994 and
    r2 = .975 at 1.7 ns. If phasors are not divided by it, one clean pulse looks like two paths at ±0.72 ns. `period_ns`
    is T1, `fwhm_ns` the full width of the pulse at half its maximum.
    """
    return math.exp(-0.5 * (harmonic * 2.0 * math.pi * fwhm_ns / FWHM_PER_SIGMA / period_ns) ** 2)


def ideal_response(metadata: CaptureMetadata, /) -> tuple[HarmonicResponse, ...]:
    """Return the response of every harmonic that follows from waveform and pulse, without any defect of the camera.

    Sine: k = 1 alone, r_h. Triangle: (8/π²)·(r_h, r_3h/9, r_5h/25, r_7h/49 …) at k = 1, −3, 5, −7 ….
    """
    modulation = metadata.modulation
    pulse = partial(pulse_response, fwhm_ns=metadata.pulse.fwhm_ns, period_ns=modulation.periods_ns[0])
    if modulation.waveform == "sine":
        return tuple(HarmonicResponse(h, ((1, complex(pulse(h))),)) for h in modulation.harmonics)
    responses = []
    for h in modulation.harmonics:
        terms = []
        for k in itertools.count(1, 2):
            share = pulse(k * h) / pulse(h) / k**2
            # 1/k² alone is negligible from k = 101 on
            if k > 5 and share < NEGLIGIBLE_TERM:
                break
            terms.append((k if k % 4 == 1 else -k, complex(8.0 / math.pi**2 / k**2 * pulse(k * h))))
        responses.append(HarmonicResponse(h, tuple(terms)))
    return tuple(responses)
