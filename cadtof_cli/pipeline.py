"""One frame through the stages: voltages → phasors → paths → maps. Pure: arrays and records in, arrays and records out.

First come the stages that couple the pixels of a frame, in `prepare_frame` and nowhere else; then `resolve_pixels` resolves each
pixel alone, block by block. A frame split over processes is prepared once, and its parts are resolved anywhere.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Complex, Status, Stored, sealed
from cadtof_cli.calibration.apply import FrameCorrection, frame_correction
from cadtof_cli.errors import FrameError
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.frame_pixels import EVERY, FramePixels, Where
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.last_call import same_as_last
from cadtof_cli.maps.depth import DepthScale, clear_impossible, clear_pixels, most_volts, write_block
from cadtof_cli.maps.layers import ALWAYS, Layer
from cadtof_cli.optics import LampBeside, planar_per_range
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.noise import NoiseModel, estimated_integration_length, noise_model
from cadtof_cli.phasors.plausible import is_without_noise
from cadtof_cli.phasors.voltages import phasors_from_stored, saturated_pixels
from cadtof_cli.predicted_mpi import Prediction, predicted_mpi
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit, has_answer
from cadtof_cli.resolver.two_path.kernel import NUMPY, FrameKernel, KernelScales, chosen_kernel
from cadtof_cli.units import metres_per_radian

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.diffuse.records import DiffuseChoice, DiffuseModel

BLOCK_PIXELS = 19200
"""Pixels a block, a quarter of a QVGA frame: enough that the cost of calling numpy hardly counts, and no more, so that memory
stays small however large the frames are."""

SEARCHED_BLOCK_PIXELS = 32768
"""Pixels a block where paths are searched or refined: the last steps are for a few, and cost the same for any block."""

MOST_INTEGRATION = 1e12
"""Integration length of a frame without any noise: that of float32 rounding, so that every threshold stays finite."""


@dataclass(frozen=True)
class ResolvedFrame:
    """A frame's maps, the integration length of its noise (`noise_estimated`: found), and its model of MPI, if one was chosen."""

    maps: DepthMaps
    integration_length: float
    noise_estimated: bool
    mpi: "DiffuseChoice | None" = None


@dataclass(frozen=True, eq=False)
class FrameStages:
    """What every block of frames of one plan, type and size shares.

    `noise` None: it is to be estimated from each frame; `prediction` None: its MPI is taken for separate paths.
    """

    saturated_counts: tuple[float, float] | None
    correction: FrameCorrection
    depth: DepthScale
    resolver: ResolverSettings
    room: str
    layers: tuple[Layer, ...]
    noise: NoiseModel | None
    prediction: Prediction | None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the layers."""
        return tuple(layer.name for layer in self.layers)

    def phasors(self, pixels: FramePixels, chosen: Where = EVERY) -> Complex:
        """Return the phasors of pixels or some of them, (H, n): pooled, or from what was stored."""
        if pixels.pooled is not None:
            return _some(pixels.pooled, chosen)
        return phasors_from_stored(_some(pixels.stored, chosen), self.correction.phasor_map[pixels.places(chosen)])

    def status(self, pixels: FramePixels, chosen: Where = EVERY, *, saturated: bool = True) -> Status:
        """Return the bits of pixels or some of them that get no answer whatever they hold, (n,): hot; saturated if asked for."""
        hot = self.correction.hot
        bits = np.uint32(0) if hot is None else hot[pixels.places(chosen)] * np.uint32(StatusBit.HOT_PIXEL)
        if saturated:
            beyond = saturated_pixels(_some(pixels.stored, chosen), self.saturated_counts)
            bits = bits | beyond * np.uint32(StatusBit.SATURATED)
        return np.asarray(bits, np.uint32)


def _some(planes: Stored, chosen: Where) -> Stored:
    """Return some pixels of planes, (…, n), each plane's as neighbours."""
    return planes[..., chosen] if isinstance(chosen, slice) else planes.take(chosen, axis=-1)


@same_as_last
@lru_cache(maxsize=4)
def frame_stages(
    plan: FramePlan, calibration: "Calibration | None", dtype: np.dtype[np.generic], size: tuple[int, int]
) -> FrameStages:
    """Return what every block of frames of one plan, type and size shares; raises SettingsError where they do not fit."""
    if (plan.calibration is None) != (calibration is None):
        raise ValueError("a plan with a calibration needs it loaded, and one without has no use for it")
    metadata = plan.metadata
    correction = frame_correction(calibration, metadata, dtype, size)
    depth = DepthScale(
        metres_per_radian(metadata.modulation.periods_ns[0]),
        metadata.modulation.amplitude_v,
        planar_per_range(metadata.optics, size).ravel() if plan.settings.depth == "z" else None,
        correction.range_offset_m if plan.calibration and plan.calibration.curved else None,
        LampBeside.of(metadata.optics, size),
    )
    resolver, n_av, noise = plan.resolver, metadata.pixel.integration_length, None
    room = resolver.room(metadata.modulation.harmonics, sine=correction.response is None)
    if n_av is not None:
        noise = noise_model(metadata, integration_length=n_av, quantised=dtype.kind in "iu")
    saturated = metadata.voltage.saturated_counts
    may_be_diffuse = resolver.may_be_diffuse(metadata.modulation.harmonics)
    prediction = Prediction.of(metadata, size, resolver.mpi_model) if may_be_diffuse else None
    return sealed(FrameStages(saturated, correction, depth, resolver, room, plan.layers, noise, prediction))


