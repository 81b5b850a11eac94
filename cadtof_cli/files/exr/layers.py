"""Named layers as EXR channels: maps with their status bits, truth, and the maps of a calibration."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cadtof_cli.files.exr.file import open_pixels, read_parts, write_exr
from cadtof_cli.files.maps import STATUS, DepthMaps


def write_maps(path: Path, maps: DepthMaps, /, *, software: str) -> None:
    """Write maps as float channels, and the status bits as one of unsigned integers.

    They are not compressed: compressing noise takes ten times as long as resolving it.
    """
    channels = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    write_exr(path, channels, compression="none", software=software)


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the channels of a file's first part by name, as they are stored."""
    names = read_parts(path)[0].channels
    with open_pixels(path, [(0, name) for name in names]) as planes:
        return {name: plane.copy() for name, plane in zip(names, planes, strict=True)}
