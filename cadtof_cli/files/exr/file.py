"""EXR files by way of the OpenEXR library: headers, pixels, and files written."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from cadtof_cli.errors import FrameError
from cadtof_cli.files.library_output import library_output
from cadtof_cli.files.named_planes import NamedPart
from cadtof_cli.files.reading import damage_as_frame_error, require_plausible_size
from cadtof_cli.records import dataclass

Compression = Literal["none", "zip", "pxr24"]

_COMPRESSIONS: dict[Compression, Any] = {
    "none": OpenEXR.NO_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "pxr24": OpenEXR.PXR24_COMPRESSION,
}

_SAMPLE_BYTES = 4
"""The most that one sample of an EXR channel takes; a header without pixels does not tell the type."""


@dataclass(frozen=True)
class ExrPart(NamedPart):
    """One part, as its header describes it."""

    shape: tuple[int, int]
    subsampled: tuple[str, ...]
    deep: bool


def read_parts(path: Path, /) -> list[ExrPart]:
    """Return what the headers of a file say, without its pixels.

    Raises:
        FrameError: the file cannot be read, is damaged, or promises more pixels than it can hold.
    """
    file = _opened(path, header_only=True)
    with damage_as_frame_error(path, "EXR"):
        parts = [_part(file.header(index)) for index in range(len(file.parts))]
        promised = sum(math.prod(part.shape) * len(part.channels) * _SAMPLE_BYTES for part in parts)
        require_plausible_size(path, promised, path.stat().st_size)
    return parts


def read_texts(path: Path, /) -> dict[str, str]:
    """Return the attributes of a file's first part that are text."""
    file = _opened(path, header_only=True)
    with damage_as_frame_error(path, "EXR"):
        return {name: value for name, value in file.header(0).items() if isinstance(value, str)}


def _part(header: dict[str, Any]) -> ExrPart:
    low, high = header["dataWindow"]
    width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
    channels = header["channels"]
    return ExrPart(
        name=header.get("name", ""),
        channels=tuple(channel.name for channel in channels),
        shape=(height, width),
        subsampled=tuple(channel.name for channel in channels if (channel.xSampling, channel.ySampling) != (1, 1)),
        deep=header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile),
    )


@contextmanager
def open_pixels(path: Path, places: Sequence[tuple[int, str]], /) -> Iterator[list[NDArray[Any]]]:
    """Yield the channels at these parts and names as they are stored; they live as long as the file is open.

    Raises:
        FrameError: the file cannot be read, is damaged, or lacks a channel.
    """
    with _opened(path, header_only=False) as file:
        with damage_as_frame_error(path, "EXR"):
            channels = [file.channels(index) for index in range(len(file.parts))]
            lost = [name for part, name in places if part >= len(channels) or name not in channels[part]]
            if lost:
                raise FrameError(f"{path}: damaged EXR: its header lists {', '.join(lost)}, found no pixels of it")
            planes = [channels[part][name].pixels for part, name in places]
        yield planes


def _opened(path: Path, *, header_only: bool) -> Any:
    with damage_as_frame_error(path, "EXR"), library_output() as said:
        # no threads of the library's own: its pool does not survive a fork
        file = OpenEXR.File(str(path), separate_channels=True, header_only=header_only, num_threads=0)
    if said:
        words = "; ".join(line.removeprefix(f"{path}: ").removeprefix("Warning: ") for line in said)
        raise FrameError(f"{path}: damaged EXR: {words}; expected a complete file, try copying it again")
    if not file.parts:
        raise FrameError(f"{path}: damaged EXR: found no parts, expected at least one")
    return file


def write_exr(path: Path, channels: Mapping[str, NDArray[Any]], /, *, compression: Compression, **header: str) -> None:
    """Write (Y, X) channels, float16, float32 or uint32, as one part of scan lines; OSError where that fails."""
    planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    described = {"compression": _COMPRESSIONS[compression], "type": OpenEXR.scanlineimage, **header}
    try:
        OpenEXR.File(described, planes, num_threads=0).write(str(path))
    except RuntimeError as error:
        # the library has no other kind of error, and its message names the file, which may be a temporary one
        raise OSError(str(error).rpartition('"')[2].strip(" .")) from error
    if not path.exists():
        raise OSError("the OpenEXR library wrote nothing")
