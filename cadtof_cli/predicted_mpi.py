"""The MPI of a frame, predicted from its own geometry where it is diffuse: what it is looked at with."""

from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.optics.lens import principal_point

if TYPE_CHECKING:
    from cadtof_cli.pipeline import FramePixels, FrameStages
    from cadtof_cli.resolver.diffuse.records import DiffuseChoice, DiffuseModel

LOOKED_AT_PIXELS = 2**18
"""Pixels that are looked at together where a frame's MPI is predicted: more than a QVGA frame has."""


def predicted_mpi(pixels: "FramePixels", plan: FramePlan, stages: "FrameStages") -> "DiffuseModel | DiffuseChoice":
    """Predict the MPI of a frame from its own geometry, where it is diffuse."""
    from cadtof_cli.resolver.diffuse.grid import View, sampled_rows
    from cadtof_cli.resolver.diffuse.predict import diffuse_model
    from cadtof_cli.resolver.diffuse.settings import DiffuseSettings

    noise, modulation = pixels.noise, plan.metadata.modulation
    phasors, usable = np.zeros((len(noise.harmonics), *pixels.size), np.complex128), np.zeros(pixels.size, np.bool_)
    step = max(LOOKED_AT_PIXELS // pixels.size[1], 1)
    for top in range(0, pixels.size[0], step):
        rows = slice(top, min(top + step, pixels.size[0]))
        seen, sound = _as_of_a_sine(pixels[rows.start * pixels.size[1] : rows.stop * pixels.size[1]], plan, stages)
        # of a large frame, few rows are looked at: the others take no memory
        wanted = sampled_rows(*pixels.size, rows)
        phasors[:, wanted] = seen.reshape(len(phasors), -1, pixels.size[1])[:, wanted - top]
        usable[wanted] = sound.reshape(-1, pixels.size[1])[wanted - top]
    optics, offset = plan.metadata.optics, stages.depth.range_offset_m
    return diffuse_model(
        phasors,
        usable=usable,
        variances=tuple(one.dark_variance for one in noise.each),
        settings=DiffuseSettings(
            model=plan.resolver.mpi_model, period_ns=modulation.periods_ns[0], harmonics=noise.harmonics
        ),
        view=View(focal, principal_point(optics, pixels.size)) if (focal := optics.focal_length_px) else None,
        samples=None if noise.samples is None else noise.samples.reshape(pixels.size),
        range_offset_m=None if offset is None else -offset.reshape(pixels.size),
    )


def _as_of_a_sine(pixels: "FramePixels", plan: FramePlan, stages: "FrameStages") -> tuple[Complex, Bool]:
    """Return the phasors of pixels as a sine would have them, (H, n), and which of them have an answer, (n,)."""
    from cadtof_cli.resolver.resolve import resolve_paths, screened

    phasors, noise = stages.phasors(pixels), pixels.noise
    with np.errstate(over="ignore", invalid="ignore"):
        # values that no camera stores, and NaN, are what the screening finds
        powers = [phasor.real**2 + phasor.imag**2 for phasor in phasors]
        status, _ = screened(np.sqrt(powers[0]), powers, stages.status(pixels), settings=plan.resolver, noise=noise)
    if stages.correction.response is not None:
        response = stages.correction.response.block(slice(pixels.first, pixels.first + pixels.count))
        found = resolve_paths(
            phasors, status=status, settings=plan.resolver, noise=noise, response=response, first=pixels.first
        )
        from cadtof_cli.resolver.response.as_sine import phasors_of_sine

        phasors = phasors_of_sine(phasors, found.paths, response=response)
    return phasors, np.asarray(status == 0)
