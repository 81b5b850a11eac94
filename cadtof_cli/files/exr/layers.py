"""Named layers as EXR channels: maps with their status bits, truth, and the maps of a calibration."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cadtof_cli.files.exr.file import open_pixels, read_parts, read_texts, write_exr
from cadtof_cli.files.maps import STATUS, DepthMaps, MapHeader

_PREFIX = "cadtof."
"""How the attributes begin that say something about the maps."""


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader) -> Sequence[memoryview]:
    """Write maps as float channels, and the status bits as one of unsigned integers; what is said about them as attributes.

    They are not compressed: compressing noise takes ten times as long as resolving it.
    """
    channels = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    units = {f"{_PREFIX}unit.{name}": unit for name, unit in header.units.items() if unit}
    facts = {name if name == "software" else f"{_PREFIX}{name}": text for name, text in header.facts.items()}
    write_exr(path, channels, compression="none", **facts, **units)
    return ()


def read_facts(path: Path, /) -> dict[str, str]:
    """Return what the attributes of a file say about its maps."""
    facts = {name.removeprefix(_PREFIX): text for name, text in read_texts(path).items() if name.startswith(_PREFIX)}
    return {name: text for name, text in facts.items() if not name.startswith("unit.")}


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the channels of a file's first part by name, as they are stored."""
    names = read_parts(path)[0].channels
    with open_pixels(path, [(0, name) for name in names]) as planes:
        return {name: plane.copy() for name, plane in zip(names, planes, strict=True)}
