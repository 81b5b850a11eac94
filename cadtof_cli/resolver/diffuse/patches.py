"""The patches of a frame that have light: the surfaces that they show, their data, and the errors of these data."""

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.light import FrameTraits, PatchLight, PatchMeans, patch_means
from cadtof_cli.resolver.diffuse.model_error import model_error
from cadtof_cli.resolver.diffuse.noise import noise_covariance
from cadtof_cli.resolver.diffuse.planes import PatchPlanes, Surfaces, patch_planes
from cadtof_cli.resolver.diffuse.second_paths import two_path_lag
from cadtof_cli.resolver.diffuse.settings import NEAREST_M, range_from_phase

LEAST_RATIO = 0.05
"""Floor for |q_h| in the noise of a patch's data: the noise of ln|q_h| grows without limit as |q_h| goes to 0."""

NO_RATIO = 1e-9
"""Floor for |q_h| in the data: its logarithm must be finite, and below this it is of no interest."""


@dataclass(frozen=True, eq=False)
class LitPatches:
    """The n patches with light, and their data: ln|q_h|, then arg q_h.

    Attributes:
        valid: which patches they are, (rows, columns).
        means: over the pixels of each patch that lie on its surface.
        surfaces: of all patches, (rows, columns).
        seen: those of the patches with light, (n,).
        ratios: q_h, (H − 1, n).
        amplitude: at the fundamental, (n,).
        data: (data, n).
        noise: covariance of the data by noise, (data + 2, data + 2, n); it is 0 among the last two values.
        model_error: covariance of the model's values by what the model gets wrong, likewise.
    """

    valid: Bool
    means: PatchMeans
    surfaces: Surfaces
    seen: Surfaces
    ratios: Complex
    amplitude: Float
    data: Float
    noise: Float
    model_error: Float

    @classmethod
    def of(cls, light: PatchLight, planes: PatchPlanes, valid: Bool, frame: FrameTraits, /) -> "LitPatches":
        """Return the patches `valid`, (rows, columns), of a frame with this light and these planes."""
        means = patch_means(light, planes.on_plane, frame)
        ratios, amplitude = means.ratios[:, valid], means.amplitude[valid]
        data = np.concatenate([np.log(np.maximum(np.abs(ratios), NO_RATIO)), np.angle(ratios)])
        noise = _noise(ratios, amplitude, means.pixels[valid], frame)
        surfaces = planes.surfaces
        return cls(valid, means, surfaces, surfaces[valid], ratios, amplitude, data, noise, model_error(ratios))


def first_planes(
    light: PatchLight, means: PatchMeans, frame: FrameTraits, /, *, over_steps: bool = False
) -> PatchPlanes:
    """Return the surfaces from a first depth: that of two paths, from the mean light of every patch.

    `over_steps` as in `patch_planes`.
    """
    lag, offset = two_path_lag(means.ratios[0]), frame.range_offset_m
    range_m = range_from_phase(light.phase_rad - lag.astype(np.float32), frame.settings)
    if offset is not None:
        range_m += frame.grid.samples(offset).astype(np.float32)
    range_m = np.maximum(range_m, np.float32(NEAREST_M))
    return patch_planes(range_m, light.seen, frame.grid, over_steps=over_steps)


def _noise(ratios: Complex, amplitude: Float, pixels: Float, frame: FrameTraits) -> Float:
    """Return the covariance of the patches' data by noise, (data + 2, data + 2, n); it is 0 among the last two values."""
    strength = np.concatenate([np.ones((1, ratios.shape[1])), np.maximum(np.abs(ratios), LEAST_RATIO)]) * amplitude
    relative = frame.variances[:, None] / (strength**2 * pixels)
    count = 2 * len(ratios)
    covariance = np.zeros((count + 2, count + 2, amplitude.size))
    for (i, j), value in noise_covariance(list(relative), harmonics=frame.settings.harmonics).items():
        if i < count:
            covariance[i, j] = covariance[j, i] = value
    return covariance
