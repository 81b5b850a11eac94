"""The two records that the stages of a frame pass on: its pixels, and what all frames of one plan, type and size share."""

import itertools
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Complex, SomePixels, Status, Stored, sealed
from cadtof_cli.calibration.apply import FrameCorrection, frame_correction
from cadtof_cli.maps.depth import DepthScale, most_volts
from cadtof_cli.maps.layers import Layer
from cadtof_cli.optics import LampBeside, planar_per_range
from cadtof_cli.phasors.noise import NoiseModel, chi_squared_threshold, noise_model
from cadtof_cli.phasors.voltages import phasors_from_stored, saturated_pixels
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.resolver.two_path.kernel import STORED_TYPES, FrameKernel, KernelScales, saturation
from cadtof_cli.units import metres_per_radian

if TYPE_CHECKING:
    from cadtof_cli.calibration.store import Calibration
    from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
    from cadtof_cli.resolver.diffuse.light import FrameTraits
    from cadtof_cli.resolver.diffuse.records import DiffuseModel
    from cadtof_cli.resolver.paths import ResolvedPaths
    from cadtof_cli.resolver.response.table import ResponseBlock


EVERY = slice(None)

SEARCHED_BLOCK_PIXELS = 32768
"""Pixels per block if paths are searched or refined. The last steps of a search are for a few pixels, and cost the same
for any size of block, so small blocks are slow; large blocks take much memory."""


