"""A forward model of the pixel: paths → noisy voltages. Written from docs/physics.md, independently of the package."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

T1_NS = 40.0
C_M_PER_NS = 0.299792458
AMPLITUDE_V = 0.2746


@dataclass(frozen=True)
class Light:
    """Photons of one pixel, laser : MPI : ambient = 1 : mpi : asr, with the delays of laser and MPI."""

    asr: float
    mpi: float = 0.0
    direct_ns: float = 5.0
    second_ns: float = 16.0
    fwhm_ns: float = 1.7

    def moment(self, k: int) -> complex:
        """E exp(i k 2π t/T1) over all photons."""
        s = self.fwhm_ns / 2.354820045
        r = np.exp(-((k * 2 * np.pi * s / T1_NS) ** 2) / 2)
        total = 1 + self.mpi + self.asr
        direct = np.exp(2j * np.pi * k * self.direct_ns / T1_NS)
        second = np.exp(2j * np.pi * k * self.second_ns / T1_NS)
        return complex(r * (direct + self.mpi * second) / total)

    def covariance(self, h: int, n_av: float) -> NDArray[np.float64]:
        """Covariance of (SC1, SC2) of harmonic h in units of the amplitude squared."""
        m, m2 = self.moment(h), self.moment(2 * h)
        c, s = m.real, m.imag
        return np.array(
            [[(1 + m2.real) / 2 - c * c, m2.imag / 2 - c * s], [m2.imag / 2 - c * s, (1 - m2.real) / 2 - s * s]]
        ) / (2 * n_av - 1)

    def voltages(self, rng: np.random.Generator, n_av: float, size: int) -> NDArray[np.float64]:
        """Noisy voltages in units of the amplitude, (H=2, C=2, size)."""
        drawn = [
            rng.multivariate_normal([self.moment(h).real, self.moment(h).imag], self.covariance(h, n_av), size=size).T
            for h in (1, 2)
        ]
        return np.stack(drawn)


def phasors_of(voltages: NDArray[np.float64], fwhm_ns: float = 1.7) -> NDArray[np.complex128]:
    """Pulse-corrected phasors (2, n) of voltages (2, 2, n) in units of the amplitude."""
    s = fwhm_ns / 2.354820045
    r = [np.exp(-((h * 2 * np.pi * s / T1_NS) ** 2) / 2) for h in (1, 2)]
    return np.stack([(v[0] + 1j * v[1]) / rh for v, rh in zip(voltages, r, strict=True)])


def ns_from_rad(phase_rad: NDArray[np.floating]) -> NDArray[np.float64]:
    """Delay of a fundamental phase."""
    return np.asarray(phase_rad, np.float64) * T1_NS / (2 * np.pi)


def depth_m(delay_ns: float) -> float:
    """Range of a delay."""
    return C_M_PER_NS * delay_ns / 2


def step_frame(
    rng: np.random.Generator, *, height: int = 24, width: int = 32, n_av: float = 1e5
) -> NDArray[np.float64]:
    """Voltages in V, (2, 2, Y, X): left half one path at 5 ns, right half 12 ns with MPI .3 at 20 ns; ASR 2."""
    left = Light(asr=2.0, direct_ns=5.0).voltages(rng, n_av, height * (width // 2))
    right = Light(asr=2.0, mpi=0.3, direct_ns=12.0, second_ns=20.0).voltages(rng, n_av, height * (width - width // 2))
    halves = [v.reshape(2, 2, height, -1) for v in (left, right)]
    return AMPLITUDE_V * np.concatenate(halves, axis=3)


def step_truth(height: int = 24, width: int = 32) -> NDArray[np.float64]:
    """Direct depth of `step_frame` in m, (Y, X)."""
    truth = np.full((height, width), depth_m(12.0))
    truth[:, : width // 2] = depth_m(5.0)
    return truth
