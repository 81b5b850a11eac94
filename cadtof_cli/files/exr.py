"""EXR files, read and written by the OpenEXR library: recorded frames and named layers.

A frame lies in one part, or in one part per harmonic. Named layers are maps with their status bits, truth, and the maps
of a calibration.
"""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.exr_planes import NamedPart, Place, places_in, voltage_places
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, shape_text
from cadtof_cli.files.library_output import library_output
from cadtof_cli.files.maps import SOFTWARE, STATUS, DepthMaps, MapHeader, require_different_names
from cadtof_cli.files.reading import damage_as_frame_error, in_brief, read_through, require_plausible_size
from cadtof_cli.files.system import codes_of_the_system
from cadtof_cli.records import dataclass
from cadtof_cli.units import size_text

Compression = Literal["none", "zip", "pxr24"]

_COMPRESSIONS: dict[Compression, Any] = {
    "none": OpenEXR.NO_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "pxr24": OpenEXR.PXR24_COMPRESSION,
}

_PREFIX = "cadtof."
"""Prefix of the attributes that hold facts about the maps."""

_LOSSY_FOR = {
    "B44": ("float16",),
    "B44A": ("float16",),
    "PXR24": ("float32",),
    "DWAA": ("float16", "float32"),
    "DWAB": ("float16", "float32"),
}
"""The sample types whose values each lossy compression changes."""

_PICTURE_CHANNELS = frozenset({"R", "G", "B", "Y", "RY", "BY"})
"""Last parts of the names of the channels that DWAA and DWAB change; they keep all others."""

_SAMPLE_BYTES = 4
"""The most bytes that a sample of an EXR channel takes; a header that is read without pixels does not tell the type."""


@dataclass(frozen=True)
class ExrPart(NamedPart):
    """One part of an EXR file, as its header describes it: sizes are rows and columns, positions are column and row."""

    shape: tuple[int, int]
    subsampled: tuple[str, ...]
    deep: bool
    origin: tuple[int, int]
    tile: tuple[int, int]
    compression: str


def read_parts(path: Path, /) -> list[ExrPart]:
    """Return the parts of a file as their headers describe them; no pixels are read."""
    file = _opened(path, header_only=True)
    with damage_as_frame_error(path, "EXR"):
        parts = [_part(file.header(index)) for index in range(len(file.parts))]
        # the library allocates the image and one whole tile, which may be larger than the image
        samples = sum((math.prod(part.shape) + math.prod(part.tile)) * len(part.channels) for part in parts)
        require_plausible_size(path, samples * _SAMPLE_BYTES, path.stat().st_size)
    return parts


def lossy_compression(path: Path, dtype: np.dtype[Any], /) -> str | None:
    """Return the name of the file's compression if it changes values of type `dtype`, else None."""
    for part in read_parts(path):
        changed = {name.rpartition(".")[2].upper() for name in part.channels} & _PICTURE_CHANNELS
        if dtype.name in _LOSSY_FOR.get(part.compression, ()) and (changed or not part.compression.startswith("DWA")):
            return part.compression
    return None


def _part(header: dict[str, Any]) -> ExrPart:
    low, high = header["dataWindow"]
    width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
    channels, tiles = header["channels"], header.get("tiles")
    return ExrPart(
        name=header.get("name", ""),
        channels=tuple(channel.name for channel in channels),
        shape=(height, width),
        subsampled=tuple(channel.name for channel in channels if (channel.xSampling, channel.ySampling) != (1, 1)),
        deep=header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile),
        origin=(int(low[0]), int(low[1])),
        tile=(tiles.ySize, tiles.xSize) if tiles else (0, 0),
        compression=str(header["compression"].name).removesuffix("_COMPRESSION"),
    )


def _pixels(path: Path, places: Sequence[Place]) -> list[NDArray[Any]]:
    """Return the channels at these places as they are stored; each has memory of its own, which outlives the file."""
    with _opened(path, header_only=False) as file, damage_as_frame_error(path, "EXR"):
        channels = [file.channels(index) for index in range(len(file.parts))]
        lost = [name for part, name in places if part >= len(channels) or name not in channels[part]]
        if lost:
            raise FrameError(f"{path}: damaged EXR: its header lists {', '.join(lost)}, found no pixels of it")
        return [channels[part][name].pixels for part, name in places]


def _opened(path: Path, *, header_only: bool) -> Any:
    with damage_as_frame_error(path, "EXR"):
        with library_output() as printed:
            try:
                # the library must start no threads, because its thread pool does not survive a fork
                with _as_the_library_takes_it(path, "rb") as place:
                    file = OpenEXR.File(place, separate_channels=True, header_only=header_only, num_threads=0)
            except Exception:
                # the library raises the same error for a damaged file and for one that cannot be opened because too
                # many files are open; reading the file ourselves raises the system's own error
                read_through(path)
                raise
        if printed:
            # the library keeps the file open as long as its object lives, and a kept error keeps the objects of this call
            del file
            read_through(path)
            named = (line.removeprefix(f"{path}: ").removeprefix("<python_buffer>: ") for line in printed)
            words = in_brief(line.removeprefix("Warning: ") for line in named)
            raise FrameError(f"{path}: damaged EXR: {words}; expected a complete file, try copying it again")
        if not file.parts:
            raise FrameError(f"{path}: damaged EXR: found no parts, expected at least one")
        return file


