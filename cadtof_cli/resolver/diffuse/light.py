"""The light of patches: the ratios of their phasors to the fundamental, which do not depend on the direct phase.

The module is also the front of the compiled twin `_light.h`, which looks at stored values and sums over patches.
"""

from functools import lru_cache

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Complex64, Float, Float32, Index, Stored, sealed
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.phasors.pooling import SharedNoise
from cadtof_cli.phasors.voltages import PhasorMap
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.elementary import phase_of
from cadtof_cli.resolver.diffuse.grid import PatchGrid
from cadtof_cli.resolver.diffuse.settings import DiffuseSettings
from cadtof_cli.resolver.kernels import chosen_kernel, contiguous, extension, is_compiled_for

LARGEST_AMPLITUDE = 1.5
"""Largest real or imaginary part of p_h of light and its noise. Phasors of light are 1 at most. A larger value is damage,
such as a pixel that always holds the same value, and would move the mean of its patch."""

TINY = 1e-30
"""Keeps patches without pixels from dividing by zero; their values are never used."""


@dataclass(frozen=True, eq=False)
class PatchLight:
    """The sampled pixels of every patch, (n, rows, columns) each, in single precision: its rounding is far below their noise.

    `seen` is false for a pixel that is not sound, or has no light above the noise; `phase_rad` is arg p1. `weighted`,
    (1 + 2·H, n, rows, columns), holds the weight |p1|² of each pixel; then the real and imaginary part of p1·|p1|; then, for
    each further harmonic, those of q_h = (p_h/|p1|)·(conj(p1)/|p1|)^h times the weight. All are 0 for a pixel that is not
    seen.
    """

    seen: Bool
    phase_rad: Float32
    weighted: Float32


@dataclass(frozen=True, eq=False)
class PatchMeans:
    """Means over some pixels of every patch.

    Attributes:
        ratios: q_h, (H − 1, rows, columns).
        amplitude: |p1|, root mean square, (rows, columns).
        pixels: number of pixels in the mean; pixels that share their noise count as one, (rows, columns).
        phase_rad: arg p1, (rows, columns).
        seen: share of the sampled pixels that are in the mean, whether or not they share their noise, (rows, columns).
    """

    ratios: Complex
    amplitude: Float
    pixels: Float
    phase_rad: Float
    seen: Float


@dataclass(frozen=True, eq=False)
class Look:
    """What the kernel needs for the first look at a frame, besides the stored values.

    Attributes:
        phasor_map: map from stored values to phasors.
        saturated: stored values at or beyond these are saturated, in the values' own type; NaN: none are.
        least_power: a pixel has no signal if the sum of |p_h|² over their variances is this or less. `min_confidence` does
            not count: surfaces that get no answer light the others all the same.
        noise: noise of the pixels.
        hot: pixels that get no answer, (n,); None: there are none.
    """

    phasor_map: PhasorMap
    saturated: tuple[float, float]
    least_power: float
    noise: NoiseModel
    hot: Bool | None = None


@dataclass(frozen=True, eq=False)
class FrameTraits:
    """What is known of a frame besides its light.

    Attributes:
        grid: its patches.
        settings: what is asked for.
        variances: noise variance of a channel of each harmonic, (H,), of a pixel as it is resolved.
        recorded_variances: the same of one recorded pixel. Most phasors may be means of several.
        shared: noise that pixels share because they are pooled.
        range_offset_m: what is added to the range of every pixel (field curvature), (Y, X); None for nothing.
        look: what the kernel needs for a first look at the frame; None if only numpy can look at it.
    """

    grid: PatchGrid
    settings: DiffuseSettings
    variances: Float
    recorded_variances: tuple[float, ...]
    shared: SharedNoise
    range_offset_m: Float | None = None
    look: Look | None = None


def is_light(phasors: Complex | Complex64, /) -> Bool:
    """Return which phasors (H, …) can be light: no part is too large for light, and p_1 is not 0."""
    sound = (np.abs(phasors.real) < LARGEST_AMPLITUDE) & (np.abs(phasors.imag) < LARGEST_AMPLITUDE)
    return np.asarray(sound.all(axis=0) & (phasors[0] != 0.0))


def sampled_light(phasors: Complex, usable: Bool, grid: PatchGrid, /, *, harmonics: tuple[int, ...]) -> PatchLight:
    """Return the light of the phasors (H, rows, columns) of a frame's `sampled_pixels`; pixels that are not `usable`
    are not seen.
    """
    with np.errstate(over="ignore"):
        # values that no camera stores become infinite, and are not seen
        taken = grid.by_patch(phasors.astype(np.complex64))
    return patch_light(taken, grid.by_patch(usable) & is_light(taken), harmonics=harmonics)


