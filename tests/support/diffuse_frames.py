"""Frames with a known tail: geometry, tail → noisy phasors. Written from the physics, independently of the package."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

T1_NS = 40.0
OMEGA = 2 * np.pi / T1_NS
C_M_PER_NS = 0.299792458
M_PER_RAD = C_M_PER_NS * T1_NS / (4 * np.pi)

F = NDArray[np.float64]
Z = NDArray[np.complex128]


@dataclass(frozen=True)
class Tail:
    """Light that begins `start_ns` after the direct light, decays with `decay_ns`, and sums to `strength` times it."""

    strength: float = 0.3
    start_ns: float = 3.0
    decay_ns: float = 8.0

    def phasor(self, h: int) -> complex:
        """Return the tail's phasor at harmonic h, divided by that of the direct light."""
        turn = np.exp(1j * h * OMEGA * self.start_ns)
        return complex(self.strength * turn / (1 - 1j * h * OMEGA * self.decay_ns))


def slopes(height: int, width: int, focal_px: float) -> tuple[F, F]:
    """X = x/z and Y = y/z of every pixel of a centred pinhole."""
    y, x = np.mgrid[:height, :width].astype(float)
    return (x - (width - 1) / 2) / focal_px, (y - (height - 1) / 2) / focal_px


def wall_range(
    height: int = 48,
    width: int = 64,
    focal_px: float = 60.0,
    distance_m: float = 3.0,
    tilt: tuple[float, float] = (0, 0),
) -> F:
    """Range of a wall z·(1 + αX + βY) = D."""
    x, y = slopes(height, width, focal_px)
    return np.asarray(distance_m * np.sqrt(1 + x * x + y * y) / (1 + tilt[0] * x + tilt[1] * y))


def corner_range(height: int = 48, width: int = 64, focal_px: float = 60.0, distance_m: float = 3.0) -> F:
    """Range of two walls at right angles, their edge upright in the middle of the view."""
    x, y = slopes(height, width, focal_px)
    return np.asarray(distance_m * np.sqrt(1 + x * x + y * y) / (1 + np.abs(x)))


def phasors_of(
    range_m: F,
    mpi: dict[int, complex] | dict[int, Z] | None = None,
    *,
    amplitude: float | F = 0.25,
    harmonics: tuple[int, ...] = (1, 2),
    n_av: float = 1e5,
    seed: int = 0,
) -> Z:
    """Phasors (H, Y, X) of direct light from these ranges, times 1 + `mpi[h]`, with white noise of integration length n_av."""
    rng = np.random.default_rng(seed)
    phase = range_m / M_PER_RAD
    clean = np.stack([amplitude * np.exp(1j * h * phase) * (1 + (mpi[h] if mpi else 0)) for h in harmonics])
    return np.asarray(
        clean + np.sqrt(variance(n_av)) * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape))
    )


def variance(n_av: float) -> float:
    """Noise of one channel."""
    return 1 / (2 * (2 * n_av - 1))


def range_error_m(phase_rad: F | NDArray[np.float32], range_m: F) -> F:
    """Error of the range that a phase stands for, by the short way round the unambiguous range."""
    difference = phase_rad - range_m.ravel() / M_PER_RAD
    return np.asarray((difference - 2 * np.pi * np.rint(difference / (2 * np.pi))) * M_PER_RAD)


def hung_before(
    frame: Z, net: F, mpi: dict[int, complex], *, share: float, amplitude: float = 0.25
) -> tuple[Z, NDArray[np.bool_]]:
    """Return `frame` with a net at the ranges `net` before its middle, and the mask of the pixels behind the net.

    There, a `share` of the light comes from the net: direct light times 1 + `mpi[h]`. The rest is that of `frame`.
    """
    height, width = net.shape
    covered = np.zeros(net.shape, np.bool_)
    covered[height // 4 : -(height // 4), width // 3 : -(width // 3)] = True
    light = np.stack([amplitude * np.exp(1j * h * net / M_PER_RAD) * (1 + mpi[h]) for h in range(1, len(frame) + 1)])
    return np.where(covered, share * light + (1 - share) * frame, frame), covered
