"""The records of a frame's maps and of the header of their file, and the names of layers."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float32, Status
from cadtof_cli.errors import FrameError
from cadtof_cli.files.system import BLOCK_BYTES
from cadtof_cli.records import dataclass
from cadtof_cli.units import printable
from cadtof_cli.version import __version__

STATUS = "status"

SOFTWARE = f"cadtof {__version__}"
"""Name and version of the software that made the maps, for headers."""

SOURCE = "source"
"""Name of the fact that says which frame was recorded; all other facts are the same for all frames of a run."""

_MAP_LAYER = rf"(direct|mpi)\.\w+|confidence|{STATUS}"


class NotMapsError(FrameError):
    """An undamaged file without named layers, such as a recorded frame."""


class DamagedMapsError(FrameError):
    """Maps whose values another program has changed, so that they are maps no more."""


@dataclass(frozen=True)
class DepthMaps:
    """The maps of one frame.

    Attributes:
        names: names of the layers.
        pages: float32 (layer, Y, X), in the order of `names`, and one page more at the end. The TIFF writer fills this
            last page with the status bits.
        status: the status bits, uint32 (Y, X).
        image: memory in which a writer can assemble a whole file without a copy. It is one disk block, then `pages`,
            then two blocks, and begins at a multiple of the block size. None: `pages` lies somewhere else.
    """

    names: tuple[str, ...]
    pages: Float32
    status: Status
    image: memoryview | None = field(default=None, compare=False, repr=False)

    def __reduce__(self) -> tuple[type["DepthMaps"], tuple[Any, ...]]:
        """Return how pickle makes a copy in another process; the copy has no `image`."""
        return DepthMaps, (self.names, self.pages, self.status)

    @classmethod
    def empty(cls, names: tuple[str, ...], size: tuple[int, int], /) -> "DepthMaps":
        """Return uninitialised maps of `size` (Y, X), whose pages lie in an `image`, so that writing needs no copy."""
        shape = (len(names) + 1, *size)
        pages_bytes = 4 * math.prod(shape)
        memory = np.empty(pages_bytes + 4 * BLOCK_BYTES, np.uint8)
        # not `memory.ctypes.data`, which loads ctypes
        begin = -memory.__array_interface__["data"][0] % BLOCK_BYTES
        image = memory[begin : begin + pages_bytes + 3 * BLOCK_BYTES]
        pages = image[BLOCK_BYTES : BLOCK_BYTES + pages_bytes].view(np.float32).reshape(shape)
        return cls(names, pages, np.empty(size, np.uint32), image.data)

    @property
    def values(self) -> Float32:
        """The layers without the last page, float32 (layer, Y, X)."""
        return self.pages[:-1]

    def layer(self, name: str, /) -> Float32:
        """Return the layer of this name, float32 (Y, X)."""
        plane: Float32 = self.pages[self.names.index(name)]
        return plane

    def cropped(self, roi: tuple[int, int, int, int], /) -> "DepthMaps":
        """Return a copy of the columns X0 ≤ x < X1 and rows Y0 ≤ y < Y1; `roi` is (X0, Y0, X1, Y1)."""
        x0, y0, x1, y1 = roi
        pages, status = self.pages[:, y0:y1, x0:x1], self.status[y0:y1, x0:x1]
        return DepthMaps(self.names, np.ascontiguousarray(pages), np.ascontiguousarray(status))


@dataclass(frozen=True)
class MapHeader:
    """The header of a map file.

    Attributes:
        units: unit of each layer by its name; empty text for pure numbers.
        facts: texts by name, such as the kind of depth, the periods, the recorded frame and the digest of a
            calibration. All their characters are printable; a header holds no bytes that are not UTF-8.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)

    def of_frame(self, source: str, /) -> "MapHeader":
        """Return this header with one more fact: the name of the recorded frame."""
        return MapHeader(self.units, {**self.facts, SOURCE: printable(source)})


def region_of(said: str, /) -> tuple[int, int, int, int] | None:
    """Return the part X0, Y0, X1, Y1 of the recorded frame that the fact `roi` of a map names; None: it names none."""
    if not re.fullmatch(r"\d{1,9}(,\d{1,9}){3}", said):
        return None
    x0, y0, x1, y1 = map(int, said.split(","))
    return x0, y0, x1, y1


def is_map_layer(name: str, /) -> bool:
    """Return whether a channel with this name belongs to a map and not to a frame."""
    return re.fullmatch(_MAP_LAYER, name) is not None


def require_different_names(path: Path, names: Sequence[str], /) -> None:
    """Raise FrameError if two layers of a file have the same name, so that it is not known which of them is meant."""
    repeated = next((name for name, count in Counter(names).items() if count > 1), None)
    if repeated is not None:
        raise FrameError(f"{path}: found {repeated} twice, expected it once")
