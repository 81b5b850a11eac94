"""Flat targets → each pixel's own phase and gain, and the target's amplitude in each pixel, for given terms of the
response."""

from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float


@dataclass(frozen=True, eq=False)
class Observations:
    """Mean voltages of N flat targets, in n pixels.

    Attributes:
        volts: complex128 (N, H, n), in V.
        noise_v: standard deviation of each channel's mean, (N, H), in V.
        phase: true phase of the fundamental, (N, n), in rad.
        harmonics: their numbers h.
    """

    volts: Complex
    noise_v: Float
    phase: Float
    harmonics: tuple[int, ...]

    def __getitem__(self, pixels: slice | Bool) -> "Observations":
        """Return the observations of some of the pixels."""
        return replace(self, volts=self.volts[..., pixels], phase=self.phase[..., pixels])


ROUNDS = 6
"""Number of rounds in the fit of a pixel's phase: the phase stands inside the series too, so series and phase are
computed in turn. With a triangle, each round leaves a sixth of the error."""

Terms = tuple[dict[int, complex], ...]
"""For every harmonic, G[h,k]/G[h,1] by k, without k = 1. Phases in the series contain the pixel's own phase."""


@dataclass(frozen=True, eq=False)
class PixelFit:
    """The fitted phase and gain of each of n pixels, and the residuals at N targets.

    Attributes:
        phase: the pixel's own phase at each harmonic, (H, n), in rad.
        log_gain: logarithm of the gain, (H, n).
        left: the residuals log(measured) − log(modelled), complex (N, H, n).
        weights: inverse variances of the real and of the imaginary part of `left`, (N, H, n).
        theta: phases inside the series, h·x plus the pixel's own phase, (N, H, n), in rad.
    """

    phase: Float
    log_gain: Float
    left: Complex
    weights: Float
    theta: Float

    @property
    def misfit(self) -> Float:
        """χ² of each pixel, (n,)."""
        return np.asarray((self.weights * np.abs(self.left) ** 2).sum(axis=(0, 1)))


def series(terms: dict[int, complex], theta: Float, /) -> Complex:
    """Return Σ_k G[k]/G[1]·exp(i(k−1)θ), k = 1 included: the response divided by its main term."""
    total = np.ones(theta.shape, np.complex128)
    for k, value in terms.items():
        total += value * np.exp(1j * (k - 1) * theta)
    return total


def fit_pixels(observed: Observations, terms: Terms, /) -> PixelFit:
    """Fit every pixel's phase and gain, and every target's amplitude in the pixel, for given terms.

    The phase is the weighted mean over targets. It stands inside the series too, so it is found in `ROUNDS` rounds.
    """
    weights = np.abs(observed.volts) ** 2 / observed.noise_v[:, :, np.newaxis] ** 2
    harmonics = np.array(observed.harmonics)[:, np.newaxis]
    pure = observed.volts * np.exp(-1j * harmonics * observed.phase[:, np.newaxis, :])
    phase = np.angle((pure / np.abs(pure) * weights).sum(axis=0))
    for _ in range(ROUNDS):
        theta = harmonics * observed.phase[:, np.newaxis, :] + phase
        higher = np.stack([series(one, theta[:, row]) for row, one in enumerate(terms)], axis=1)
        flat = pure / higher
        phase = np.angle((flat / np.abs(flat) * weights).sum(axis=0))
    left = np.log(flat * np.exp(-1j * phase))
    log_gain, log_amplitude = two_way(left.real, weights)
    residual = left - log_gain - log_amplitude[:, np.newaxis, :]
    return PixelFit(phase, log_gain, residual, weights, theta)


def two_way(values: Float, weights: Float, /) -> tuple[Float, Float]:
    """Split values, (N, H, n), into a sum of one part per harmonic, (H, n), and one part per target, (N, n).

    The part of the first harmonic is 0. The split is the best fit if the weights are a product of one factor per target
    and one per harmonic, as |v|² over a fixed noise is.
    """
    by_target = weights.sum(axis=1)
    by_harmonic = np.median(weights / by_target[:, np.newaxis, :], axis=(0, 2))
    by_harmonic = by_harmonic / by_harmonic.sum()
    harmonic = (values * by_target[:, np.newaxis, :]).sum(axis=0) / by_target.sum(axis=0)
    mean = (harmonic * by_harmonic[:, np.newaxis]).sum(axis=0)
    target = (values * by_harmonic[:, np.newaxis]).sum(axis=1)
    return harmonic - harmonic[0], target - mean + harmonic[0]


def mean_rotor(phase: Float, /) -> Complex:
    """Return the mean phase of pixels, (…, n), as a rotor."""
    total = np.exp(1j * phase).sum(axis=-1)
    return np.asarray(total / np.abs(total))
