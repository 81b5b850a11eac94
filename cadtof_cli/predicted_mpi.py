"""The MPI of a frame, predicted from its own geometry where it is diffuse: what it is looked at with."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Index, sealed
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.optics import principal_point
from cadtof_cli.resolver.two_path.kernel import saturation

if TYPE_CHECKING:
    from cadtof_cli.frame_pixels import FramePixels
    from cadtof_cli.pipeline import FrameStages
    from cadtof_cli.resolver.diffuse.grid import PatchGrid
    from cadtof_cli.resolver.diffuse.light import PatchLight
    from cadtof_cli.resolver.diffuse.records import DiffuseChoice, DiffuseModel


def predicted_mpi(
    pixels: "FramePixels", plan: FramePlan, stages: "FrameStages", kernel: str
) -> "tuple[DiffuseChoice, DiffuseModel | None]":
    """Return which model of MPI a frame has and, where that is diffuse, what predicts it from the frame's own geometry."""
    from cadtof_cli.resolver.diffuse.grid import View, assumed_view, patch_grid
    from cadtof_cli.resolver.diffuse.predict import diffuse_model
    from cadtof_cli.resolver.diffuse.records import DiffuseModel
    from cadtof_cli.resolver.diffuse.settings import DiffuseSettings

    noise, modulation, optics = pixels.noise, plan.metadata.modulation, plan.metadata.optics
    focal, offset = optics.focal_length_px, stages.depth.range_offset_m
    grid = patch_grid(
        *pixels.size, View(focal, principal_point(optics, pixels.size)) if focal else assumed_view(*pixels.size)
    )
    found = diffuse_model(
        _light(pixels, grid, stages, kernel),
        grid=grid,
        variances=tuple(one.dark_variance for one in noise.each),
        settings=DiffuseSettings(
            model=stages.resolver.mpi_model, period_ns=modulation.periods_ns[0], harmonics=noise.harmonics
        ),
        samples=None if noise.samples is None else noise.samples.reshape(pixels.size),
        range_offset_m=None if offset is None else -offset.reshape(pixels.size),
        kernel=kernel,
    )
    return (found.choice, found) if isinstance(found, DiffuseModel) else (found, None)


def _light(pixels: "FramePixels", grid: "PatchGrid", stages: "FrameStages", kernel: str) -> "PatchLight":
    """Return the light of the pixels that a frame is looked at by."""
    from cadtof_cli.resolver.diffuse.compiled_light import Look, compiled_light, compiled_looks
    from cadtof_cli.resolver.diffuse.light import PatchLight, sampled_light

    noise, correction = pixels.noise, stages.correction
    if correction.response is None and pixels.pooled is None and compiled_looks(pixels.stored, kernel):
        limits = saturation(stages.saturated_counts, pixels.stored.dtype)
        look = Look.of(stages.resolver, noise, correction.phasor_map, limits, correction.hot)
        return PatchLight(*compiled_light(pixels.stored, look, grid, kernel=kernel))
    chosen = _sampled(pixels.size)
    phasors, usable = _as_of_a_sine(pixels, chosen.ravel(), stages, kernel)
    return sampled_light(
        phasors.reshape(-1, *chosen.shape), usable.reshape(chosen.shape), grid, harmonics=noise.harmonics
    )


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
