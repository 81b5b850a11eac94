"""Frames of boxes on a floor before a sky, of a camera without errors."""

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Pixel

AMPLITUDE_V, N_AV, SIZE = 0.2746, 1e5, (64, 80)
KNOWN = CaptureMetadata(pixel=Pixel(integration_length=N_AV))


def frame(
    *,
    n_av: float = N_AV,
    asr: float = 5.0,
    second: float = 1.0,
    third: float | None = None,
    mpi: float = 0.0,
    seed: int = 1,
    fwhm_ns: float = 1.7,
    size: tuple[int, int] = SIZE,
) -> NDArray[np.float64]:
    """Return volts, (H, 2, Y, X), of boxes and a floor at 1 to 5 m before a sky without light.

    `second` and `third` are factors on these harmonics, of which the latter may be missing; `mpi` is the amplitude of a
    path that is 6 ns later.
    """
    rng = np.random.default_rng(seed)
    row, column = np.indices(size) * np.divide(SIZE, size)[:, np.newaxis, np.newaxis]
    depth_m = np.where(row > 40, 180.0 / (row + 1e-9), 1.0 + column // 20 * 1.3)
    light = np.where(row < 12, 0.0, 1.0)
    phase, late = 2.0 * np.pi / 40.0 * 2.0 * depth_m / 0.299792458, 2.0 * np.pi / 40.0 * 6.0
    volts = []
    for h, factor in enumerate((1.0, second) if third is None else (1.0, second, third), start=1):
        pulse = np.exp(-((h * 2.0 * np.pi * fwhm_ns / 2.3548 / 40.0) ** 2) / 2.0)
        phasor = pulse * light * (np.exp(1j * h * phase) + mpi * np.exp(1j * h * (phase + late))) / (1.0 + mpi + asr)
        noise = rng.normal(0.0, 0.5 / np.sqrt(n_av), (2, *size))
        volts.append(factor * AMPLITUDE_V * (np.stack([phasor.real, phasor.imag]) + noise))
    return np.array(volts)
