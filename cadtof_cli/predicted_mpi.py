"""The MPI of a frame, predicted from its own geometry where it is diffuse: what it is looked at with."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Index, sealed
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.last_call import same_as_last
from cadtof_cli.optics import principal_point
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.settings import MpiModel
from cadtof_cli.resolver.two_path.kernel import saturation

if TYPE_CHECKING:
    from cadtof_cli.frame_pixels import FramePixels
    from cadtof_cli.pipeline import FrameStages
    from cadtof_cli.resolver.diffuse.compiled_light import Look
    from cadtof_cli.resolver.diffuse.grid import PatchGrid
    from cadtof_cli.resolver.diffuse.light import PatchLight
    from cadtof_cli.resolver.diffuse.records import DiffuseChoice, DiffuseModel
    from cadtof_cli.resolver.diffuse.settings import DiffuseSettings


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the MPI of all frames of one plan and size is predicted with: how they are cut, and what is asked for."""

    grid: "PatchGrid"
    settings: "DiffuseSettings"

    @classmethod
    def of(cls, metadata: CaptureMetadata, size: tuple[int, int], model: MpiModel, /) -> "Prediction":
        """Return it for frames of (Y, X) pixels."""
        from cadtof_cli.resolver.diffuse.grid import View, assumed_view, patch_grid
        from cadtof_cli.resolver.diffuse.settings import DiffuseSettings

        modulation, optics = metadata.modulation, metadata.optics
        focal = optics.focal_length_px
        view = View(focal, principal_point(optics, size)) if focal else assumed_view(*size)
        asked = DiffuseSettings(model=model, period_ns=modulation.periods_ns[0], harmonics=modulation.harmonics)
        return cls(patch_grid(*size, view), asked)


def predicted_mpi(
    pixels: "FramePixels", stages: "FrameStages", prediction: Prediction, kernel: str
) -> "tuple[DiffuseChoice, DiffuseModel | None]":
    """Return which model of MPI a frame has and, where that is diffuse, what predicts it from the frame's own geometry."""
    from cadtof_cli.resolver.diffuse.predict import diffuse_model
    from cadtof_cli.resolver.diffuse.records import DiffuseModel

    noise, offset = pixels.noise, stages.depth.range_offset_m
    found = diffuse_model(
        _light(pixels, prediction.grid, stages, kernel),
        grid=prediction.grid,
        variances=tuple(one.dark_variance for one in noise.each),
        settings=prediction.settings,
        samples=None if noise.samples is None else noise.samples.reshape(pixels.size),
        range_offset_m=None if offset is None else -offset.reshape(pixels.size),
        kernel=kernel,
    )
    return (found.choice, found) if isinstance(found, DiffuseModel) else (found, None)


def _light(pixels: "FramePixels", grid: "PatchGrid", stages: "FrameStages", kernel: str) -> "PatchLight":
    """Return the light of the pixels that a frame is looked at by."""
    from cadtof_cli.resolver.diffuse.compiled_light import compiled_light
    from cadtof_cli.resolver.diffuse.light import PatchLight, sampled_light

    noise = pixels.noise
    find = _look_of_frames if noise.samples is None else _look
    look = find(stages, noise, pixels.stored.dtype, kernel) if pixels.pooled is None else None
    if look is not None:
        return PatchLight(*compiled_light(pixels.stored, look, grid, kernel=kernel))
    chosen = _sampled(pixels.size)
    phasors, usable = _as_of_a_sine(pixels, chosen.ravel(), stages, kernel)
    return sampled_light(
        phasors.reshape(-1, *chosen.shape), usable.reshape(chosen.shape), grid, harmonics=noise.harmonics
    )


def _look(stages: "FrameStages", noise: NoiseModel, stored: np.dtype[np.generic], kernel: str) -> "Look | None":
    """Return what the kernel looks at recorded pixels with; None where numpy has to."""
    from cadtof_cli.resolver.diffuse.compiled_light import Look, compiled_looks

    correction = stages.correction
    if correction.response is not None or not compiled_looks(stored, len(noise.each), kernel):
        return None
    limits = saturation(stages.saturated_counts, stored)
    return Look.of(stages.resolver, noise, correction.phasor_map, limits, correction.hot)


_look_of_frames = same_as_last(_look)
"""The same, where frames share it: nothing in it is a frame's own."""


@lru_cache(maxsize=4)
def _sampled(size: tuple[int, int]) -> Index:
    """Return the flat indices of the pixels that a frame is looked at by, (rows, columns)."""
    from cadtof_cli.resolver.diffuse.grid import sampled_pixels

    return sealed(np.arange(size[0] * size[1]).reshape(size)[sampled_pixels(*size)].copy())


def _as_of_a_sine(pixels: "FramePixels", chosen: Index, stages: "FrameStages", kernel: str) -> tuple[Complex, Bool]:
    """Return the phasors of chosen pixels of a frame as a sine would have them, (H, n), and which have an answer, (n,)."""
    from cadtof_cli.resolver.resolve import resolve_paths, screened

    phasors, noise = stages.phasors(pixels, chosen), pixels.noise[chosen]
    with np.errstate(over="ignore", invalid="ignore"):
        # values that no camera stores, and NaN, are what the screening finds
        powers = [phasor.real**2 + phasor.imag**2 for phasor in phasors]
        status, _ = screened(
            np.sqrt(powers[0]), powers, stages.status(pixels, chosen), settings=stages.resolver, noise=noise
        )
    if stages.correction.response is not None:
        response = stages.correction.response.block(chosen, kernel=kernel)
        found = resolve_paths(phasors, status=status, settings=stages.resolver, noise=noise, response=response)
        from cadtof_cli.resolver.response.as_sine import phasors_of_sine

        phasors = phasors_of_sine(phasors, found.paths, response=response)
    return phasors, np.asarray(status == 0)
