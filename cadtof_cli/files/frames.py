"""The order of a frame's planes in files, and the frames of an open file as every reader returns them."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.records import dataclass
from cadtof_cli.units import size_text

CHANNELS = 2
"""SC1, the cosine, and SC2, the sine."""

SAMPLE_TYPES = ("float16", "float32", "float64", "int16", "int32", "uint16", "uint32", "uint8")
"""Types that a frame may be recorded in."""


class NotAFrameError(FrameError):
    """A sound file that holds something other than voltages, such as a map; a run reports it as skipped."""


@dataclass(frozen=True)
class RawLayout:
    """What a raw dump holds (`[layout.raw]`): numpy's name of its type, shape (…, Y, X), and bytes before the first value."""

    dtype: str
    shape: tuple[int, ...]
    offset_bytes: int = 0


@dataclass(frozen=True)
class FrameLayout:
    """What the metadata says of how files are laid out.

    Attributes:
        harmonics: harmonic numbers h in rising order, such as (1, 2).
        frames: frames in each stack (`[layout] frames`); None where files say it themselves.
        raw: what raw dumps hold; None where nothing says it.
    """

    harmonics: tuple[int, ...]
    frames: int | None = None
    raw: RawLayout | None = None

    @property
    def planes(self) -> int:
        """Planes in one frame: SC1 and SC2 at every harmonic."""
        return CHANNELS * len(self.harmonics)

    @property
    def plane_names(self) -> tuple[str, ...]:
        """Names of the planes in the order of files and pages."""
        return tuple(plane_name(harmonic, channel) for harmonic in self.harmonics for channel in (1, 2))


class ReadFrame(Protocol):
    """How a frame of an open file is read."""

    def __call__(self, index: int = 0, /) -> Stored:
        """Return frame `index` as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of one open file.

    Attributes:
        count: how many there are.
        shape: of one frame, H C Y X.
        dtype: of the stored values, native byte order.
        read: reads one of them.
        read_like: reads the single frame of another file whose bytes differ from this one's in their pixels alone, which so is as
            sound as this one; None of any other file. OSError: it cannot be read. None: a reader has no such way.
    """

    count: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: ReadFrame
    read_like: Callable[[Path], Stored | None] | None = None


def is_sample_type(dtype: str, /) -> bool:
    """Return whether numpy's name of a type, of any byte order, is one that a frame may be recorded in."""
    try:
        return np.dtype(dtype).name in SAMPLE_TYPES
    except (TypeError, ValueError, SyntaxError):
        # numpy parses texts with commas and brackets as structured types
        return False


def plane_name(harmonic: int, channel: int) -> str:
    """Return the name that one plane has in EXR files and in messages, such as H1.SC2."""
    return f"H{harmonic}.SC{channel}"


def harmonic_labels(harmonics: tuple[int, ...], found: Collection[int]) -> tuple[int, ...]:
    """Return what a capture calls its harmonics: their numbers h, or their places 1, 2, … in the order.

    The number is the rule. Places are accepted where they are all there and the numbers are not: a capture with
    harmonics (1, 3) whose files say H1 and H2 has counted them.
    """
    places = tuple(range(1, len(harmonics) + 1))
    if not set(harmonics) <= set(found) and set(places) <= set(found):
        return places
    return harmonics


def shape_text(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    """Return an image's size for a message, such as `320 × 240 uint16`, from a shape that ends in Y, X."""
    return f"{size_text(shape[-2:])} {dtype.name}"
