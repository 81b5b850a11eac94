"""The light of patches: their phasors' ratios to the fundamental, free of the direct phase."""

from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float

LARGEST_AMPLITUDE = 1e3
"""Largest |p_h| of light, whose phasors are 1 at most: what lies beyond is damage, and would drown a patch."""

TINY = 1e-30
"""Keeps empty patches from dividing by zero; they are never used."""


@dataclass(frozen=True, eq=False)
class PatchLight:
    """The sampled pixels of every patch, (rows, columns, n) each.

    `seen` is false where a pixel has no answer; `first` is p1·|p1|, `phase_rad` arg p1; `power` = |p1|², by which pixels are
    weighted; and `ratios`, (H − 1, rows, columns, n), is q_h = (p_h/|p1|)·(conj(p1)/|p1|)^h times that weight.
    """

    seen: Bool
    first: Complex
    phase_rad: Float
    power: Float
    ratios: Complex


@dataclass(frozen=True, eq=False)
class PatchMeans:
    """Means over some pixels of every patch: q_h, (H − 1, rows, columns), the amplitude |p1|, and over how many pixels."""

    ratios: Complex
    amplitude: Float
    pixels: Float


def is_light(phasors: Complex, /) -> Bool:
    """Return which phasors (H, …) can be those of light at all, and of some."""
    sound = (np.abs(phasors.real) < LARGEST_AMPLITUDE) & (np.abs(phasors.imag) < LARGEST_AMPLITUDE)
    return np.asarray(sound.all(axis=0) & (phasors[0] != 0.0))


def patch_light(samples: Complex, seen: Bool, /, *, harmonics: tuple[int, ...]) -> PatchLight:
    """Return the light of sampled phasors (H, rows, columns, n); those not `seen` may hold anything."""
    p = np.where(seen, samples, 0.0)
    power = p[0].real ** 2 + p[0].imag ** 2
    magnitude = np.sqrt(power)
    back = np.conj(p[0]) / np.maximum(magnitude, TINY)
    turned, done, ratios = magnitude * back, 1, np.empty_like(p[1:])
    for ratio, p_h, h in zip(ratios, p[1:], harmonics[1:], strict=True):
        for _ in range(done, h):
            turned = turned * back
        done = h
        np.multiply(p_h, turned, out=ratio)
    return PatchLight(seen, magnitude * p[0], np.angle(p[0]), power, ratios)


def patch_means(light: PatchLight, among: Bool, /) -> PatchMeans:
    """Return the means over the pixels `among`, (rows, columns, n)."""
    counted = among & light.seen
    power = (light.power * counted).sum(-1)
    ratios = (light.ratios * counted).sum(-1) / np.maximum(power, TINY)
    pixels = counted.sum(-1).astype(np.float64)
    return PatchMeans(ratios, np.sqrt(power / np.maximum(pixels, 1.0)), pixels)


def patch_phasors(light: PatchLight, among: Bool, means: PatchMeans, /, *, harmonics: tuple[int, ...]) -> Complex:
    """Return the phasors p_h of patches, (H, rows, columns), whose `means` over the pixels `among` are known: arg p1 is added."""
    phase = np.angle((light.first * (among & light.seen)).sum(-1))
    ratios = np.concatenate([np.ones((1, *phase.shape)), means.ratios])
    phasors: Complex = means.amplitude * ratios * np.exp(1j * np.array(harmonics)[:, None, None] * phase)
    return phasors
