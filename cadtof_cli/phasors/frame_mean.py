"""Several recorded frames → one with less noise: the mean of what each pixel stored, soundly, in any of them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cadtof_cli.arrays import Bool, Float, Stored


@dataclass(frozen=True)
class FrameMean:
    """The mean of frames: `stored`, (H, 2, Y, X), over `samples` frames, float64 (Y, X), recorded as `dtype`.

    A pixel that no frame recorded soundly keeps the values of the first, and counts as one sample. `samples` is None for a
    frame that stands for itself.
    """

    stored: Stored
    samples: Float | None
    dtype: np.dtype[np.generic]

    @classmethod
    def of_one(cls, stored: Stored, /) -> "FrameMean":
        """Return a frame as it was recorded."""
        return cls(stored, None, stored.dtype)


def frame_mean(frames: Iterable[Stored], /, *, saturated_counts: tuple[float, float] | None) -> FrameMean:
    """Return the mean of frames of stored values, (H, 2, Y, X) each, of which at least one is given.

    A frame counts for a pixel where all its values there are finite and inside `saturated_counts`.
    """
    total = count = first = None
    for stored in frames:
        if first is None or total is None or count is None:
            first = stored
            total, count = np.zeros(stored.shape), np.zeros(stored.shape[2:])
        sound = _sound(stored, saturated_counts)
        total += np.where(sound, stored, 0)
        count += sound
    if first is None or total is None or count is None:
        raise ValueError("the mean of no frames")
    return FrameMean(np.where(count > 0.0, total / np.maximum(count, 1.0), first), np.maximum(count, 1.0), first.dtype)


def _sound(stored: Stored, saturated_counts: tuple[float, float] | None) -> Bool:
    sound = np.isfinite(stored)
    if saturated_counts is not None:
        sound &= (stored > saturated_counts[0]) & (stored < saturated_counts[1])
    everywhere: Bool = np.logical_and.reduce(sound.reshape(-1, *sound.shape[2:]))
    return everywhere
