"""One frame through the stages: voltages → phasors → paths → maps. Pure: arrays and records in, arrays and records out.

First, `prepare_frame` does all that couples the pixels of a frame; no other function does. Then `resolve_pixels`
resolves each pixel alone, block by block. If a frame is split over processes, it is prepared once, and any process can
resolve a part of it.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Float, Stored, even_step, median
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.maps.depth import clear_impossible, clear_pixels, write_block
from cadtof_cli.maps.layers import AVERAGED, DIRECT_DEPTH, DIRECT_SIGMA, IN_KERNEL
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.noise import NoiseModel, is_without_noise, with_repeated_rounding
from cadtof_cli.phasors.voltages import PhasorMap, phasors_from_stored
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.pipeline.stages import (
    SEARCHED_BLOCK_PIXELS,
    FramePixels,
    FrameStages,
    frame_stages,
    frame_traits,
    kernel_of_frame,
    kernel_of_frames,
    traits_of_frames,
)
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel, is_compiled_for
from cadtof_cli.resolver.settings import CLOSED_FORM
from cadtof_cli.resolver.status import StatusBit, has_answer

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.diffuse.choice import DiffuseChoice

BLOCK_PIXELS = 38400
"""Pixels per block, half a QVGA frame: enough that the cost of calling numpy hardly counts, and few enough that memory
stays small for frames of any size."""

TYPICAL_PIXELS = 256
"""At least how many pixels the typical light of a frame is measured with."""

FREEING_ROUNDS = 3
"""How many times the tail is predicted again, from phasors that the last prediction has freed of the other terms of a
response. Rooms do not change after the first time; a corner that fills the view still changes by a tenth after the
last."""


@dataclass(frozen=True)
class ResolvedFrame:
    """A frame's maps, its noise, and its model of MPI, if one was chosen."""

    maps: DepthMaps
    noise: NoiseModel
    mpi: "DiffuseChoice | None" = None


def resolve_frame(
    frame: Stored | FrameMean,
    /,
    *,
    plan: FramePlan,
    calibration: "Calibration | None" = None,
) -> ResolvedFrame:
    """Return the maps of one frame of stored values, (H, 2, Y, X), or of the mean of several.

    Args:
        frame: stored values, or their mean.
        plan: what to do with the frame.
        calibration: the calibration that the plan names.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type, or lacks the optics that it needs.
    """
    stages = stages_of(frame, plan, calibration)
    pixels = prepare_frame(frame, stages)
    return ResolvedFrame(resolve_pixels(pixels, stages), pixels.noise, pixels.choice)


def stages_of(frame: Stored | FrameMean, /, plan: FramePlan, calibration: "Calibration | None" = None) -> FrameStages:
    """Return the stages of a frame of stored values, (H, 2, Y, X), or of the mean of several.

    Raises:
        SettingsError: the frame does not fit the plan or the calibration.
    """
    height, width = (frame.stored if isinstance(frame, FrameMean) else frame).shape[2:]
    return frame_stages(plan, calibration, frame.dtype, (height, width))


def prepare_frame(frame: Stored | FrameMean, stages: FrameStages, /) -> FramePixels:
    """Do all that couples the pixels of a frame: estimate its noise if that is unknown, pool neighbours, predict
    diffuse MPI. The `stages` are those of the frame."""
    recorded, samples = (frame.stored, frame.samples) if isinstance(frame, FrameMean) else (frame, None)
    height, width = recorded.shape[2:]
    stored = recorded.reshape(*recorded.shape[:2], -1)
    samples = None if samples is None else samples.ravel()
    recordings = 1.0 if samples is None else float(median(samples))
    noise = stages.noise
    if noise is None:
        from cadtof_cli.pipeline.neighbours import estimated_noise

        noise = estimated_noise(recorded, samples, stages, dtype=frame.dtype, recordings=recordings)
    same, correction = is_without_noise(stored, noise), stages.correction
    if samples is not None:
        noise = with_repeated_rounding(noise, recordings)
    # an estimated noise already contains the noise of the calibration, which differs from pixel to pixel
    if correction.noise is not None and not noise.estimated:
        powers = _typical_powers(recorded, correction.phasor_map)
        noise = correction.noise.added_to(noise, powers=powers, frames=recordings)
    if samples is not None:
        noise = replace(noise, samples=samples)
    pixels = FramePixels(stored, frame.dtype, (height, width), 0, noise, without_noise=same)
    if stages.plan.settings.pool > 1:
        from cadtof_cli.pipeline.neighbours import pooled_pixels

        pixels = pooled_pixels(pixels, stages)
    if stages.plan.resolver.may_be_diffuse(noise.harmonics):
        pixels = _with_predicted_mpi(pixels, stages)
    return pixels


