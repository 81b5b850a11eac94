"""Pixels of one frame, all of them or a part: the record that `prepare_frame` returns and `resolve_pixels` takes."""

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

    def places(self, chosen: SomePixels, /) -> SomePixels:
        """Return the flat indices, in the frame, of some of the pixels."""
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
        """Return the pixels in `count` parts, which differ in size by one pixel at most."""
        edges = (index * self.stored.shape[2] // count for index in range(count + 1))
        return tuple(self[begin:end] for begin, end in itertools.pairwise(edges))
