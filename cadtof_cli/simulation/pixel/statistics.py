"""Exact mean and covariance of a pixel's voltages for any photon mix, random voltages, and bounds on the times of paths.

A photon at time t samples both channels at once, and the exponentially weighted moving average of Eq. (1) adds up
independent samples with weights w_i. So the mean of the voltages is the mean of one sample, and their covariance is Σ w_i²
times the covariance of one sample. Σ w_i² is 1/(2 n_av − 1) once the average has settled. The moments m_k of the arrival times
give both mean and covariance.
"""

import math
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Complex, Float
from cadtof_cli.capture.metadata import Modulation, Waveform
from cadtof_cli.simulation.pixel.mix import AT_REST, Motion, PhotonMix
from cadtof_cli.simulation.pixel.waveforms import (
    highest_order,
    mean_square,
    phasor_series,
    product_series,
    square_series,
)

_NO_NOISE = 1e-6
"""Standard deviation, relative to the amplitude of the modulation, of voltages that have no noise.

Photons that all arrive at the same time give the same voltage. A bound needs some noise; this one is too small to see.
"""


@dataclass(frozen=True)
class VoltageStatistics:
    """Distribution of SC1 and SC2 at each harmonic. Harmonics are independent, because they are recorded one after the other.

    Attributes:
        means_v: (H, 2, *pixels), V.
        covariances_v2: (H, 3, *pixels), V²: variance of SC1, covariance, variance of SC2.
    """

    means_v: Float
    covariances_v2: Float

    @property
    def confidence_v(self) -> Float:
        """Magnitude of the mean voltages of the fundamental, (*pixels): A·r1/(1 + ASR) for one path and a sine."""
        return np.asarray(np.hypot(self.means_v[0, 0], self.means_v[0, 1]))

    @property
    def phase_precision_rad(self) -> Float:
        """Standard deviation of the first phasor's phase, to first order in the noise, (*pixels).

        It is the standard deviation of the voltages at right angles to their mean, divided by the magnitude of the mean. For
        one path, a sine and a short pulse it is √(ASR(1 + ASR)/(2(2 n_av − 1))).
        """
        c, s = self.means_v[0]
        first, both, second = self.covariances_v2[0]
        return np.asarray(np.sqrt(s * s * first - 2.0 * c * s * both + c * c * second) / (c * c + s * s))


