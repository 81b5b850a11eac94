"""What the neighbours of a frame's pixels tell of them: the noise where nothing else says it, and a mean of less noise."""

import math
from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Complex, Float, Stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError
from cadtof_cli.phasors.noise import NoiseModel, estimated_integration_length, most_integration, noise_model
from cadtof_cli.phasors.voltages import phasors_from_stored, saturated_pixels
from cadtof_cli.pipeline.pixels import FramePixels
from cadtof_cli.pipeline.stages import FrameStages

BLOCK_PIXELS = 32768
"""Pixels whose paths are searched for at a time, so that memory stays small however large the frames are."""


def estimated_noise(
    recorded: Stored,
    samples: Float | None,
    /,
    *,
    dtype: np.dtype[np.generic],
    metadata: CaptureMetadata,
    stages: FrameStages,
    kernel: str,
) -> NoiseModel:
    """Return the noise of one recording, by how the pixels of a frame, (H, 2, Y, X), scatter.

    Where pixels have phases of their own, these scatter, too. What they change is taken away as that of one path in each, and
    then, with the noise that this leaves, as that of the paths that are found.

    Args:
        recorded: stored values, or their mean over frames.
        samples: over how many frames each pixel is a mean, (Y·X,); None: over one.
        dtype: that the values were recorded in.
        metadata: of the capture.
        stages: of the frame.
        kernel: what resolves paths, of `available_kernels`.

    Raises:
        FrameError: too few of its pixels are finite.
    """
    stored, size = recorded.reshape(*recorded.shape[:2], -1), (recorded.shape[2], recorded.shape[3])
    phasors = phasors_from_stored(stored, stages.correction.phasor_map)
    phasors[:, saturated_pixels(stored, stages.saturated_counts)] = np.nan

    def noise_of(alike: Complex) -> NoiseModel:
        estimate = estimated_integration_length(alike.reshape(-1, *size))
        if math.isnan(estimate):
            raise FrameError(
                "the integration length is unknown and the noise cannot be estimated: too few pixels are finite and not "
                "saturated; set integration_length under [pixel] in capture.toml, or --integration-length"
            )
        if samples is not None:
            # 1/(2·n_av − 1) of one recording is so many times that of the mean
            estimate = 0.5 * (1.0 + (2.0 * estimate - 1.0) / float(np.median(samples)))
        length = min(estimate, most_integration(metadata, quantised=dtype.kind in "iu"))
        return noise_model(metadata, integration_length=length, quantised=False, estimated=True)

    response = stages.correction.response
    if response is None or response.phase_rad is None:
        return noise_of(phasors)
    from cadtof_cli.resolver.response.as_sine import single_path, without_own_phases

    first = noise_of(without_own_phases(phasors, single_path(phasors[0], response=response), response=response))
    noise = first if samples is None else replace(first, samples=samples)
    return noise_of(_without_own_phases(phasors, FramePixels(stored, dtype, size, 0, noise), stages, kernel))


def pooled_pixels(pixels: FramePixels, stages: FrameStages, /, *, window: int, kernel: str) -> FramePixels:
    """Return the pixels of a frame as means over neighbours with the same light, in a window of so many along each side."""
    phasors, samples = _without_own_phases(stages.phasors(pixels), pixels, stages, kernel), pixels.noise.samples
    from cadtof_cli.phasors.pooling import pooled_phasors

    pooled = pooled_phasors(
        phasors.reshape(-1, *pixels.size),
        usable=(np.isfinite(phasors).all(axis=0) & (stages.status(pixels) == 0)).reshape(pixels.size),
        samples=(np.ones(pixels.size) if samples is None else samples).reshape(pixels.size),
        noise=pixels.noise,
        window=window,
    )
    noise = replace(pixels.noise, samples=pooled.samples.ravel())
    return replace(pixels, noise=noise, pooled=pooled.phasors.reshape(len(phasors), -1))


def _without_own_phases(phasors: Complex, pixels: FramePixels, stages: FrameStages, kernel: str) -> Complex:
    """Return the phasors of a frame, (H, n), as pixels would have recorded them that add nothing to phases of their own.

    A sine's are so already. Of other responses, that follows from the paths of the pixels.
    """
    response = stages.correction.response
    if response is None or response.phase_rad is None:
        return phasors
    from cadtof_cli.resolver.resolve import resolve_paths
    from cadtof_cli.resolver.response.as_sine import without_own_phases

    alike = np.empty_like(phasors)
    for start in range(0, phasors.shape[1], BLOCK_PIXELS):
        here = slice(start, min(start + BLOCK_PIXELS, phasors.shape[1]))
        block, own, seen = pixels[here], response.block(here, kernel=kernel), phasors[:, here]
        status = stages.status(block)
        found = resolve_paths(seen, status=status, settings=stages.resolver, noise=block.noise, response=own)
        alike[:, here] = without_own_phases(seen, found.paths, response=own)
    return alike
