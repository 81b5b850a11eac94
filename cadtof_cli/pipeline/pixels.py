"""Pixels of one frame, all of them or a part, on their way from what couples them to where each is resolved alone."""

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cadtof_cli.arrays import Complex, SomePixels, Stored
from cadtof_cli.phasors.noise import NoiseModel
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.resolver.diffuse.choice import DiffuseChoice
    from cadtof_cli.resolver.diffuse.records import DiffuseModel

EVERY = slice(None)


@dataclass(frozen=True, eq=False)
class FramePixels:
    """Consecutive pixels of a frame after the stages that couple pixels: from here on each is resolved alone.

    Attributes:
        stored: values as recorded, or their mean over frames, (H, 2, n).
        dtype: type that they were recorded in.
        size: (Y, X) of the whole frame.
        first: flat index of the first of the n pixels.
        noise: of a recorded pixel, with how many each of the n is a mean of.
        pooled: means over neighbours, (H, n), instead of the phasors that follow from `stored`; None: there are none.
        without_noise: whether all pixels of the frame hold the same, which no camera records.
        choice: which model of MPI the frame was found to have; None where there was no choice.
        tail: what its MPI is predicted by where it is diffuse; None where it is not.
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

    def places(self, chosen: SomePixels, /) -> SomePixels:
        """Return where in the frame some of the pixels stand, as flat indices."""
        if isinstance(chosen, slice):
            start, stop, _ = chosen.indices(self.stored.shape[2])
            return slice(self.first + start, self.first + stop)
        return self.first + chosen

    def __getitem__(self, pixels: slice, /) -> "FramePixels":
        return replace(
            self,
            stored=self.stored[:, :, pixels],
            first=self.first + pixels.indices(self.stored.shape[2])[0],
            noise=self.noise[pixels],
            pooled=None if self.pooled is None else self.pooled[:, pixels],
        )

    def parts(self, count: int, /) -> tuple["FramePixels", ...]:
        """Return the pixels in so many parts of the same size, give or take one."""
        edges = (index * self.stored.shape[2] // count for index in range(count + 1))
        return tuple(self[begin:end] for begin, end in itertools.pairwise(edges))
