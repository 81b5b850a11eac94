"""What a frame is before it is read: where it lies, how its planes are ordered, and how a reader hands it over."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError

Container = Literal["tif", "exr"]

CHANNELS = 2
"""SC1, the cosine, and SC2, the sine."""


class NotAFrameError(FrameError):
    """A sound file that holds something other than voltages, such as a map; a run reports it as skipped."""


@dataclass(frozen=True)
class FrameSource:
    """Where one frame lies.

    Parameters:
        name: stem of what is written for the frame.
        paths: one file, or 2·H files of one plane each in the order H1.SC1, H1.SC2, H2.SC1, …
        index: position in a stack; None where the file is to hold this frame alone.
    """

    name: str
    paths: tuple[Path, ...]
    index: int | None = None

    def __post_init__(self) -> None:
        if not self.paths:
            raise ValueError(f"frame {self.name} has no files")

    def __str__(self) -> str:
        place = str(self.paths[0]) if len(self.paths) == 1 else f"{self.paths[0].parent / self.name}"
        return place if self.index is None else f"{place}[{self.index}]"

    def expanded(self, count: int, *, taken: Collection[str] = ()) -> tuple["FrameSource", ...]:
        """Return a source for each of the `count` frames of the stack that the file turned out to be.

        They are numbered with four digits, or more where `count` needs them or another frame's name is `taken` already.
        """
        digits = max(4, len(str(count - 1)))
        while any(f"{self.name}_{index:0{digits}}" in taken for index in range(count)):
            digits += 1
        return tuple(replace(self, name=f"{self.name}_{index:0{digits}}", index=index) for index in range(count))


@dataclass(frozen=True)
class FrameLayout:
    """What the metadata says of how files are laid out.

    Parameters:
        harmonics: harmonic numbers h in rising order, such as (1, 2).
        frames: frames in each TIFF stack (`[layout] frames`); None where files say it themselves.
    """

    harmonics: tuple[int, ...]
    frames: int | None = None

    @property
    def planes(self) -> int:
        """Planes in one frame: SC1 and SC2 at every harmonic."""
        return CHANNELS * len(self.harmonics)

    @property
    def plane_names(self) -> tuple[str, ...]:
        """Names of the planes in the order of files and pages."""
        return tuple(plane_name(harmonic, channel) for harmonic in self.harmonics for channel in (1, 2))


class Frames(Protocol):
    """The frames of one open file."""

    @property
    def count(self) -> int:
        """Number of frames in the file."""

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of one frame, H C Y X."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the stored values, native byte order."""

    @property
    def container(self) -> Container:
        """Kind of file."""

    def read(self, index: int = 0, /) -> Stored:
        """Return frame `index` as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""


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
    return f"{shape[-1]} × {shape[-2]} {dtype.name}"
