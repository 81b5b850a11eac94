"""Frames in EXR files: all planes in one part, or a part for each harmonic."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.exr.file import ExrPart, open_pixels, read_parts, write_exr
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, shape_text, single_frame
from cadtof_cli.files.named_planes import Place, voltage_places


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Read the frame in one EXR file, all of it on opening.

    Parameters:
        path: an EXR file, scan line or tiled, of any compression that the OpenEXR library reads; of a pyramid the
            full resolution is taken.
        layout: harmonics of the capture.

    Raises:
        NotAFrameError: no channel holds a voltage.
        FrameError: the file cannot be read, is damaged, or lacks a harmonic or channel.
    """
    parts = read_parts(path)
    planes = _planes(path, parts, voltage_places(parts, layout, where=str(path)))
    yield single_frame(planes.reshape(len(layout.harmonics), CHANNELS, *planes.shape[1:]))


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of an EXR file, shape (Y, X): its only channel, or luminance Y.

    Raises:
        FrameError: the file cannot be read, is damaged, or holds more than one plane.
    """
    parts = read_parts(path)
    places = [Place(index, name) for index, part in enumerate(parts) for name in part.channels]
    chosen = places if len(places) == 1 else [place for place in places if place.channel == "Y"]
    if len(chosen) != 1:
        found = ", ".join(place.channel for place in places)
        raise FrameError(f"{path}: found channels {found}, expected a single plane")
    plane: Stored = _planes(path, parts, chosen)[0]
    return plane


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write a frame, shape (H, C, Y, X), as float32 channels H1.SC1, H1.SC2, H2.SC1, …"""
    planes = stored.astype(np.float32).reshape(layout.planes, *stored.shape[2:])
    write_exr(path, dict(zip(layout.plane_names, planes, strict=True)), compression="zip" if compress else "none")


def _planes(path: Path, parts: Sequence[ExrPart], places: Sequence[Place]) -> Stored:
    """Return the channels at these places, shape (n, Y, X)."""
    shape = _common_shape(path, parts, places)
    with open_pixels(path, places) as planes:
        for place, plane in zip(places, planes, strict=True):
            if plane.shape != shape or plane.dtype != planes[0].dtype:
                raise FrameError(
                    f"{path}: {place.channel} is {shape_text(plane.shape, plane.dtype)},"
                    f" expected {shape_text(shape, planes[0].dtype)} as {places[0].channel} and the header"
                )
        return np.stack(planes)


def _common_shape(path: Path, parts: Sequence[ExrPart], places: Sequence[Place]) -> tuple[int, int]:
    """Return height and width of all the planes, after checking that they are plain images of one size."""
    shape = parts[places[0].part].shape
    for place in places:
        part = parts[place.part]
        if part.deep or place.channel in part.subsampled:
            found = "deep samples" if part.deep else "a subsampled channel"
            raise FrameError(f"{path}: {place.channel} is {found}, expected one value a pixel")
        if part.shape != shape:
            raise FrameError(
                f"{path}: {place.channel} of part {part.name!r} is {part.shape[1]} × {part.shape[0]} pixels,"
                f" expected {shape[1]} × {shape[0]} as {places[0].channel} of the first part"
            )
    return shape
