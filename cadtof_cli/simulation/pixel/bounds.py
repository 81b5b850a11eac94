"""The least standard deviation that any unbiased estimate of path times can have: the Cramér–Rao bound."""

import math

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import Modulation
from cadtof_cli.simulation.pixel.mix import PhotonMix
from cadtof_cli.simulation.pixel.statistics import voltage_statistics
from cadtof_cli.simulation.pixel.waveforms import highest_order, phasor_series


def time_bounds_ns(mix: PhotonMix, modulation: Modulation, /, *, variance_gain: float) -> Float:
    """Return the bound of each path's time in ns, (P,), when amplitudes and times of all paths are unknown.

    Voltages are Gaussian with the exact covariance C of this mix, and J holds the derivatives of their means by
    amplitudes and times: the bound is the root of the diagonal of (Σ_h Jᵀ C⁻¹ J)⁻¹ (Kay, Estimation Theory, 1993,
    section 3.9, without what little the covariance itself tells). Infinite where paths coincide, NaN for paths
    without photons, which are no unknowns. The mix is without pixel axes, `variance_gain` Σ w_i² of the averaging.
    """
    covariances = voltage_statistics(mix, modulation, variance_gain=variance_gain).covariances_v2
    present = np.flatnonzero(mix.photons > 0)
    information = np.zeros((2 * len(present), 2 * len(present)))
    for harmonic, (first, both, second) in zip(modulation.harmonics, covariances, strict=True):
        slopes = modulation.amplitude_v * _slopes(mix, modulation, harmonic)[:, present].reshape(-1)
        jacobian = np.stack([slopes.real, slopes.imag])
        information += jacobian.T @ np.linalg.solve(np.array([[first, both], [both, second]]), jacobian)
    bounds = np.full(len(mix.photons), np.nan)
    bounds[present] = np.inf
    if np.linalg.cond(information) < 1e14:
        bounds[present] = np.sqrt(np.diag(np.linalg.inv(information))[len(present) :])
    return bounds


def _slopes(mix: PhotonMix, modulation: Modulation, harmonic: int) -> Complex:
    """Return the derivatives of the mean SC1 + i·SC2 by each path's share and by its time, (2, P), in units of A."""
    radians_per_ns = 2.0 * math.pi / mix.period_ns
    by_share = np.zeros(mix.photons.shape, dtype=np.complex128)
    by_time = np.zeros_like(by_share)
    largest = highest_order((harmonic,), modulation.waveform, mix.spread_rad) // harmonic
    for n, coefficient in phasor_series(modulation.waveform, largest):
        order = n * harmonic
        response = coefficient * math.exp(-((order * mix.spread_rad) ** 2) / 2.0)
        term = response * np.exp(1j * order * radians_per_ns * mix.delays_ns)
        by_share += term
        by_time += mix.shares() * 1j * order * radians_per_ns * term
    return np.stack([by_share, by_time])
