"""The uses of a pixel's neighbours: the noise is estimated from them if it is unknown, and pooling takes means over them."""

import math
from dataclasses import replace

import numpy as np

from cadtof_cli.arrays import Complex, Float, Stored
from cadtof_cli.errors import NoiseError
from cadtof_cli.phasors.noise import MOST_INTEGRATION, NoiseModel, estimated_integration_length, noise_model
from cadtof_cli.phasors.pooling import pooled_phasors
from cadtof_cli.phasors.voltages import phasors_from_stored, saturated_pixels
from cadtof_cli.pipeline.stages import SEARCHED_BLOCK_PIXELS, FramePixels, FrameStages


def estimated_noise(
    recorded: Stored, samples: Float | None, stages: FrameStages, /, *, dtype: np.dtype[np.generic], recordings: float
) -> NoiseModel:
    """Return the noise of one recording, estimated from the scatter of the pixels of a frame, (H, 2, Y, X).

    If pixels have phases of their own inside a response with further terms, these phases scatter too. Their effect is
    removed twice: first as if each pixel had one path, which gives a first noise; then with the paths that are found
    with that noise.

    Args:
        recorded: stored values, or their mean over frames.
        samples: number of frames that each pixel is a mean of, (Y·X,); None: one.
        stages: stages of the frame.
        dtype: type in which the values were recorded.
        recordings: the median of `samples`; 1 without them.

    Raises:
        NoiseError: too few neighbouring pixels of the frame are finite and not saturated.
    """
    stored, size = recorded.reshape(*recorded.shape[:2], -1), (recorded.shape[2], recorded.shape[3])
    metadata, quantised = stages.plan.metadata, dtype.kind in "iu"
    phasors = phasors_from_stored(stored, stages.correction.phasor_map)
    phasors[:, saturated_pixels(stored, metadata.voltage.saturated_counts)] = np.nan
    variances = None if samples is None else (recordings / samples).reshape(size)

    response = stages.correction.response

    def noise_of(alike: Complex) -> NoiseModel:
        if response is not None and metadata.modulation.waveform == "triangle":
            alike = alike * np.array([[table.recorded_rotor] for table in response.stages[-1]])
        estimate = estimated_integration_length(
            alike.reshape(-1, *size), metadata, quantised=quantised, samples=recordings, variances=variances
        )
        if math.isnan(estimate):
            raise NoiseError(
                "the integration length is unknown and the noise cannot be estimated: too few neighbouring pixels are finite "
                "and not saturated; set integration_length under [pixel] in capture.toml, or --integration-length"
            )
        length = min(estimate, MOST_INTEGRATION)
        return noise_model(metadata, integration_length=length, quantised=quantised, estimated=True)

    if response is None or response.phase_rad is None:
        return noise_of(phasors)
    from cadtof_cli.resolver.response.as_sine import single_path, without_own_phases

    first = noise_of(without_own_phases(phasors, single_path(phasors[0], response=response), response=response))
    noise = first if samples is None else replace(first, samples=samples)
    return noise_of(_without_own_phases(phasors, FramePixels(stored, dtype, size, 0, noise), stages))


def pooled_pixels(pixels: FramePixels, stages: FrameStages, /) -> FramePixels:
    """Return the pixels of a frame, pooled over neighbours with the same light."""
    phasors, samples = _without_own_phases(stages.phasors(pixels), pixels, stages), pixels.noise.samples
    pooled = pooled_phasors(
        phasors.reshape(-1, *pixels.size),
        usable=(np.isfinite(phasors).all(axis=0) & (stages.status(pixels) == 0)).reshape(pixels.size),
        samples=(np.ones(pixels.size) if samples is None else samples).reshape(pixels.size),
        noise=pixels.noise,
        window=stages.plan.settings.pool,
    )
    noise = replace(pixels.noise, samples=pooled.samples.ravel())
    return replace(pixels, noise=noise, pooled=pooled.phasors.reshape(len(phasors), -1))


def _without_own_phases(phasors: Complex, pixels: FramePixels, stages: FrameStages) -> Complex:
    """Return the phasors of a frame, (H, n), that pixels without phases of their own would have recorded.

    With a sine, the phasor map has removed these phases already. With other responses, the phasors follow from the
    pixels' paths.
    """
    response = stages.correction.response
    if response is None or response.phase_rad is None:
        return phasors
    from cadtof_cli.resolver.resolve import resolve_paths
    from cadtof_cli.resolver.response.as_sine import without_own_phases

    alike = np.empty_like(phasors)
    for start in range(0, pixels.count, SEARCHED_BLOCK_PIXELS):
        block = pixels[start : start + SEARCHED_BLOCK_PIXELS]
        own, seen = response.block(block.here), phasors[:, block.here]
        status = stages.status(block)
        found = resolve_paths(seen, status=status, settings=stages.plan.resolver, noise=block.noise, response=own)
        alike[:, block.here] = without_own_phases(seen, found.paths, response=own)
    return alike
