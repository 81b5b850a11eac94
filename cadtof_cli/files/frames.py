"""The order of a frame's planes in files, and the record of an open file's frames that every reader returns."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Stored, plane_names
from cadtof_cli.errors import FrameError
from cadtof_cli.records import dataclass
from cadtof_cli.units import size_text

CHANNELS = 2
"""Channels per harmonic: SC1, the cosine, and SC2, the sine."""

SAMPLE_TYPES = ("float16", "float32", "float64", "int16", "int32", "uint16", "uint32", "uint8")
"""Types that the stored values of a frame may have."""


class NotAFrameError(FrameError):
    """An undamaged file that holds something other than voltages, such as a map; a run reports it as skipped."""


@dataclass(frozen=True)
class RawLayout:
    """What a raw dump holds, as `[layout.raw]` says.

    `dtype` is numpy's name of the type, `shape` is (…, Y, X), `offset_bytes` is the number of bytes before the first
    value.
    """

    dtype: str
    shape: tuple[int, ...]
    offset_bytes: int = 0


@dataclass(frozen=True)
class FrameLayout:
    """How the planes of frames are laid out in files, as far as the metadata says it.

    Attributes:
        harmonics: harmonic numbers h in rising order, such as (1, 2).
        frames: number of frames in each stack (`[layout] frames`); None: not given, the files say it themselves.
        raw: what raw dumps hold; None: not given.
        period_ns: the longest modulation period, with which frequencies in names are compared; None: they are not compared.
    """

    harmonics: tuple[int, ...]
    frames: int | None = None
    raw: RawLayout | None = None
    period_ns: float | None = None

    @property
    def planes(self) -> int:
        """Number of planes in one frame: SC1 and SC2 of every harmonic."""
        return CHANNELS * len(self.harmonics)

    @property
    def plane_names(self) -> tuple[str, ...]:
        """Names of the planes in the order in which files hold them."""
        return plane_names(self.harmonics)


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of one open file.

    Attributes:
        count: number of frames.
        shape: shape of one frame, (H, C, Y, X).
        dtype: type of the stored values, native byte order.
        read: returns the stored values of the frame with this index, shape (H, C, Y, X), C-contiguous, native byte order.
        read_like: a quick way to read the single frame of another file, if all bytes around its pixels are the same as
            in this file. Such a file needs no checks, because this file passed them. The function returns None for any
            other file, and raises OSError if the file cannot be read. None: the reader has no such function.
    """

    count: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[int], Stored]
    read_like: Callable[[Path], Stored | None] | None = None

    @classmethod
    def of(cls, stored: Stored, /, *, read_like: Callable[[Path], Stored | None] | None = None) -> "Frames":
        """Return the one frame that has been read already: its stored values, shape (H, C, Y, X)."""
        return cls(1, stored.shape, stored.dtype, (stored,).__getitem__, read_like)


def harmonic_labels(harmonics: tuple[int, ...], found: Collection[int]) -> tuple[int, ...]:
    """Return the labels by which the files of a capture name its harmonics, if they name those in `found`.

    Usually these are the harmonic numbers h. They are the places 1, 2, … in the order of the harmonics if all places
    are in `found` but not all numbers are. Example: if a capture has the harmonics (1, 3) and its files say H1 and H2,
    then H2 is the second harmonic, h = 3.
    """
    places = tuple(range(1, len(harmonics) + 1))
    if not set(harmonics) <= set(found) and set(places) <= set(found):
        return places
    return harmonics


def shape_text(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    """Return size and type of an image for a message, such as `320 × 240 uint16`; `shape` is (…, Y, X)."""
    return f"{size_text(shape[-2:])} {dtype.name}"