@dataclass(frozen=True, eq=False)
class FramePixels:
    """n consecutive pixels of a frame after the stages that couple pixels: from here on each pixel is resolved alone.

    Attributes:
        stored: values as recorded, or their mean over frames, (H, 2, n).
        dtype: type in which the values were recorded.
        size: (Y, X) of the whole frame.
        first: flat index of the first of the n pixels.
        noise: noise of a recorded pixel, and the number of recorded pixels that each of the n is a mean of.
        pooled: phasors that are means over neighbours, (H, n), and replace the phasors that follow from `stored`; None:
            not pooled.
        without_noise: whether all pixels of the frame hold the same values, which no camera records.
        choice: the model of MPI that was chosen for the frame; None if there was no choice.
        tail: the model that predicts diffuse MPI; None if the frame has none.
    """

    stored: Stored
    dtype: np.dtype[np.generic]
    size: tuple[int, int]
    first: int
    noise: NoiseModel
    pooled: Complex | None = None
    without_noise: bool = False
    choice: "DiffuseChoice | None" = None
    tail: "DiffuseModel | None" = None

    @property
    def count(self) -> int:
        """The number n of pixels."""
        return int(self.stored.shape[2])

    @property
    def here(self) -> slice:
        """The flat indices of the pixels in the frame."""
        return slice(self.first, self.first + self.count)

    def places(self, chosen: SomePixels, /) -> SomePixels:
        """Return the flat indices, in the frame, of some of the pixels."""
        if isinstance(chosen, slice):
            start, stop, _ = chosen.indices(self.count)
            return slice(self.first + start, self.first + stop)
        return self.first + chosen

    def __getitem__(self, pixels: slice, /) -> "FramePixels":
        return replace(
            self,
            stored=self.stored[:, :, pixels],
            first=self.first + pixels.indices(self.count)[0],
            noise=self.noise[pixels],
            pooled=None if self.pooled is None else self.pooled[:, pixels],
        )

    def parts(self, count: int, /) -> tuple["FramePixels", ...]:
        """Return the pixels in `count` parts, which differ in size by one pixel at most."""
        edges = (index * self.count // count for index in range(count + 1))
        return tuple(self[begin:end] for begin, end in itertools.pairwise(edges))


@dataclass(frozen=True, eq=False)
class FrameStages:
    """Everything that all blocks of frames of one plan, type and size share.

    Attributes:
        plan: what decides the maps of the frames.
        correction: correction of the stored values.
        depth: how paths become metres and volts.
        response: response with which pixels are resolved; pooled pixels have no phase of their own. None for a sine.
        solver_module: module of the resolver with the solver for these frames.
        layers: layers of the maps, besides the status.
        noise: noise of a recorded pixel; None: it is estimated from each frame.
    """

    plan: FramePlan
    correction: FrameCorrection
    depth: DepthScale
    response: "ResponseBlock | None"
    solver_module: str
    layers: tuple[Layer, ...]
    noise: NoiseModel | None

    def phasors(self, pixels: FramePixels, chosen: SomePixels = EVERY) -> Complex:
        """Return the phasors of all or some of the pixels, (H, n): the pooled ones, or those that follow from the
        stored values."""
        if pixels.pooled is not None:
            return _some(pixels.pooled, chosen)
        return phasors_from_stored(_some(pixels.stored, chosen), self.correction.phasor_map[pixels.places(chosen)])

    def status(self, pixels: FramePixels, chosen: SomePixels = EVERY, *, saturated: bool = True) -> Status:
        """Return the status bits, (n,), of all or some of the pixels that are known before phasors are: hot and, if
        `saturated`, saturated pixels. Such pixels get no answer."""
        hot = self.correction.hot
        bits = np.uint32(0) if hot is None else hot[pixels.places(chosen)] * np.uint32(StatusBit.HOT_PIXEL)
        if saturated:
            beyond = saturated_pixels(_some(pixels.stored, chosen), self.plan.metadata.voltage.saturated_counts)
            bits = bits | beyond * np.uint32(StatusBit.SATURATED)
        return np.asarray(bits, np.uint32)

    def resolved(self, pixels: FramePixels, /) -> "ResolvedPaths":
        """Return the paths of prepared pixels."""
        from cadtof_cli.resolver.resolve import resolve_paths

        return resolve_paths(
            self.phasors(pixels),
            status=self.status(pixels),
            settings=self.plan.resolver,
            noise=pixels.noise,
            response=self.response.block(pixels.here) if self.response else None,
            tail=pixels.tail,
            first=pixels.first,
        )


def _some(planes: Stored, chosen: SomePixels) -> Stored:
    """Return some pixels of planes, (…, n) → (…, m), with the values of each plane side by side in memory."""
    return planes[..., chosen] if isinstance(chosen, slice) else planes.take(chosen, axis=-1)


@lru_cache(maxsize=4)
def frame_stages(
    plan: FramePlan, calibration: "Calibration | None", dtype: np.dtype[np.generic], size: tuple[int, int]
) -> FrameStages:
    """Return the stages of all frames of one plan, type and size.

    Raises:
        SettingsError: the frames do not fit the plan or the calibration.
    """
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
    n_av, noise = metadata.pixel.integration_length, None
    response = correction.response
    if response is not None and plan.settings.pool > 1:
        response = response.without_phases
    solver = plan.resolver.solver_module(metadata.modulation.harmonics, sine=response is None)
    if n_av is not None:
        noise = noise_model(metadata, integration_length=n_av, quantised=dtype.kind in "iu")
    return sealed(FrameStages(plan, correction, depth, response, solver, plan.layers, noise))


def kernel_of_frame(
    stages: FrameStages,
    first: int,
    count: int,
    noise: NoiseModel,
    source_type: np.dtype[np.generic],
    tail: "DiffuseModel | None" = None,
) -> FrameKernel:
    """Return the compiled kernel for `count` pixels of a frame, from the flat index `first` on.

    It takes stored values, or phasors if `source_type` is complex.
    """
    block = slice(first, first + count)
    most_v, noise_v = most_volts(noise, stages.depth.amplitude_v)
    buffers = None
    if tail is not None:
        from cadtof_cli.resolver.diffuse.pixels import tail_buffers

        buffers = tail_buffers(tail, first)
    scales = KernelScales(
        phasor_map=stages.correction.phasor_map[block] if source_type.kind != "c" else None,
        saturated_counts=stages.plan.metadata.voltage.saturated_counts,
        metres=stages.depth.metres(block),
        volts=stages.depth.amplitude_v,
        phase_offset_rad=stages.depth.phase_offset_rad(block),
        tail=buffers,
        most_volts=most_v,
        noise_volts=noise_v,
    )
    return FrameKernel(scales, settings=stages.plan.resolver, noise=noise, count=count, source_type=source_type)


kernel_of_frames = lru_cache(maxsize=4)(kernel_of_frame)
"""`kernel_of_frame` with a cache, for frames that have nothing of their own in it: no tail and no samples."""


def frame_traits(
    stages: FrameStages, noise: NoiseModel, size: tuple[int, int], stored: np.dtype[np.generic]
) -> "FrameTraits":
    """Return what is known of a frame besides its light, from its noise, its size and the type of its stored values."""
    from cadtof_cli.phasors.pooling import shared_noise
    from cadtof_cli.resolver.diffuse.grid import View, assumed_view, patch_grid
    from cadtof_cli.resolver.diffuse.light import FrameTraits, Look
    from cadtof_cli.resolver.diffuse.settings import DiffuseSettings

    metadata, resolver = stages.plan.metadata, stages.plan.resolver
    modulation, optics = metadata.modulation, metadata.optics
    correction, curvature_m, window = stages.correction, stages.depth.range_offset_m, stages.plan.settings.pool
    focal, terms = optics.focal_length_px, None
    grid = patch_grid(*size, View(focal, optics.principal_point(size)) if focal else assumed_view(*size))
    if correction.response is not None:
        from cadtof_cli.resolver.diffuse.other_terms import harmonics_seen

        terms = harmonics_seen(correction.response)
    samples = 1.0 if noise.samples is None else float(np.median(noise.samples))
    recorded = tuple(one.dark_variance for one in noise.each)
    look = None
    if correction.response is None and window == 1 and stored in STORED_TYPES[:-1]:
        power = chi_squared_threshold(resolver.false_alarm, pairs=len(noise.each))
        saturated = saturation(metadata.voltage.saturated_counts, stored)
        look = Look(correction.phasor_map, saturated, power, noise, correction.hot)
    return FrameTraits(
        grid,
        DiffuseSettings(
            model=resolver.mpi_model,
            period_ns=modulation.periods_ns[0],
            harmonics=modulation.harmonics,
            terms=terms,
        ),
        np.array(recorded) / samples,
        recorded,
        shared_noise(window, samples=samples, stride=grid.stride, count=grid.side // grid.stride),
        None if curvature_m is None else -curvature_m.reshape(size),
        look,
    )


traits_of_frames = lru_cache(maxsize=4)(frame_traits)
"""`frame_traits` with a cache, for frames that have nothing of their own in it: no samples."""
