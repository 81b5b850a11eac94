"""The record of a frame's maps, and what the header of their file says."""

import math
import re
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float32, Status
from cadtof_cli.errors import FrameError
from cadtof_cli.files.system import BLOCK_BYTES
from cadtof_cli.records import dataclass
from cadtof_cli.version import __version__

STATUS = "status"

SOFTWARE = f"cadtof {__version__}"
"""What headers say made the maps."""

SOURCE = "source"
"""The fact that names the recorded frame: the only one that differs from frame to frame."""

_MAP_LAYER = rf"(direct|mpi)\.\w+|confidence|{STATUS}"


class NotMapsError(FrameError):
    """A sound file without named layers, such as a recorded frame."""


@dataclass(frozen=True)
class DepthMaps:
    """The maps of one frame.

    `pages` is float32 (layer, Y, X) in the order of `names`, with one page more at its end, which the TIFF writer keeps
    for the `status` bits, uint32 (Y, X). `image`, where the pages lie in it, is one disk block, the pages, and two blocks more,
    aligned to blocks: a writer can put together a whole file there.
    """

    names: tuple[str, ...]
    pages: Float32
    status: Status
    image: memoryview | None = field(default=None, compare=False, repr=False)

    def __reduce__(self) -> tuple[type["DepthMaps"], tuple[Any, ...]]:
        """Return how another process makes its own, whose pages lie elsewhere."""
        return DepthMaps, (self.names, self.pages, self.status)

    @classmethod
    def empty(cls, names: tuple[str, ...], size: tuple[int, int], /) -> "DepthMaps":
        """Return uninitialised maps, (Y, X) each, in an image of their own, so that writing needs no copy."""
        shape = (len(names) + 1, *size)
        pages_bytes = 4 * math.prod(shape)
        memory = np.empty(pages_bytes + 4 * BLOCK_BYTES, np.uint8)
        # numpy's usual way to tell where values begin loads ctypes
        begin = -memory.__array_interface__["data"][0] % BLOCK_BYTES
        image = memory[begin : begin + pages_bytes + 3 * BLOCK_BYTES]
        pages = image[BLOCK_BYTES : BLOCK_BYTES + pages_bytes].view(np.float32).reshape(shape)
        return cls(names, pages, np.empty(size, np.uint32), image.data)

    @property
    def values(self) -> Float32:
        """The layers, float32 (layer, Y, X)."""
        return self.pages[:-1]

    def layer(self, name: str, /) -> Float32:
        """Return one float32 layer, (Y, X)."""
        plane: Float32 = self.pages[self.names.index(name)]
        return plane

    def cropped(self, roi: tuple[int, int, int, int], /) -> "DepthMaps":
        """Return the maps of columns X0 ≤ x < X1 and rows Y0 ≤ y < Y1."""
        x0, y0, x1, y1 = roi
        pages, status = self.pages[:, y0:y1, x0:x1], self.status[y0:y1, x0:x1]
        return DepthMaps(self.names, np.ascontiguousarray(pages), np.ascontiguousarray(status))


@dataclass(frozen=True)
class MapHeader:
    """What the header of a map file says: the unit of each layer, empty for pure numbers, and facts by name.

    Facts are text, such as the kind of depth, the periods, the recorded frame and the digest of a calibration.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)

    def of_frame(self, source: str, /) -> "MapHeader":
        """Return the header of the maps of one recorded frame.

        What no header can hold of its name, such as bytes that are not UTF-8, is escaped.
        """
        if not source.isprintable():
            source = "".join(one if one.isprintable() else repr(one)[1:-1] for one in source)
        return MapHeader(self.units, {**self.facts, SOURCE: source})


def is_map_layer(name: str, /) -> bool:
    """Return whether a channel of this name belongs to a map, not to a frame."""
    return re.fullmatch(_MAP_LAYER, name) is not None