@contextmanager
def _as_the_library_takes_it(path: Path, mode: Literal["rb", "wb"]) -> Iterator[str | BinaryIO]:
    """Yield a file's path or, if the disk does not have it as UTF-8, the open file: the library takes no other paths."""
    if str(path).encode(errors="replace") == os.fsencode(path):
        yield str(path)
    else:
        with path.open(mode) as file:
            yield file


def write_exr(path: Path, channels: Mapping[str, NDArray[Any]], /, *, compression: Compression, **header: str) -> None:
    """Write channels, (Y, X) each, float16, float32 or uint32, as one scan-line part; raises OSError if that fails."""
    planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    described = {"compression": _COMPRESSIONS[compression], "type": OpenEXR.scanlineimage, **header}
    with codes_of_the_system(path, sum(plane.nbytes for plane in planes.values())):
        try:
            with _as_the_library_takes_it(path, "wb") as place:
                OpenEXR.File(described, planes, num_threads=0).write(place)
        except RuntimeError as error:
            # the library raises only this kind of error; its message names the file, which may be a temporary one
            raise OSError(str(error).rpartition('"')[2].strip(" .")) from error
    if not path.exists():
        raise OSError("the OpenEXR library wrote nothing")


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Yield the frame in an EXR file; all of it is read when the file is opened.

    The file is scan-line or tiled, of any compression that the OpenEXR library reads. From a pyramid of resolutions,
    the full resolution is read.
    """
    parts = read_parts(path)
    planes = _planes(path, parts, voltage_places(parts, layout, where=str(path)))
    yield Frames.of(planes.reshape(len(layout.harmonics), CHANNELS, *planes.shape[1:]))


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of an EXR file, shape (Y, X): its only channel, or its channel Y (luminance)."""
    parts = read_parts(path)
    places = places_in(parts)
    chosen = places if len(places) == 1 else [place for place in places if place.channel == "Y"]
    if len(chosen) != 1:
        found = ", ".join(place.channel for place in places)
        raise FrameError(f"{path}: found channels {found}, expected a single plane")
    plane: Stored = _planes(path, parts, chosen)[0]
    return plane


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write a frame, shape (H, C, Y, X), as float32 channels with the names H1.SC1, H1.SC2, H2.SC1, …"""
    planes = stored.astype(np.float32).reshape(layout.planes, *stored.shape[2:])
    write_exr(path, dict(zip(layout.plane_names, planes, strict=True)), compression="zip" if compress else "none")


def _planes(path: Path, parts: Sequence[ExrPart], places: Sequence[Place]) -> Stored:
    """Return the channels at these places, shape (n, Y, X)."""
    shape = _common_shape(path, parts, places)
    planes = _pixels(path, places)
    for place, plane in zip(places, planes, strict=True):
        if plane.shape != shape or plane.dtype != planes[0].dtype:
            raise FrameError(
                f"{path}: {place.channel} is {shape_text(plane.shape, plane.dtype)},"
                f" expected {shape_text(shape, planes[0].dtype)} as {places[0].channel} and the header"
            )
    return np.stack(planes)


def _common_shape(path: Path, parts: Sequence[ExrPart], places: Sequence[Place]) -> tuple[int, int]:
    """Return the height and width of all planes; refuse planes that are no plain images of one size and origin."""
    shape, origin = parts[places[0].part].shape, parts[places[0].part].origin
    for place in places:
        part = parts[place.part]
        if part.deep or place.channel in part.subsampled:
            found = "deep samples" if part.deep else "a subsampled channel"
            raise FrameError(f"{path}: {place.channel} is {found}, expected one value a pixel")
        if part.shape != shape:
            raise FrameError(
                f"{path}: {place.channel} of part {part.name!r} is {size_text(part.shape)} pixels,"
                f" expected {size_text(shape)} as {places[0].channel} of the first part"
            )
        if part.origin != origin:
            raise FrameError(
                f"{path}: {place.channel} of part {part.name!r} begins at pixel {part.origin[0]}, {part.origin[1]} (its data"
                f" window), expected {origin[0]}, {origin[1]} as {places[0].channel} of the first part"
            )
    return shape


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader) -> Sequence[memoryview]:
    """Write the layers as float32 channels, the status bits as a uint32 channel, and units and facts as attributes.

    The file is not compressed, because compressing noise takes ten times as long as resolving it.
    """
    channels = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    units = {f"{_PREFIX}unit.{name}": unit for name, unit in header.units.items() if unit}
    facts = {f"{_PREFIX}{name}": text for name, text in header.facts.items()}
    write_exr(path, channels, compression="none", software=SOFTWARE, **facts, **units)
    return ()


def read_facts(path: Path, /) -> dict[str, str]:
    """Return the facts about the maps that the attributes of the file's first part hold, by name."""
    file = _opened(path, header_only=True)
    with damage_as_frame_error(path, "EXR"):
        texts = {name: value for name, value in file.header(0).items() if isinstance(value, str)}
    facts = {name.removeprefix(_PREFIX): text for name, text in texts.items() if name.startswith(_PREFIX)}
    return {name: text for name, text in facts.items() if not name.startswith("unit.")}


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the channels of all parts by name, (Y, X) each, as they are stored."""
    parts = read_parts(path)
    places = places_in(parts)
    names = [place.channel for place in places]
    require_different_names(path, names)
    _common_shape(path, parts, places)
    return dict(zip(names, _pixels(path, places), strict=True))
