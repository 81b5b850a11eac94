"""One frame through the stages: voltages → phasors → paths → maps, a block of pixels at a time."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Stored
from cadtof_cli.calibration.apply import FrameCorrection, frame_correction
from cadtof_cli.calibration.store import cached_calibration
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError, SettingsError
from cadtof_cli.maps.depth import DepthScale, write_paths
from cadtof_cli.maps.layers import DepthMaps, LayerChoice, empty_maps
from cadtof_cli.optics.pinhole import known_focal_length, planar_per_range
from cadtof_cli.phasors.frame_mean import FrameMean
from cadtof_cli.phasors.noise import NoiseModel, estimated_integration_length, noise_model
from cadtof_cli.phasors.pooling import pooled_phasors
from cadtof_cli.phasors.voltages import PhasorScale, phasor_scale, saturated_pixels
from cadtof_cli.resolver.resolve import resolve_paths
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.units import metres_per_radian

DepthKind = Literal["range", "z"]

DEPTH_KINDS: tuple[DepthKind, ...] = ("range", "z")

BLOCK_PIXELS = 19200
"""Pixels a block, a quarter of a QVGA frame: enough that the cost of calling numpy hardly counts, and no more, so that memory
stays small however large the frames are."""

SEARCHED_BLOCK_PIXELS = 32768
"""Pixels a block where paths are searched or refined: the last steps are for a few, and cost the same for any block."""


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
    """All that decides what a frame's maps are, besides its pixels.

    Attributes:
        metadata: how the frame was recorded.
        resolver: how phasors become paths.
        depth: radial range, or planar depth.
        pool: side of the square of neighbours whose noise is pooled, in pixels; 1 for none.
        average: recorded frames that are averaged into one.
        block_pixels: pixels resolved at a time; None for as many as suit the solver.
    """

    metadata: CaptureMetadata
    resolver: ResolverSettings
    depth: DepthKind = "range"
    pool: int = 1
    average: int = 1
    calibration: CalibrationUse | None = None
    block_pixels: int | None = None

    def __post_init__(self) -> None:
        if self.depth not in DEPTH_KINDS:
            raise SettingsError(f"--depth: found {self.depth!r}, expected one of {', '.join(DEPTH_KINDS)}")
        if self.depth == "z":
            known_focal_length(self.metadata.optics)
        if self.pool < 1 or self.pool % 2 == 0:
            raise SettingsError(f"--pool: found {self.pool}, expected an odd number of pixels such as 3 or 5")
        if self.average < 1:
            raise SettingsError(f"--average: found {self.average}, expected 1 frame or more")
        self.resolver.check_harmonics(self.metadata.modulation.harmonics)
        if self.metadata.modulation.waveform != "sine":
            self.resolver.check_response(self.metadata.modulation.harmonics)

    @property
    def is_searched(self) -> bool:
        """Whether paths are searched for, rather than written down in closed form."""
        return not self.resolver.in_closed_form(self.metadata.modulation.harmonics)

    @property
    def layers(self) -> LayerChoice:
        """The layers that the maps get."""
        return LayerChoice(
            paths=self.resolver.paths,
            chi_squared=self.is_searched,
            effective_pixels=self.pool > 1 or self.average > 1,
        )

    def expected_seconds(self, pixels: int, /) -> float:
        """Return about how long a core takes for a frame of so many pixels."""
        return pixels * self.resolver.seconds_per_pixel(len(self.metadata.modulation.harmonics))


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


def resolve_frame(frame: Stored | FrameMean, /, *, plan: FramePlan, maps: DepthMaps | None = None) -> ResolvedFrame:
    """Return the maps of one frame of stored values, (H, 2, Y, X), or of the mean of several.

    Args:
        frame: the frame.
        plan: what to do with it.
        maps: maps of the frame's size that are written over and returned; fresh memory costs as much as the arithmetic.

    Raises:
        FrameError: the noise must be estimated from the frame, and too few of its pixels are finite.
        SettingsError: the plan does not fit the frame's type, or lacks the optics that it needs.
    """
    maps = maps or empty_maps(*_size(frame), layers=plan.layers)
    noise = resolve_pixels(frame, plan=plan, maps=maps)
    return ResolvedFrame(maps, noise.integration_length, noise.estimated)


def resolve_pixels(
    frame: Stored | FrameMean, /, *, plan: FramePlan, maps: DepthMaps, pixels: range | None = None
) -> NoiseModel:
    """Fill `maps` at the given flat indices, or everywhere, block by block, and return the noise of the frame.

    What a pixel gets does not depend on which others are resolved with it, so neither the size of the blocks nor the range
    changes a bit of the answer.
    """
    recorded = frame if isinstance(frame, FrameMean) else FrameMean.of_one(frame)
    height, width = _size(recorded)
    stages = _stages(plan, recorded.dtype, height, width)
    noise = _frame_noise(recorded, plan, stages)
    source = (
        _Planes(recorded, stages)
        if plan.pool == 1
        else _pooled(_Planes(recorded, stages), plan, noise, stages.correction.hot)
    )
    asked = range(height * width) if pixels is None else pixels
    correction = stages.correction
    few_are_slow = plan.is_searched or correction.response is not None
    step = plan.block_pixels or (SEARCHED_BLOCK_PIXELS if few_are_slow else BLOCK_PIXELS)
    for start in range(asked.start, asked.stop, step):
        block = slice(start, min(start + step, asked.stop))
        phasors, saturated, samples = source.block(block)
        paths = resolve_paths(
            phasors,
            saturated=saturated,
            settings=plan.resolver,
            noise=noise,
            amplitude_v=stages.phasors.amplitude_v,
            samples=samples,
            response=correction.response.block(block) if correction.response else None,
            hot=None if correction.hot is None else correction.hot[block],
        )
        if plan.calibration is not None:
            np.bitwise_or(paths.status, np.uint32(StatusBit.CALIBRATED), out=paths.status)
        write_paths(paths, scale=stages.depth, maps=maps, start=start, samples=samples)
    return noise


def _size(frame: Stored | FrameMean) -> tuple[int, int]:
    height, width = (frame.stored if isinstance(frame, FrameMean) else frame).shape[2:]
    return height, width


class _Planes:
    """The phasors of a recorded frame, a block at a time."""

    def __init__(self, frame: FrameMean, stages: _Stages, /) -> None:
        self.size = _size(frame)
        self._stored = frame.stored.reshape(*frame.stored.shape[:2], -1)
        self._samples = None if frame.samples is None else frame.samples.ravel()
        self._stages = stages

    def block(self, pixels: slice, /) -> tuple[Complex, Bool, Float | None]:
        """Return phasors (H, n), which of them are saturated, and over how many frames each is a mean (None: one)."""
        stored = self._stored[:, :, pixels]
        samples = None if self._samples is None else self._samples[pixels]
        phasors = self._stages.correction.phasors(stored, pixels)
        return phasors, saturated_pixels(stored, scale=self._stages.phasors), samples


@dataclass(frozen=True)
class _Pooled:
    """Pooled phasors of a frame: (H, Y·X), and the saturated pixels and samples that belong to them, (Y·X,)."""

    phasors: Complex
    saturated: Bool
    samples: Float

    def block(self, pixels: slice, /) -> tuple[Complex, Bool, Float]:
        """Return a block of them."""
        return self.phasors[:, pixels], self.saturated[pixels], self.samples[pixels]


def _pooled(planes: _Planes, plan: FramePlan, noise: NoiseModel, hot: Bool | None) -> _Pooled:
    phasors, saturated, samples = planes.block(slice(None))
    left_out = saturated if hot is None else saturated | hot
    pooled = pooled_phasors(
        phasors.reshape(-1, *planes.size),
        usable=(np.isfinite(phasors).all(axis=0) & ~left_out).reshape(planes.size),
        samples=(np.ones(saturated.size) if samples is None else samples).reshape(planes.size),
        noise=noise,
        window=plan.pool,
    )
    return _Pooled(pooled.phasors.reshape(len(phasors), -1), saturated, pooled.samples.ravel())


def _frame_noise(frame: FrameMean, plan: FramePlan, stages: _Stages) -> NoiseModel:
    """Return the noise of a recorded pixel: from the integration length, or, where that is unknown, from the frame."""
    n_av = plan.metadata.pixel.integration_length
    if n_av is not None:
        return noise_model(plan.metadata, integration_length=n_av, quantised=frame.dtype.kind in "iu")
    phasors, saturated, samples = _Planes(frame, stages).block(slice(None))
    phasors[:, saturated] = np.nan
    estimate = estimated_integration_length(phasors.reshape(-1, *_size(frame)))
    if math.isnan(estimate):
        raise FrameError(
            "the integration length is unknown and the noise cannot be estimated: too few pixels are finite and not "
            "saturated; set integration_length under [pixel] in capture.toml, or --integration-length"
        )
    if samples is not None:
        estimate /= float(np.median(samples))
    # A frame without any noise (a synthetic one) is given that of float32 rounding, so that every threshold stays finite.
    return noise_model(plan.metadata, integration_length=min(estimate, 1e12), quantised=False, estimated=True)