def resolve_pixels(pixels: FramePixels, stages: FrameStages, /) -> DepthMaps:
    """Return the maps, (Y, X), of a prepared frame's pixels, or those of a part of them, (1, n), resolved block by block.

    The answer of a pixel does not depend on the pixels that are resolved with it, so neither the size of the blocks nor
    the size of the part changes a bit of it.
    """
    size = pixels.size if pixels.count == math.prod(pixels.size) else (1, pixels.count)
    maps = DepthMaps.empty(tuple([layer.name for layer in stages.layers]), size)
    in_kernel = stages.solver_module == CLOSED_FORM and stages.layers[len(IN_KERNEL) :] in ((), (AVERAGED,))
    if chosen_kernel() != NUMPY and in_kernel and (pixels.tail is None or pixels.tail.nets is None):
        _fill_by_kernel(maps, pixels, stages)
    else:
        _fill_by_blocks(maps, pixels, stages)
        longest = stages.response.longest if stages.response else 1.0
        clear_impossible(maps, noise=pixels.noise, amplitude_v=stages.depth.amplitude_v, longest=longest)
    if stages.depth.lamp is not None:
        depth, sigma = (maps.layer(name).reshape(-1) for name in (DIRECT_DEPTH, DIRECT_SIGMA))
        sigma[:] = stages.depth.sigma_from_camera(sigma, depth, pixels.here)
        depth[:] = stages.depth.from_camera(depth, pixels.here)
    if pixels.without_noise:
        clear_pixels(maps, has_answer(maps.status.reshape(-1)))
    return maps


def _fill_by_blocks(maps: DepthMaps, pixels: FramePixels, stages: FrameStages) -> None:
    """Fill the maps of prepared pixels block by block, in numpy, with the compiled twins of single steps that the
    kernel has."""
    step = BLOCK_PIXELS if stages.solver_module == CLOSED_FORM else SEARCHED_BLOCK_PIXELS
    for start in range(0, pixels.count, step):
        here = slice(start, start + step)
        block = pixels[here]
        resolved = stages.resolved(block)
        if stages.plan.calibration is not None:
            np.bitwise_or(resolved.status, np.uint32(StatusBit.CALIBRATED), out=resolved.status)
        source = stages.depth.source(resolved, block.here, samples=block.noise.samples)
        write_block(maps, here, source, layers=stages.layers)


def _fill_by_kernel(maps: DepthMaps, pixels: FramePixels, stages: FrameStages) -> None:
    """Fill the maps of prepared pixels in one call of the compiled kernel, with the bits that `_fill_by_blocks` gives."""
    status, samples = maps.status.reshape(-1), pixels.noise.samples
    common = int(StatusBit.CALIBRATED) if stages.plan.calibration is not None else 0
    bits: int | None = common
    # the kernel itself finds saturated pixels, if it gets stored values
    if stages.correction.hot is not None or samples is not None:
        status[:] = stages.status(pixels, saturated=pixels.pooled is not None) | np.uint32(common)
        if samples is not None:
            status |= (samples > 1.0) * np.uint32(StatusBit.POOLED)
        bits = None
    own = pixels.tail is not None or samples is not None
    make = kernel_of_frame if own else kernel_of_frames
    source = pixels.stored if pixels.pooled is None else pixels.pooled
    values = maps.values.reshape(len(maps.names), -1)
    make(stages, pixels.first, status.size, pixels.noise, source.dtype, pixels.tail).fill(
        source, layers=values[: len(IN_KERNEL)], status=status, bits=bits
    )
    if len(values) > len(IN_KERNEL):
        values[len(IN_KERNEL) :] = 1.0 if samples is None else samples