def resolve_frame(
    frame: Stored | FrameMean,
    /,
    *,
    plan: FramePlan,
    calibration: "Calibration | None" = None,
    kernel: str | None = None,
) -> ResolvedFrame:
    """Return the maps of one frame of stored values, (H, 2, Y, X), or of the mean of several.

    Args:
        frame: stored values, or their mean.
        plan: what to do with it.
        calibration: the one that the plan names.
        kernel: what resolves two paths of a sine, of `available_kernels`, all of which give the same bits; None: the chosen.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type, or lacks the optics that it needs.
    """
    pixels = prepare_frame(frame, plan=plan, calibration=calibration, kernel=kernel)
    return joined_parts(pixels, [resolve_pixels(pixels, plan=plan, calibration=calibration, kernel=kernel)])


def prepare_frame(
    frame: Stored | FrameMean,
    /,
    *,
    plan: FramePlan,
    calibration: "Calibration | None" = None,
    kernel: str | None = None,
) -> FramePixels:
    """Do all that couples the pixels of a frame: estimate its noise where it is unknown, pool neighbours, predict its MPI."""
    recorded, samples = (frame.stored, frame.samples) if isinstance(frame, FrameMean) else (frame, None)
    height, width = recorded.shape[2:]
    stages = frame_stages(plan, calibration, frame.dtype, (height, width))
    stored = recorded.reshape(*recorded.shape[:2], -1)
    samples = None if samples is None else samples.ravel()
    noise = stages.noise
    if noise is None:
        unknown = NoiseModel((), math.nan, estimated=True, samples=samples)
        noise = _estimated_noise(FramePixels(stored, frame.dtype, (height, width), 0, unknown), plan, stages)
    noise = noise if samples is None else replace(noise, samples=samples)
    same = is_without_noise(stored, noise)
    pixels = FramePixels(stored, frame.dtype, (height, width), 0, noise, without_noise=same)
    if plan.settings.pool > 1:
        pixels = _pooled(pixels, stages, window=plan.settings.pool)
    if stages.prediction is not None:
        choice, tail = predicted_mpi(pixels, stages, stages.prediction, kernel or chosen_kernel())
        pixels = replace(pixels, choice=choice, tail=tail)
    return pixels


def resolve_pixels(
    pixels: FramePixels, /, *, plan: FramePlan, calibration: "Calibration | None" = None, kernel: str | None = None
) -> DepthMaps:
    """Return the maps, (1, n), of a prepared frame's pixels, or of a part of them, resolved block by block.

    What a pixel gets does not depend on which others are resolved with it, so neither the size of the blocks nor that of the
    part changes a bit of the answer.
    """
    stages = frame_stages(plan, calibration, pixels.dtype, pixels.size)
    kernel = kernel or chosen_kernel()
    maps = DepthMaps.empty(stages.names, (1, pixels.stored.shape[2]))
    in_kernel = stages.room == "two_path" and stages.resolver.paths <= 2
    if kernel != NUMPY and in_kernel and (pixels.tail is None or pixels.tail.through is None):
        _fill_by_kernel(maps, pixels, plan, stages, kernel)
    else:
        _fill_by_blocks(maps, pixels, plan, stages, kernel, calibrated=calibration is not None)
        clear_impossible(maps, noise=pixels.noise, amplitude_v=plan.metadata.modulation.amplitude_v)
    if stages.depth.lamp is not None:
        stages.depth.measure_from_camera(maps, pixels.first)
    if pixels.without_noise:
        clear_pixels(maps, has_answer(maps.status.reshape(-1)))
    return maps


def _fill_by_blocks(
    maps: DepthMaps, pixels: FramePixels, plan: FramePlan, stages: FrameStages, kernel: str, *, calibrated: bool
) -> None:
    """Fill the maps of prepared pixels block by block, in numpy but for what `kernel` has of them."""
    from cadtof_cli.resolver.resolve import resolve_paths

    response, tail = stages.correction.response, pixels.tail
    step = plan.block_pixels or (BLOCK_PIXELS if stages.room == "two_path" else SEARCHED_BLOCK_PIXELS)
    count = pixels.stored.shape[2]
    for start in range(0, count, step):
        here = slice(start, min(start + step, count))
        block, there = pixels[here], slice(pixels.first + here.start, pixels.first + here.stop)
        resolved = resolve_paths(
            stages.phasors(block),
            status=stages.status(block),
            settings=stages.resolver,
            noise=block.noise,
            response=response.block(there, kernel=kernel) if response else None,
            first=block.first,
            tail=tail.block(there) if tail else None,
            kernel=kernel,
        )
        if calibrated:
            np.bitwise_or(resolved.status, np.uint32(StatusBit.CALIBRATED), out=resolved.status)
        source = stages.depth.source(resolved, there, samples=block.noise.samples)
        write_block(maps, here, source, layers=stages.layers)


