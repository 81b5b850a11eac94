"""K paths on N harmonics: phasors, noise and bound. Written from docs/physics.md, independently of the package."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel
from cadtof_cli.phasors.noise import NoiseModel, noise_model
from tests.support.forward import T1_NS

F = NDArray[np.float64]
C = NDArray[np.complex128]


@dataclass(frozen=True)
class Mixture:
    """Photons of one pixel: paths with their amplitudes and delays, and ambient light in the unit of the amplitudes."""

    amplitudes: tuple[float, ...]
    delays_ns: tuple[float, ...]
    asr: float = 5.0
    fwhm_ns: float = 1.7

    @property
    def shares(self) -> F:
        """Every path's share of all photons: its amplitude in units of the modulation amplitude."""
        return np.array(self.amplitudes) / (sum(self.amplitudes) + self.asr)

    @property
    def phases(self) -> F:
        """Phases of the fundamental, rad."""
        return 2 * np.pi * np.array(self.delays_ns) / T1_NS

    def pulse(self, k: int) -> float:
        """Return the factor by which the pulse reduces harmonic k."""
        s = self.fwhm_ns / 2.354820045
        return float(np.exp(-((k * 2 * np.pi * s / T1_NS) ** 2) / 2))

    def phasor(self, h: int) -> complex:
        """p_h, corrected for the pulse."""
        return complex(np.sum(self.shares * np.exp(1j * h * self.phases)))

    def covariance(self, h: int, n_av: float) -> F:
        """Covariance of Re p_h and Im p_h."""
        m, m2 = self.pulse(h) * self.phasor(h), self.pulse(2 * h) * self.phasor(2 * h)
        c, s = m.real, m.imag
        entries = [[(1 + m2.real) / 2 - c * c, m2.imag / 2 - c * s], [m2.imag / 2 - c * s, (1 - m2.real) / 2 - s * s]]
        return np.array(entries) / (2 * n_av - 1) / self.pulse(h) ** 2

    def phasors(self, harmonics: Sequence[int], *, n_av: float, size: int, rng: np.random.Generator) -> C:
        """Noisy phasors, (N, size)."""
        rows = []
        for h in harmonics:
            noise = rng.multivariate_normal([0, 0], self.covariance(h, n_av), size=size)
            rows.append(self.phasor(h) + noise[:, 0] + 1j * noise[:, 1])
        return np.array(rows)

    def exact(self, harmonics: Sequence[int], size: int = 1) -> C:
        """Phasors without noise, (N, size)."""
        return np.repeat(np.array([[self.phasor(h)] for h in harmonics]), size, axis=1)

    def bound_ns(self, harmonics: Sequence[int], n_av: float) -> F:
        """Cramér–Rao bound of the standard deviations of the delays."""
        paths = len(self.amplitudes)
        information = np.zeros((2 * paths, 2 * paths))
        for h in harmonics:
            along = np.exp(1j * h * self.phases)
            slopes = np.concatenate((along, 1j * h * self.shares * along))
            jacobian = np.stack((slopes.real, slopes.imag))
            information += jacobian.T @ np.linalg.inv(self.covariance(h, n_av)) @ jacobian
        spread: F = np.sqrt(np.diag(np.linalg.inv(information)))[paths:] * T1_NS / (2 * np.pi)
        return spread


def recorded(harmonics: Sequence[int], *, n_av: float) -> CaptureMetadata:
    """Metadata of a capture with these harmonics."""
    return CaptureMetadata(
        modulation=Modulation(periods_ns=tuple(T1_NS / h for h in harmonics)), pixel=Pixel(integration_length=n_av)
    )


def noise_of(harmonics: Sequence[int], *, n_av: float) -> NoiseModel:
    """Return the package's noise model for such a capture."""
    return noise_model(recorded(harmonics, n_av=n_av), integration_length=n_av, quantised=False)