def joined_parts(pixels: FramePixels, parts: Sequence[DepthMaps], /) -> ResolvedFrame:
    """Return the resolved frame whose parts, in their order, were resolved one by one; `pixels` is any part of the
    prepared frame."""
    pages = np.concatenate([part.pages for part in parts], axis=-1).reshape(-1, *pixels.size)
    status = np.concatenate([part.status for part in parts], axis=-1).reshape(pixels.size)
    return ResolvedFrame(DepthMaps(parts[0].names, pages, status), pixels.noise, pixels.choice)


def _typical_powers(recorded: Stored, phasor_map: PhasorMap) -> Float:
    """Return the median |p|² of each harmonic over a frame, (H, 2, Y, X) → (H,); pixels that are not finite do not count."""
    stored = recorded.reshape(*recorded.shape[:2], -1)
    typical = slice(None, None, even_step(stored.shape[2], recorded.shape[3], count=TYPICAL_PIXELS))
    phasors = phasors_from_stored(stored[:, :, typical], phasor_map[typical])
    finite = phasors[:, np.isfinite(phasors).all(axis=0)]
    with np.errstate(over="ignore"):
        return median(np.abs(finite) ** 2) if finite.size else np.zeros(len(finite))


def _with_predicted_mpi(pixels: FramePixels, stages: FrameStages) -> FramePixels:
    """Choose a frame's model of MPI; if it is diffuse, predict the tail from the frame's own geometry."""
    from cadtof_cli.resolver.diffuse.choice import patch_kinds
    from cadtof_cli.resolver.diffuse.grid import SHIFTS, patch_grid
    from cadtof_cli.resolver.diffuse.light import compiled_light, patch_means

    noise, choice = pixels.noise, None
    make = traits_of_frames if noise.samples is None else frame_traits
    traits = make(stages, noise, pixels.size, pixels.stored.dtype)
    usual = traits.grid
    for shift in SHIFTS if usual.stride > 1 else SHIFTS[:1]:
        if shift != usual.shift:
            traits = replace(traits, grid=patch_grid(*pixels.size, usual.view, shift))
        sampled = None
        if traits.look is not None and is_compiled_for(len(noise.harmonics)):
            light = compiled_light(pixels.stored, traits.look, traits.grid)
        else:
            # imported here because the compiled twin needs no solver
            from cadtof_cli.pipeline.samples import frame_samples

            sampled = frame_samples(pixels, stages, traits.grid)
            light = sampled.light()
        means = patch_means(light, light.seen, traits)
        kinds = patch_kinds(light, means, traits)
        if kinds.choice.reason != "few patches with light":
            choice = kinds.choice
            break
        choice = choice or kinds.choice
    assert choice is not None
    if choice.reason != "tail":
        return replace(pixels, choice=choice)
    # imported here because only frames with a tail need it
    from cadtof_cli.resolver.diffuse.predict import diffuse_model

    model = diffuse_model(light, means, kinds, traits)
    if sampled is not None and sampled.response is not None:
        for _ in range(FREEING_ROUNDS):
            if not isinstance(model, str):
                light = sampled.light(model)
                model = diffuse_model(light, patch_means(light, light.seen, traits), kinds, traits)
    if isinstance(model, str):
        return replace(pixels, choice=replace(choice, reason=model))
    return replace(pixels, choice=model.choice, tail=model)
