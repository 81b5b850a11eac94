"""Frames in EXR files: all planes in one part, or a part for each harmonic."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.damage import damage_as_frame_error, require_plausible_size
from cadtof_cli.files.exr.channels import PartChannels, Place, voltage_places
from cadtof_cli.files.exr.library_output import library_output
from cadtof_cli.files.frames import Container, FrameLayout, shape_text

_SAMPLE_BYTES = 4
"""The most that one sample of an EXR channel takes; a header without pixels does not tell the type."""


@dataclass(frozen=True)
class _Part:
    """One part, as its header describes it."""

    channels: PartChannels
    shape: tuple[int, int]
    subsampled: tuple[str, ...]
    deep: bool


class ExrFrames:
    """The frame in one EXR file, all of it read on opening.

    Parameters:
        path: an EXR file, scan line or tiled, of any compression that the OpenEXR library reads; of a pyramid the
            full resolution is taken.
        layout: harmonics of the capture.

    Raises:
        NotAFrameError: no channel holds a voltage.
        FrameError: the file cannot be read, is damaged, or lacks a harmonic or channel.
    """

    container: Container = "exr"
    count = 1

    def __init__(self, path: Path, layout: FrameLayout) -> None:
        parts = _part_headers(path)
        places = voltage_places([part.channels for part in parts], layout, where=str(path))
        pixels = _pixels(path, parts, places)
        height, width = pixels.shape[1:]
        self.shape = (len(layout.harmonics), len(places) // len(layout.harmonics), height, width)
        self.dtype: np.dtype[Any] = pixels.dtype
        self._frame: Stored = pixels.reshape(self.shape)

    def read(self, _index: int = 0, /) -> Stored:
        """Return the frame as it is stored: shape (H, C, Y, X), C-contiguous, native byte order."""
        return self._frame


def read_plane(path: Path) -> Stored:
    """Return the one plane of an EXR file, shape (Y, X): its only channel, or luminance Y.

    Raises:
        FrameError: the file cannot be read, is damaged, or holds more than one plane.
    """
    parts = _part_headers(path)
    names = [(index, name) for index, part in enumerate(parts) for name in part.channels.names]
    chosen = names if len(names) == 1 else [(index, name) for index, name in names if name == "Y"]
    if len(chosen) != 1:
        found = ", ".join(name for _, name in names)
        raise FrameError(f"{path}: found channels {found}, expected a single plane")
    plane: Stored = _pixels(path, parts, [Place(*chosen[0])])[0]
    return plane


def _part_headers(path: Path) -> list[_Part]:
    file = _file(path, header_only=True)
    with damage_as_frame_error(path, "EXR"):
        parts = [_part(file.header(index)) for index in range(len(file.parts))]
        promised = sum(math.prod(part.shape) * len(part.channels.names) * _SAMPLE_BYTES for part in parts)
        require_plausible_size(path, promised, path.stat().st_size)
    return parts


def _part(header: dict[str, Any]) -> _Part:
    low, high = header["dataWindow"]
    width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
    channels = header["channels"]
    return _Part(
        channels=PartChannels(header.get("name", ""), tuple(channel.name for channel in channels)),
        shape=(height, width),
        subsampled=tuple(channel.name for channel in channels if (channel.xSampling, channel.ySampling) != (1, 1)),
        deep=header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile),
    )


def _file(path: Path, *, header_only: bool) -> Any:
    with damage_as_frame_error(path, "EXR"), library_output() as said:
        # no threads of the library's own: its pool does not survive a fork
        file = OpenEXR.File(str(path), separate_channels=True, header_only=header_only, num_threads=0)
    if said:
        words = "; ".join(line.removeprefix(f"{path}: ") for line in said)
        raise FrameError(f"{path}: damaged EXR: {words}; expected a complete file, try copying it again")
    if not file.parts:
        raise FrameError(f"{path}: damaged EXR: found no parts, expected at least one")
    return file


def _pixels(path: Path, parts: Sequence[_Part], places: Sequence[Place]) -> Stored:
    """Return the channels at these places, shape (n, Y, X)."""
    shape = _common_shape(path, parts, places)
    with _file(path, header_only=False) as file, damage_as_frame_error(path, "EXR"):
        channels = [file.channels(index) for index in range(len(file.parts))]
        lost = [p.channel for p in places if p.part >= len(channels) or p.channel not in channels[p.part]]
        if lost:
            raise FrameError(f"{path}: damaged EXR: its header lists {', '.join(lost)}, found no pixels of it")
        planes = [channels[place.part][place.channel].pixels for place in places]
        for place, plane in zip(places, planes, strict=True):
            if plane.shape != shape or plane.dtype != planes[0].dtype:
                raise FrameError(
                    f"{path}: {place.channel} is {shape_text(plane.shape, plane.dtype)},"
                    f" expected {shape_text(shape, planes[0].dtype)} as {places[0].channel} and the header"
                )
        # the library's arrays live as long as its file, so they are copied out of it
        return np.stack(planes)


def _common_shape(path: Path, parts: Sequence[_Part], places: Sequence[Place]) -> tuple[int, int]:
    """Return height and width of all the planes, after checking that they are plain images of one size."""
    shape = parts[places[0].part].shape
    for place in places:
        part = parts[place.part]
        if part.deep or place.channel in part.subsampled:
            found = "deep samples" if part.deep else "a subsampled channel"
            raise FrameError(f"{path}: {place.channel} is {found}, expected one value a pixel")
        if part.shape != shape:
            raise FrameError(
                f"{path}: {place.channel} of part {part.channels.name!r} is {part.shape[1]} × {part.shape[0]} pixels,"
                f" expected {shape[1]} × {shape[0]} as {places[0].channel} of the first part"
            )
    return shape
