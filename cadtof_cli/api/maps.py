"""Depth maps for Python: named layers as arrays, from `resolve` or from a file."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Status
from cadtof_cli.errors import CaptureError, SettingsError
from cadtof_cli.files.layers import read_facts, read_layers
from cadtof_cli.files.maps import STATUS, region_of
from cadtof_cli.maps.layers import layer_unit
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.run_folder import read_run

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False)
class Maps(Mapping[str, NDArray[Any]]):
    """The layers of one frame by name, such as `maps["direct.depth"]`: float32 (Y, X) in m or V, NaN if there is no answer.

    The layer `status` is uint32 (Y, X). It holds the bits of the table in the README.

    Attributes:
        layers: the layers by name.
        facts: the facts in the header of the maps: kind of depth, periods, recorded frame, digest of the calibration.
    """

    layers: Mapping[str, NDArray[Any]]
    facts: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self.layers[name]
        except KeyError:
            raise KeyError(f"{name}: found layers {', '.join(self.layers)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.layers)

    def __len__(self) -> int:
        return len(self.layers)

    def __repr__(self) -> str:
        height, width = self.shape
        return f"<Maps of {width} × {height} pixels: {', '.join(self.layers)}>"

    @property
    def shape(self) -> tuple[int, int]:
        """The size of the maps, (Y, X)."""
        height, width = next(iter(self.layers.values())).shape
        return height, width

    @property
    def status(self) -> Status:
        """The status bits of every pixel, uint32 (Y, X)."""
        bits: Status = self[STATUS]
        return bits

    @property
    def units(self) -> dict[str, str]:
        """The unit of each layer; an empty text for a pure number."""
        return {name: layer_unit(name) for name in self.layers}

    def to_xarray(self) -> "xarray.Dataset":
        """Return the layers as variables over y and x, with units.

        The variable `status` has the attributes flag_masks and flag_meanings of the CF conventions. The coordinates count the
        pixels of the recorded frame, also in maps of a part of it: xarray matches data by them.

        Raises:
            SettingsError: xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise SettingsError("to_xarray needs xarray: pip install 'cadtof[xarray]'") from error
        units = self.units
        variables: dict[str, tuple[tuple[str, str], NDArray[Any], dict[str, Any]]] = {
            name: (("y", "x"), plane, {"units": units[name]} if units[name] else {})
            for name, plane in self.layers.items()
        }
        if STATUS in self.layers:
            masks = np.array([int(bit) for bit in StatusBit], np.uint32)
            meanings = " ".join(str(bit.name).lower() for bit in StatusBit)
            variables[STATUS] = (("y", "x"), self.status, {"flag_masks": masks, "flag_meanings": meanings})
        height, width = self.shape
        left, top = (region_of(self.facts.get("roi", "")) or (0, 0))[:2]
        places = {"y": np.arange(top, top + height), "x": np.arange(left, left + width)}
        return xarray.Dataset(variables, coords=places, attrs=dict(self.facts))


def read_maps(path: str | os.PathLike[str], /) -> Maps:
    """Return the layers of a file of maps or truth. A folder that holds only one such file stands for it.

    Raises:
        CaptureError: there is no such file, or the folder holds several.
        FrameError: the file cannot be read, or holds no named layers.
    """
    files = read_run(Path(path)).require_maps()
    if len(files) > 1:
        raise CaptureError(
            f"{path}: found {len(files)} files that may hold maps, expected one; name one of them, such as {files[-1]}"
        )
    layers = {name: np.ascontiguousarray(plane) for name, plane in read_layers(files[0]).items()}
    return Maps(layers, read_facts(files[0]))