def patch_light(samples: Complex | Complex64, seen: Bool, /, *, harmonics: tuple[int, ...]) -> PatchLight:
    """Return the light of sampled phasors (H, n, rows, columns); a pixel that is not `seen` may hold anything.

    The computation uses real numbers, whose operations are each rounded alone: numpy's products of complex numbers
    differ from machine to machine.
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


def compiled_light(stored: Stored, look: Look, grid: PatchGrid, /) -> PatchLight:
    """Return the light of a frame's stored values (H, 2, n), with the same bits as numpy gives."""
    places, phasor_map, noise = sample_places(grid), look.phasor_map, look.noise
    weighted = np.empty((1 + 2 * len(stored), *places.shape), np.float32)
    phase_rad, seen = np.empty(places.shape, np.float32), np.empty(places.shape, np.bool_)
    extension().look_at_samples(
        chosen_kernel(),
        np.array([*look.saturated, look.least_power]),
        np.array(noise.harmonics, np.int64),
        np.array([1.0 / one.dark_variance for one in noise.each]),
        np.asarray(places, np.int64),
        *contiguous(stored, phasor_map.own, phasor_map.other, phasor_map.constant, look.hot, noise.samples),
        weighted,
        phase_rad,
        seen,
    )
    return PatchLight(seen, phase_rad, weighted)


@lru_cache(maxsize=4)
def sample_places(grid: PatchGrid, /) -> Index:
    """Return the flat indices of the samples of every patch, (n, rows, columns); −1 outside the frame."""
    size = (grid.height, grid.width)
    return sealed(np.ascontiguousarray(grid.samples(np.arange(1, 1 + grid.height * grid.width).reshape(size)) - 1))


def patch_means(light: PatchLight, among: Bool, frame: FrameTraits, /) -> PatchMeans:
    """Return the means over the pixels `among`, (n, rows, columns), with ratios that are corrected for the bias by noise.

    Let ε along p_1 and δ across it be the relative noise of p_1 = A. To second order, the real part of
    |p_1|·exp(−ih·arg p_1) is A·(1 + ε + δ²/2 − h²δ²/2), and the mean of |p_1|² is A²·(1 + ε² + δ²). So in the dark, q_h
    is too small by (h² + 3)/2 · σ²/A², which a fit would take for a tail. With light, noise is weaker: δ² by the factor
    1 − A, and ε² + δ² by the factor 1 − A².
    """
    counted, variance, harmonics = among & light.seen, float(frame.variances[0]), frame.settings.harmonics
    if not is_compiled_for(len(harmonics)):
        power, *parts = (light.weighted * counted).sum(axis=1, dtype=np.float64)
        pixels = counted.sum(axis=0).astype(np.float64)
    else:
        sums = np.empty((len(light.weighted) + 1, *counted.shape[1:]))
        extension().sum_patches(chosen_kernel(), *contiguous(light.weighted, counted), sums)
        power, *parts, pixels = sums
    ratios = np.empty((len(parts) // 2 - 1, *pixels.shape), np.complex128)
    ratios.real, ratios.imag = parts[2::2], parts[3::2]
    ratios /= np.maximum(power, TINY)
    amplitude = np.sqrt(power / np.maximum(pixels, 1.0))
    lit = np.maximum(amplitude**2 - 2.0 * variance, 0.5 * amplitude**2)
    relative, share = variance / np.maximum(lit, TINY), np.minimum(lit, 1.0)
    both, across = 2.0 * (1.0 - share) * relative, (1.0 - np.sqrt(share)) * relative
    for row, h in enumerate(harmonics[1:]):
        ratios[row] *= (1.0 + both) * (1.0 + 0.5 * (h * h - 1) * across)
    return PatchMeans(
        ratios, amplitude, pixels / frame.shared.pixels, np.arctan2(parts[1], parts[0]), pixels / len(counted)
    )


def patch_phasors(means: PatchMeans, /, *, harmonics: tuple[int, ...]) -> Complex:
    """Return the phasors p_h of patches, (H, rows, columns)."""
    ratios = np.concatenate([np.ones((1, *means.phase_rad.shape)), means.ratios])
    phasors: Complex = means.amplitude * ratios * np.exp(1j * np.array(harmonics)[:, None, None] * means.phase_rad)
    return phasors
