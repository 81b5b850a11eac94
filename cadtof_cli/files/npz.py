"""Frames and named layers in NPZ files."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.errors import FrameError
from cadtof_cli.files.frames import CHANNELS, FrameLayout, Frames, NotAFrameError
from cadtof_cli.files.maps import STATUS, DepthMaps, MapHeader
from cadtof_cli.files.reading import damage_as_frame_error, require_regular

_FACT = "fact."


@contextmanager
def open_frames(path: Path, layout: FrameLayout, /) -> Iterator[Frames]:
    """Yield the frame in an NPZ file, one array per plane."""
    arrays = _arrays(path)
    lost = [name for name in layout.plane_names if name not in arrays]
    if len(lost) == layout.planes:
        raise NotAFrameError(f"{path}: found {', '.join(arrays)}, expected {', '.join(layout.plane_names)}")
    if lost:
        raise FrameError(f"{path}: found no {', '.join(lost)}")
    planes = np.stack([arrays[name] for name in layout.plane_names])
    stored = planes.reshape(len(layout.harmonics), CHANNELS, *planes.shape[1:])
    yield Frames(1, stored.shape, stored.dtype, lambda _index=0, /: stored)


def read_plane(path: Path, _layout: FrameLayout, /) -> Stored:
    """Return the one plane of a file, shape (Y, X)."""
    arrays = _arrays(path)
    if len(arrays) != 1:
        raise FrameError(f"{path}: found {', '.join(arrays)}, expected a single plane")
    return next(iter(arrays.values()))


def write_frame(path: Path, stored: Stored, /, *, layout: FrameLayout, compress: bool) -> None:
    """Write a frame, shape (H, C, Y, X), as arrays with the names H1.SC1, H1.SC2, …"""
    planes = stored.astype(np.float32).reshape(layout.planes, *stored.shape[2:])
    save = np.savez_compressed if compress else np.savez
    with path.open("wb") as file:
        save(file, **dict(zip(layout.plane_names, planes, strict=True)))


def write_maps(path: Path, maps: DepthMaps, /, *, header: MapHeader) -> Sequence[memoryview]:
    """Write the layers, the status bits and the facts."""
    layers = {name: maps.layer(name) for name in maps.names} | {STATUS: maps.status}
    with path.open("wb") as file:
        np.savez(file, **layers, **{f"{_FACT}{name}": np.array(text) for name, text in header.facts.items()})
    return ()


def read_facts(path: Path, /) -> dict[str, str]:
    """Return the facts about the maps, by name."""
    found = {name: str(array) for name, array in _arrays(path).items() if name.startswith(_FACT)}
    return {name.removeprefix(_FACT): text for name, text in found.items()}


def read_layers(path: Path, /) -> dict[str, NDArray[Any]]:
    """Return the layers by name, (Y, X) each."""
    return {name: array for name, array in _arrays(path).items() if not name.startswith(_FACT)}


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    with damage_as_frame_error(path, "NPZ"):
        require_regular(path)
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
