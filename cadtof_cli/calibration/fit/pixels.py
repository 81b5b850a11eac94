"""What flat targets say about each pixel: its own phase and gain, and the target's amplitude in it, for given terms."""

from dataclasses import dataclass, replace

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float


@dataclass(frozen=True, eq=False)
class Observations:
    """Mean voltages of flat targets, in n pixels.

    `volts` complex128 (N, H, n) and their standard deviation per channel `noise_v` (N, H); `phase` (N, n) of the fundamental,
    true.
    """

    volts: Complex
    noise_v: Float
    phase: Float
    harmonics: tuple[int, ...]

    def __getitem__(self, pixels: slice | Bool) -> "Observations":
        """Return what was observed in some of the pixels."""
        return replace(self, volts=self.volts[..., pixels], phase=self.phase[..., pixels])


Terms = tuple[dict[int, complex], ...]
"""For every harmonic, G[h,k]/G[h,1] by k, without k = 1, for paths whose phase is counted from the pixel's own."""


@dataclass(frozen=True, eq=False)
class PixelFit:
    """What is each pixel's own: phases (H, n) in rad, log gains (H, n), and what is left.

    `left` is log(measured) − log(modelled), complex (N, H, n); `weights` are the inverse variances of its parts.
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


def series(terms: dict[int, complex], theta: Float) -> Complex:
    """Return Σ_k G[k]/G[1]·exp(i(k−1)θ), with k = 1: the answer over that of the main term."""
    total = np.ones(theta.shape, np.complex128)
    for k, value in terms.items():
        total += value * np.exp(1j * (k - 1) * theta)
    return total


def fit_pixels(observed: Observations, terms: Terms, /) -> PixelFit:
    """Return every pixel's phase and gain, and every target's amplitude in it, for given terms.

    The phase is the weighted mean over targets; as it stands inside the series too, it is found in a few rounds.
    """
    weights = np.abs(observed.volts) ** 2 / observed.noise_v[:, :, np.newaxis] ** 2
    harmonics = np.array(observed.harmonics)[:, np.newaxis]
    pure = observed.volts * np.exp(-1j * harmonics * observed.phase[:, np.newaxis, :])
    phase = np.angle((pure / np.abs(pure) * weights).sum(axis=0))
    for _ in range(6):
        theta = harmonics * observed.phase[:, np.newaxis, :] + phase
        higher = np.stack([series(one, theta[:, row]) for row, one in enumerate(terms)], axis=1)
        flat = pure / higher
        phase = np.angle((flat / np.abs(flat) * weights).sum(axis=0))
    left = np.log(flat * np.exp(-1j * phase))
    log_gain, log_amplitude = two_way(left.real, weights)
    residual = left - log_gain - log_amplitude[:, np.newaxis, :]
    return PixelFit(phase, log_gain, residual, weights, theta)


def two_way(values: Float, weights: Float) -> tuple[Float, Float]:
    """Split (N, H, n) into one part per harmonic, (H, n), and one per target, (N, n), the first harmonic's part being 0.

    Exact for weights that are a product of one factor per target and one per harmonic, as |v|² over a fixed noise is.
    """
    by_target = weights.sum(axis=1)
    by_harmonic = np.median(weights / by_target[:, np.newaxis, :], axis=(0, 2))
    by_harmonic = by_harmonic / by_harmonic.sum()
    harmonic = (values * by_target[:, np.newaxis, :]).sum(axis=0) / by_target.sum(axis=0)
    mean = (harmonic * by_harmonic[:, np.newaxis]).sum(axis=0)
    target = (values * by_harmonic[:, np.newaxis]).sum(axis=1)
    return harmonic - harmonic[0], target - mean + harmonic[0]
