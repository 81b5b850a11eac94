"""Classes of pixels by their status, and the colour of each class.

No scale of colours contains one of these colours. Colour-blind people can tell them from each other and from the scales,
and in black and white they differ in lightness.
"""

from enum import Enum

import numpy as np
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Status
from cadtof_cli.resolver.status import StatusBit, has_answer


class PixelClass(Enum):
    """A class of pixels: its name in the legend and its colour; in the order of the legend."""

    ONE_PATH = "one path", "#e3e3e3"
    FEWER_PATHS = "fewer paths", "#e3e3e3"
    TWO_PATHS = "two paths", "#054b86"
    ILL_CONDITIONED = "two paths, ill-conditioned", "#81d3ff"
    MORE_PATHS = "three paths or more", "#008060"
    DIFFUSE = "diffuse MPI", "#d58f00"
    NO_ANSWER = "no answer", "#b2b2b2"
    SATURATED = "saturated", "#7b06fa"
    IN_ONE = "a value in only one of the two", "#f0e442"

    @property
    def label(self) -> str:
        """The name in the legend."""
        return self.value[0]

    @property
    def colour(self) -> str:
        """The colour, in a form that matplotlib takes."""
        return self.value[1]

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """The colour as it stands in an image, RGBA, (4,)."""
        return np.array([round(255 * part) for part in to_rgba(self.colour)], np.uint8)


NO_VALUE = frozenset({PixelClass.ONE_PATH, PixelClass.FEWER_PATHS, PixelClass.NO_ANSWER, PixelClass.SATURATED})
"""Classes that explain why a pixel of a layer has no value. A pixel with one path has no value in layers of MPI, and one with
fewer than K paths has none in layers of the K-th path."""


def classes_of(
    status: Status | None, known: Bool | None = None, /, *, lacking: PixelClass | None = None
) -> dict[PixelClass, Bool]:
    """Return the pixels of each class; a pixel is in one class at most.

    Args:
        status: status bits, (Y, X); None: not known.
        known: pixels that have a value, (Y, X). They are in no class, and the classes are those of `NO_VALUE`. None:
            all classes are used, and every pixel is in one.
        lacking: class of the pixels that have an answer but no value: ONE_PATH or FEWER_PATHS. None: there are none.
    """
    if status is None:
        assert known is not None
        return {PixelClass.NO_ANSWER: ~known}
    left: Bool = np.ones(status.shape, np.bool_) if known is None else ~known
    found = {}
    for kind, bits in _BITS:
        if known is not None and kind not in {PixelClass.SATURATED, lacking}:
            continue
        pixels = left & ((status & np.uint32(bits)) == np.uint32(bits))
        found[kind] = pixels
        left = left & ~pixels
    if lacking is PixelClass.FEWER_PATHS:
        found[lacking] = left & has_answer(status)
        left = left & ~found[lacking]
    found[PixelClass.NO_ANSWER] = left
    return found


_BITS = (
    (PixelClass.SATURATED, StatusBit.SATURATED),
    (PixelClass.DIFFUSE, StatusBit.DIFFUSE_MPI),
    (PixelClass.MORE_PATHS, StatusBit.MORE_PATHS),
    (PixelClass.ILL_CONDITIONED, StatusBit.TWO_PATHS | StatusBit.ILL_CONDITIONED),
    (PixelClass.TWO_PATHS, StatusBit.TWO_PATHS),
    (PixelClass.ONE_PATH, StatusBit.ONE_PATH),
)


def class_shares(status: Status, /) -> dict[PixelClass, float]:
    """Return the share of pixels in each class."""
    return {kind: float(np.mean(pixels)) for kind, pixels in classes_of(status).items()}