def sample_mean(moments: Complex, /, *, harmonic: int, waveform: Waveform) -> Complex:
    """Return the mean of SC1 + i·SC2 over photons, in units of A; `moments`, (K + 1, *pixels), come from `PhotonMix.moments`.

    For a sine it is m_h, for a triangle (8/π²)(m_h + conj(m_3h)/9 + m_5h/25 + …); orders above K count as 0.
    """
    mean = np.zeros(moments.shape[1:], dtype=np.complex128)
    for n, coefficient in phasor_series(waveform, (len(moments) - 1) // harmonic):
        moment = moments[abs(n) * harmonic]
        mean += coefficient * (moment if n > 0 else np.conj(moment))
    return mean


def sample_covariance(moments: Complex, /, *, harmonic: int, waveform: Waveform) -> Float:
    """Return variance of SC1, covariance, and variance of SC2 over photons, (3, *pixels), in units of A².

    For a sine, with m_h = c + i·s: (1 + Re m_2h)/2 − c², Im m_2h/2 − c·s and (1 − Re m_2h)/2 − s².
    """
    mean = sample_mean(moments, harmonic=harmonic, waveform=waveform)
    c, s = mean.real, mean.imag
    covariance = np.stack([mean_square(waveform) - c * c, -c * s, mean_square(waveform) - s * s])
    largest = (len(moments) - 1) // harmonic
    for n, coefficient in square_series(waveform, largest):
        term = np.real(coefficient * moments[n * harmonic])
        covariance[0] += term
        covariance[2] += term if n % 4 == 0 else -term
    for n, coefficient in product_series(waveform, largest):
        covariance[1] += np.imag(coefficient * moments[n * harmonic])
    return covariance


def voltage_statistics(
    mix: PhotonMix,
    modulation: Modulation,
    /,
    *,
    variance_gain: float | Float,
    mean_gain: float = 1.0,
    sample_noise_v: float = 0.0,
    motion: Motion = AT_REST,
) -> VoltageStatistics:
    """Return the distribution of the averaged voltages of every pixel of a mix, which may move from harmonic to harmonic.

    `variance_gain` is Σ w_i² of the averaging, from `averaging_gain` or from the weights of a cascade; of all harmonics, or
    of each as an array that broadcasts with the covariances. `mean_gain` is Σ w_i; it
    is less than 1 until the average has settled. `sample_noise_v` is the standard deviation of the additional noise of every
    sample, such as kTC noise.
    """
    at_rest = mix.moments(highest_order(modulation.harmonics, modulation.waveform, mix.spread_rad))
    count, pixels = len(modulation.harmonics), at_rest.shape[1:]
    means, covariances = np.empty((count, 2, *pixels)), np.empty((count, 3, *pixels))
    for row, (harmonic, delay_ns) in enumerate(zip(modulation.harmonics, motion.delays_ns(count), strict=True)):
        moments = _later(at_rest, delay_ns / mix.period_ns)
        mean = sample_mean(moments, harmonic=harmonic, waveform=modulation.waveform)
        means[row] = modulation.amplitude_v * np.stack([mean.real, mean.imag])
        covariances[row] = modulation.amplitude_v**2 * sample_covariance(
            moments, harmonic=harmonic, waveform=modulation.waveform
        )
    covariances[:, 0::2] += sample_noise_v**2
    return VoltageStatistics(means * mean_gain, covariances * variance_gain)


def _later(moments: Complex, turns: float) -> Complex:
    """Return the moments of the same light when it comes later by a share `turns` of the period."""
    if turns == 0.0:
        return moments
    orders = np.arange(len(moments)).reshape(-1, *[1] * (moments.ndim - 1))
    later: Complex = moments * np.exp(2j * np.pi * turns * orders)
    return later


def draw_voltages(statistics: VoltageStatistics, generator: np.random.Generator, /, *, draws: int) -> Float:
    """Return independent voltages in V, (draws, H, 2, *pixels), with the given means and covariances."""
    variance, covariance, second = np.moveaxis(statistics.covariances_v2, 1, 0)
    first_scale = np.sqrt(np.maximum(variance, 0.0))
    slope = np.divide(covariance, first_scale, out=np.zeros_like(covariance), where=first_scale > 0)
    rest = np.sqrt(np.maximum(second - slope**2, 0.0))
    voltages = generator.standard_normal((draws, *statistics.means_v.shape))
    first, other = voltages[:, :, 0], voltages[:, :, 1]
    other *= rest
    other += slope * first
    first *= first_scale
    voltages += statistics.means_v
    return voltages


def time_bounds_ns(mix: PhotonMix, modulation: Modulation, recorded: VoltageStatistics, /) -> Float:
    """Return the Cramér–Rao bound on each path's time in ns, (P,), if amplitudes and times of all paths are unknown.

    The recorded voltages of the mix, which has no pixel axes, are Gaussian with the exact covariance C. J holds the
    derivatives of their means by amplitudes and times. The bound is the root of the diagonal of (Σ_h Jᵀ C⁻¹ J)⁻¹ (Kay,
    Estimation Theory, 1993, section 3.9, without the little information that the covariance itself has). It is infinite if
    paths coincide, and NaN for paths without photons, because these are not unknown.
    """
    present = np.flatnonzero(mix.photons > 0)
    information = np.zeros((2 * len(present), 2 * len(present)))
    for harmonic, (first, both, second) in zip(modulation.harmonics, recorded.covariances_v2, strict=True):
        slopes = modulation.amplitude_v * _slopes(mix, modulation, harmonic)[:, present].reshape(-1)
        variances, axes = np.linalg.eigh(np.array([[first, both], [both, second]]))
        along = axes.T @ np.stack([slopes.real, slopes.imag])
        least = (_NO_NOISE * modulation.amplitude_v) ** 2
        information += along.T @ (along / np.maximum(variances, least)[:, np.newaxis])
    bounds = np.full(len(mix.photons), np.nan)
    bounds[present] = np.inf
    # a weak path has little information, but this alone does not make the matrix singular
    scale = np.sqrt(np.diag(information))
    # a path so weak that its information rounds to 0 has none
    if scale.all() and np.linalg.cond(information / np.outer(scale, scale)) < 1e14:
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
