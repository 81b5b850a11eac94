"""The light of patches: their phasors' ratios to the fundamental, free of the direct phase."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Complex, Float, Float32
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.compiled_light import compiled_sums
from cadtof_cli.resolver.diffuse.elementary import phase_of
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.two_path.kernel import NUMPY

LARGEST_AMPLITUDE = 1e3
"""Largest |p_h| of light, whose phasors are 1 at most: what lies beyond is damage, and would drown a patch."""

TINY = 1e-30
"""Keeps empty patches from dividing by zero; they are never used."""


Complex64 = NDArray[np.complex64]


@dataclass(frozen=True, eq=False)
class PatchLight:
    """The sampled pixels of every patch, (n, rows, columns) each, in single precision, whose rounding is far below their noise.

    `seen` is false where a pixel has no answer; `phase_rad` is arg p1. `weighted`, (1 + 2·H, n, rows, columns), holds |p1|², by
    which pixels are weighted, and the real and imaginary parts of p1·|p1| and of q_h = (p_h/|p1|)·(conj(p1)/|p1|)^h times
    that weight: 0 where not seen.
    """

    seen: Bool
    phase_rad: Float32
    weighted: Float32


@dataclass(frozen=True, eq=False)
class PatchMeans:
    """Means over some pixels of every patch: q_h, (H − 1, rows, columns), amplitude |p1|, over how many pixels, and arg p1."""

    ratios: Complex
    amplitude: Float
    pixels: Float
    phase_rad: Float


def is_light(phasors: Complex | Complex64, /) -> Bool:
    """Return which phasors (H, …) can be those of light at all, and of some."""
    sound = (np.abs(phasors.real) < LARGEST_AMPLITUDE) & (np.abs(phasors.imag) < LARGEST_AMPLITUDE)
    return np.asarray(sound.all(axis=0) & (phasors[0] != 0.0))


def sampled_light(phasors: Complex, usable: Bool, grid: PatchGrid, /, *, harmonics: tuple[int, ...]) -> PatchLight:
    """Return the light of the phasors (H, rows, columns) of a frame's `sampled_pixels`, of which some are `usable`."""
    with np.errstate(over="ignore"):
        # what no camera stores becomes infinite, and is not seen
        taken = grid.by_patch(phasors.astype(np.complex64))
    return patch_light(taken, grid.by_patch(usable) & is_light(taken), harmonics=harmonics)


def patch_light(samples: Complex | Complex64, seen: Bool, /, *, harmonics: tuple[int, ...]) -> PatchLight:
    """Return the light of sampled phasors (H, n, rows, columns); those not `seen` may hold anything.

    In real numbers, whose every operation is rounded alone: numpy's products of complex ones differ from machine to machine.
    """
    p = np.where(seen, samples, np.complex64(0.0)).astype(np.complex64)
    re, im = p.real.copy(), p.imag.copy()
    weighted = np.empty((1 + 2 * len(p), *seen.shape), np.float32)
    power = np.add(re[0] * re[0], im[0] * im[0], out=weighted[0])
    magnitude = np.sqrt(power)
    inverse = 1.0 / np.maximum(magnitude, np.float32(TINY))
    back_re, back_im = re[0] * inverse, -im[0] * inverse
    weighted[1], weighted[2] = re[0] * magnitude, im[0] * magnitude
    turned_re, turned_im, done = re[0], -im[0], 1
    for row, h in enumerate(harmonics[1:], start=1):
        for _ in range(done, h):
            turned_re, turned_im = turned_re * back_re - turned_im * back_im, turned_re * back_im + turned_im * back_re
        done = h
        np.subtract(re[row] * turned_re, im[row] * turned_im, out=weighted[2 * row + 1])
        np.add(re[row] * turned_im, im[row] * turned_re, out=weighted[2 * row + 2])
    return PatchLight(seen, phase_of(re[0], im[0]), weighted)


def patch_means(light: PatchLight, among: Bool, /, *, kernel: str = NUMPY) -> PatchMeans:
    """Return the means over the pixels `among`, (n, rows, columns); `kernel` is of `available_kernels`."""
    counted = among & light.seen
    if kernel == NUMPY:
        sums = (light.weighted * counted).sum(axis=1, dtype=np.float64)
        pixels = counted.sum(axis=0).astype(np.float64)
    else:
        *sums, pixels = compiled_sums(light.weighted, counted, kernel=kernel)
    ratios = np.empty((len(sums) // 2 - 1, *pixels.shape), np.complex128)
    ratios.real, ratios.imag = sums[3::2], sums[4::2]
    ratios /= np.maximum(sums[0], TINY)
    return PatchMeans(ratios, np.sqrt(sums[0] / np.maximum(pixels, 1.0)), pixels, np.arctan2(sums[2], sums[1]))


def without_bias(means: PatchMeans, variance: float, /, *, harmonics: tuple[int, ...]) -> PatchMeans:
    """Return means whose ratios the noise of p_1, of that variance a channel where there is no light, does not make smaller.

    With noise ε along and δ across p_1 = A, |p_1|·exp(−ih·arg p_1) is A·(1 + ε + δ²/2 − h²δ²/2) in real part and to second order,
    and |p_1|² has the mean A² + ε² + δ²: in the dark, q_h is too small by (h² + 3)/2 · σ²/A², which a fit would take for a tail.
    Light makes δ² weaker by 1 − A, and ε² + δ² by 1 − A².
    """
    power = means.amplitude**2
    light = np.maximum(power - 2.0 * variance, 0.5 * power)
    relative = variance / np.maximum(light, TINY)
    share = np.minimum(light, 1.0)
    both, across = 2.0 * (1.0 - share) * relative, (1.0 - np.sqrt(share)) * relative
    ratios = np.empty_like(means.ratios)
    for row, h in enumerate(harmonics[1:]):
        ratios[row] = means.ratios[row] * ((1.0 + both) * (1.0 + 0.5 * (h * h - 1) * across))
    return replace(means, ratios=ratios)


def patch_phasors(means: PatchMeans, /, *, harmonics: tuple[int, ...]) -> Complex:
    """Return the phasors p_h of patches, (H, rows, columns)."""
    ratios = np.concatenate([np.ones((1, *means.phase_rad.shape)), means.ratios])
    phasors: Complex = means.amplitude * ratios * np.exp(1j * np.array(harmonics)[:, None, None] * means.phase_rad)
    return phasors