def _fill_by_kernel(maps: DepthMaps, pixels: FramePixels, plan: FramePlan, stages: FrameStages, kernel: str) -> None:
    """Fill the maps of prepared pixels from their stored values in one go: what the blocks of `resolve_pixels` do in numpy."""
    status, samples = maps.status.reshape(-1), pixels.noise.samples
    common = int(StatusBit.CALIBRATED) if plan.calibration is not None else 0
    bits: int | None = common
    # what was recorded, the kernel looks at itself
    if stages.correction.hot is not None or samples is not None:
        status[:] = stages.status(pixels, saturated=pixels.pooled is not None) | np.uint32(common)
        if samples is not None:
            status |= (samples > 1.0) * np.uint32(StatusBit.POOLED)
        bits = None
    own = pixels.tail is not None or samples is not None
    make = _kernel_of_frame if own else _kernel_of_frames
    values = maps.values.reshape(len(maps.names), -1)
    source = pixels.stored if pixels.pooled is None else pixels.pooled
    make(plan, stages, pixels.first, status.size, pixels.noise, source.dtype, pixels.tail, kernel).fill(
        source, layers=values[: len(ALWAYS)], status=status, bits=bits
    )
    if len(values) > len(ALWAYS):
        values[len(ALWAYS) :] = 1.0 if samples is None else samples


def _kernel_of_frame(
    plan: FramePlan,
    stages: FrameStages,
    first: int,
    count: int,
    noise: NoiseModel,
    source_type: np.dtype[np.generic],
    model: "DiffuseModel | None",
    kernel: str,
) -> FrameKernel:
    """Return what resolves `count` pixels of a frame from a flat index on, from what was recorded or from complex phasors."""
    block = slice(first, first + count)
    most, more = most_volts(noise, plan.metadata.modulation.amplitude_v)
    tail = None
    if model is not None:
        from cadtof_cli.resolver.diffuse.compiled import tail_buffers

        tail = tail_buffers(model.block(block))
    scales = KernelScales(
        phasor_map=stages.correction.phasor_map[block] if source_type.kind != "c" else None,
        saturated_counts=stages.saturated_counts,
        metres=stages.depth.metres(block),
        volts=stages.depth.amplitude_v,
        phase_offset_rad=stages.depth.phase_offset_rad(block),
        tail=tail,
        most_volts=most,
        noise_volts=more,
    )
    return FrameKernel(
        scales, settings=stages.resolver, noise=noise, count=count, source_type=source_type, kernel=kernel
    )


_kernel_of_frames = same_as_last(_kernel_of_frame)
"""The same, where frames share it: nothing in it is a frame's own."""


def joined_parts(pixels: FramePixels, parts: Sequence[DepthMaps], /) -> ResolvedFrame:
    """Return the resolved frame that the parts of a prepared frame make up, in their order."""
    pages, status, image = parts[0].pages, parts[0].status, parts[0].image
    if len(parts) > 1:
        pages = np.concatenate([part.pages for part in parts], axis=-1)
        status = np.concatenate([part.status for part in parts], axis=-1)
        image = None
    maps = DepthMaps(parts[0].names, pages.reshape(-1, *pixels.size), status.reshape(pixels.size), image)
    return ResolvedFrame(maps, pixels.noise.integration_length, pixels.noise.estimated, pixels.choice)


def _estimated_noise(pixels: FramePixels, plan: FramePlan, stages: FrameStages) -> NoiseModel:
    phasors = stages.phasors(pixels)
    phasors[:, saturated_pixels(pixels.stored, stages.saturated_counts)] = np.nan
    estimate = estimated_integration_length(phasors.reshape(-1, *pixels.size))
    if math.isnan(estimate):
        raise FrameError(
            "the integration length is unknown and the noise cannot be estimated: too few pixels are finite and not "
            "saturated; set integration_length under [pixel] in capture.toml, or --integration-length"
        )
    if pixels.noise.samples is not None:
        estimate /= float(np.median(pixels.noise.samples))
    length = min(estimate, MOST_INTEGRATION)
    return noise_model(plan.metadata, integration_length=length, quantised=False, estimated=True)


def _pooled(pixels: FramePixels, stages: FrameStages, *, window: int) -> FramePixels:
    phasors, samples = stages.phasors(pixels), pixels.noise.samples
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
