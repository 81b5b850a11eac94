"""One frame through the stages: voltages → phasors → paths → maps, a block of pixels at a time."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.calibration.frame import FrameCorrection, frame_correction
from cadtof_cli.calibration.store import cached_calibration
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError, SettingsError
from cadtof_cli.maps.depth import DepthScale, write_paths
from cadtof_cli.maps.geometry import planar_per_range
from cadtof_cli.maps.layers import DepthMaps, empty_maps
from cadtof_cli.phasors.voltages import PhasorScale, phasor_scale, saturated_pixels
from cadtof_cli.resolver.noise import NoiseModel, estimated_integration_length, noise_model
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.units import metres_per_radian

DepthKind = Literal["range", "z"]

DEPTH_KINDS: tuple[DepthKind, ...] = ("range", "z")

BLOCK_PIXELS = 19200
"""Pixels a block, a quarter of a QVGA frame: enough that the cost of calling numpy hardly counts, and no more, so that memory
stays small however large the frames are."""

REFINED_BLOCKS = 2
"""Blocks at a time where paths are refined: few pixels take many steps, whose calls cost more than what cache would save."""


@dataclass(frozen=True)
class CalibrationUse:
    """A calibration folder and its digest: what crosses to a worker, which reads the folder once.

    `curved` is false where the ranges are to stay as the lens makes them.
    """

    folder: Path
    digest: str
    curved: bool = True


@dataclass(frozen=True, kw_only=True)
class FramePlan:
    """All that decides what a frame's maps are, besides its pixels."""

    metadata: CaptureMetadata
    resolver: ResolverSettings
    depth: DepthKind = "range"
    calibration: CalibrationUse | None = None
    block_pixels: int = BLOCK_PIXELS

    def __post_init__(self) -> None:
        if self.depth not in DEPTH_KINDS:
            raise SettingsError(f"--depth: found {self.depth!r}, expected one of {', '.join(DEPTH_KINDS)}")
        if self.metadata.modulation.harmonics != (1, 2):
            raise SettingsError(
                f"modulation.periods_ns: found {list(self.metadata.modulation.periods_ns)}; "
                "two paths in closed form need two periods, the fundamental and half of it, such as [40.0, 20.0]"
            )


@dataclass(frozen=True)
class _Stages:
    """What every block of frames of one plan, type and size shares."""

    phasors: PhasorScale
    correction: FrameCorrection
    depth: DepthScale


@dataclass(frozen=True)
class ResolvedFrame:
    """The maps of a frame, and the integration length that its noise was taken from (`noise_estimated`: or found)."""

    maps: DepthMaps
    integration_length: float
    noise_estimated: bool


@lru_cache(maxsize=4)
def _stages(plan: FramePlan, dtype: np.dtype[np.generic], height: int, width: int) -> _Stages:
    metadata = plan.metadata
    planar = planar_per_range(metadata.optics, height, width).ravel() if plan.depth == "z" else None
    use = plan.calibration
    calibration = cached_calibration(use.folder, use.digest) if use else None
    scale = phasor_scale(metadata, dtype)
    correction = frame_correction(calibration, metadata, scale, (height, width))
    depth = DepthScale(
        metres_per_radian(metadata.modulation.periods_ns[0]),
        metadata.modulation.amplitude_v,
        planar,
        correction.range_offset_m if use and use.curved else None,
    )
    return _Stages(scale, correction, depth)


def resolve_frame(stored: Stored, /, *, plan: FramePlan, maps: DepthMaps | None = None) -> ResolvedFrame:
    """Return the maps of one frame of stored values, (H, 2, Y, X).

    Args:
        stored: the frame.
        plan: what to do with it.
        maps: maps of the frame's size that are written over and returned; fresh memory costs as much as the arithmetic.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type, or lacks the optics that it needs.
    """
    noise = frame_noise(stored, plan=plan)
    maps = maps or empty_maps(*stored.shape[2:])
    resolve_pixels(stored, plan=plan, noise=noise, maps=maps)
    return ResolvedFrame(maps, noise.integration_length, noise.estimated)


def frame_noise(stored: Stored, /, *, plan: FramePlan) -> NoiseModel:
    """Return the noise of a frame's phasors: from the integration length, or, where that is unknown, from the frame."""
    n_av = plan.metadata.pixel.integration_length
    quantised = stored.dtype.kind in "iu"
    if n_av is not None:
        return noise_model(plan.metadata, integration_length=n_av, quantised=quantised)
    height, width = stored.shape[2:]
    stages = _stages(plan, stored.dtype, height, width)
    planes = stored.reshape(*stored.shape[:2], -1)
    phasors = stages.correction.phasors(planes, slice(None))
    phasors[:, saturated_pixels(planes, scale=stages.phasors)] = np.nan
    estimate = estimated_integration_length(phasors.reshape(-1, height, width))
    if math.isnan(estimate):
        raise FrameError(
            "the integration length is unknown and the noise cannot be estimated: too few pixels are finite and not "
            "saturated; set integration_length under [pixel] in capture.toml, or --integration-length"
        )
    # A frame without any noise (a synthetic one) is given that of float32 rounding, so that every threshold stays finite.
    return noise_model(plan.metadata, integration_length=min(estimate, 1e12), quantised=False, estimated=True)


def resolve_pixels(stored: Stored, /, *, plan: FramePlan, noise: NoiseModel, maps: DepthMaps) -> None:
    """Fill `maps` block by block; no pixel knows of another, so the size of the blocks changes no bit of the answer."""
    height, width = stored.shape[2:]
    stages = _stages(plan, stored.dtype, height, width)
    planes = stored.reshape(*stored.shape[:2], -1)
    correction = stages.correction
    block_pixels = plan.block_pixels * (REFINED_BLOCKS if correction.response else 1)
    for start in range(0, height * width, block_pixels):
        pixels = slice(start, start + block_pixels)
        block = planes[:, :, pixels]
        paths = resolve_paths(
            correction.phasors(block, pixels),
            saturated=saturated_pixels(block, scale=stages.phasors),
            settings=plan.resolver,
            noise=noise,
            amplitude_v=stages.phasors.amplitude_v,
            response=correction.response.block(pixels) if correction.response else None,
            hot=None if correction.hot is None else correction.hot[pixels],
        )
        write_paths(paths, scale=stages.depth, maps=maps, start=start)
    if plan.calibration is not None:
        np.bitwise_or(maps.status, np.uint32(StatusBit.CALIBRATED), out=maps.status)
