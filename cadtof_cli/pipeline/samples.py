"""The sampled pixels by which a frame's MPI is judged, with the phasors that a sine would have recorded in them."""

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Bool, Complex, Float, Index, sealed
from cadtof_cli.pipeline.stages import FramePixels, FrameStages
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.diffuse.grid import PatchGrid, sampled_pixels
from cadtof_cli.resolver.diffuse.light import PatchLight, sampled_light
from cadtof_cli.resolver.resolve import resolve_paths, screened

if TYPE_CHECKING:
    from cadtof_cli.resolver.diffuse.records import DiffuseModel
    from cadtof_cli.resolver.response.table import ResponseBlock


@dataclass(frozen=True, eq=False)
class FrameSamples:
    """The n sampled pixels of a frame, on its grid of patches.

    Attributes:
        places: flat indices of the pixels in the frame, (rows, columns).
        recorded: phasors of the pixels, (H, n).
        of_paths: phasors that a sine would have recorded of the paths that fit `recorded`, (H, n).
        usable: the sound pixels with light above the noise, (n,).
        response: response of the pixels' channel pairs; None for a sine.
        harmonics: numbers of the harmonics.
        grid: grid of the frame.
    """

    places: Index
    recorded: Complex
    of_paths: Complex
    usable: Bool
    response: "ResponseBlock | None"
    harmonics: tuple[int, ...]
    grid: PatchGrid

    def light(self, tail: "DiffuseModel | None" = None, /) -> PatchLight:
        """Return the light of the patches, freed of the response's other terms: by the paths of the pixels, or by a
        known tail."""
        phasors = self.of_paths
        if tail is not None and self.response is not None:
            from cadtof_cli.resolver.diffuse.other_terms import freed_of_other_terms

            places = self.places.ravel()
            with np.errstate(all="ignore"):
                of_tail, _ = freed_of_other_terms(
                    self.recorded, tail.tails_of_patches(places), response=self.response, alone_rad=self._alone_rad
                )
            phasors = np.where(tail.of_paths(places), phasors, of_tail)
        shape = self.places.shape
        return sampled_light(
            phasors.reshape(-1, *shape), self.usable.reshape(shape), self.grid, harmonics=self.harmonics
        )

    @cached_property
    def _alone_rad(self) -> Float:
        """The phases of a single path in each pixel, (n,), from which the pixels are freed of other terms with every tail."""
        from cadtof_cli.resolver.response.as_sine import first_phase

        return first_phase(self.recorded[0], response=self.response)


def frame_samples(pixels: FramePixels, stages: FrameStages, grid: PatchGrid, /) -> FrameSamples:
    """Return the sampled pixels of a frame. This is numpy, apart from a search for paths by the kernel.

    `min_confidence` does not count: surfaces that get no answer light the others all the same.
    """
    places = _sampled(pixels.size, grid.shift)
    chosen = places.ravel()
    phasors, noise, response = stages.phasors(pixels, chosen), pixels.noise[chosen], stages.response
    settings = replace(stages.plan.resolver, min_confidence=None)
    of_paths = phasors
    with np.errstate(over="ignore", invalid="ignore"):
        # no warnings: the screening finds NaN, and values that no camera stores
        powers = [phasor.real**2 + phasor.imag**2 for phasor in phasors]
        status, _ = screened(np.sqrt(powers[0]), powers, stages.status(pixels, chosen), settings=settings, noise=noise)
        if response is not None:
            from cadtof_cli.resolver.response.as_sine import phasors_of_sine

            response = response.block(chosen)
            found = resolve_paths(phasors, status=status, settings=settings, noise=noise, response=response)
            of_paths = phasors_of_sine(phasors, found.paths, response=response)
    return FrameSamples(places, phasors, of_paths, np.asarray(status == 0), response, noise.harmonics, grid)


@lru_cache(maxsize=4)
def _sampled(size: tuple[int, int], shift: tuple[int, int]) -> Index:
    """Return the flat indices of the sampled pixels of a frame, (rows, columns)."""
    return sealed(np.arange(size[0] * size[1]).reshape(size)[sampled_pixels(*size, shift)].copy())
