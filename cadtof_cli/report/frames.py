"""The layers of a frame as a page holds them: codes of all pixels, or of every n-th row and column; the plan which frames fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.files.maps import STATUS
from cadtof_cli.maps.layers import layer_unit
from cadtof_cli.report.codes import Scale, coded_bits, coded_values, packed

FIRST_PHASOR = "first phasor"
TRUTH = "truth"
"""Names of layers of depths that are in no file of maps."""

ERROR = "error"
FIRST_PHASOR_ERROR = "error of first phasor"
"""Names of the errors of the direct depth and of the first phasor. The page computes them (`page/decode.js`)."""

Planes = Mapping[str, NDArray[Any]]
"""Layers by name, (Y, X) each: the layers of a map, and `FIRST_PHASOR` if the recorded frame still exists."""


@dataclass(frozen=True)
class EmbeddedLayer:
    """A layer in a page: its name, its unit, and the scale of its codes."""

    name: str
    unit: str
    scale: Scale

    def as_json(self) -> dict[str, Any]:
        """Return the layer in the form that the scripts of the page read."""
        return {"name": self.name, "unit": self.unit, **self.scale.as_json()}


@dataclass(frozen=True)
class EmbeddedFrame:
    """The layers of a frame in a page.

    Attributes:
        shape: rows and columns of the whole frame.
        step: the page holds every step-th row and column, see `sampled`.
        layers: in the order of their codes.
        data: the codes, as text.
    """

    shape: tuple[int, int]
    step: int
    layers: tuple[EmbeddedLayer, ...]
    data: str

    def as_json(self) -> dict[str, Any]:
        """Return the frame in the form that the scripts of the page read, without the data."""
        layers = [layer.as_json() for layer in self.layers]
        return {"height": self.shape[0], "width": self.shape[1], "step": self.step, "layers": layers}


def sampled(plane: NDArray[Any], step: int, /) -> NDArray[Any]:
    """Return every step-th row and column of a plane (Y, X). The first of them are half a step from the edge."""
    row, column = (min(step // 2, (size - 1) // 2) for size in plane.shape)
    return plane[row::step, column::step]


def embedded_frame(planes: Planes, /, *, step: int) -> EmbeddedFrame:
    """Return the layers of a frame as a page holds them, with every step-th row and column."""
    coded = [_coded(name, sampled(plane, step)) for name, plane in planes.items()]
    shape = next(iter(planes.values())).shape
    layers = tuple(layer for _, layer in coded)
    return EmbeddedFrame((shape[0], shape[1]), step, layers, packed([codes for codes, _ in coded]))


def _coded(name: str, plane: NDArray[Any]) -> tuple[NDArray[np.uint16], EmbeddedLayer]:
    depth = name in {FIRST_PHASOR, TRUTH} or name.endswith(".depth")
    codes, scale = coded_bits(plane) if name == STATUS else coded_values(plane, is_depth=depth)
    return codes, EmbeddedLayer(name, "m" if depth else layer_unit(name), scale)


@dataclass(frozen=True)
class PagePlan:
    """Which frames of a run a page shows, and how many pixels of each.

    Attributes:
        shown: places in the run of the frames that the page shows.
        whole: those that keep all pixels, by their places among the shown frames.
        step: all other shown frames keep every step-th row and column.
        thumbnail_px: longest side of the thumbnails.
    """

    shown: frozenset[int]
    whole: frozenset[int]
    step: int
    thumbnail_px: int

    def step_of(self, place: int, /) -> int:
        """Return the step of a shown frame by its place among them."""
        return 1 if place in self.whole else self.step


THUMBNAIL_PX = (80, 40, 20)
"""Longest sides of thumbnails, of which the first is taken that needs less than `THUMBNAIL_SHARE` of the page."""

THUMBNAIL_SHARE = 0.25

_THUMBNAIL_BYTES_PER_PIXEL = 1.2
"""Size of an indexed PNG of a noisy map, in bytes per pixel before base64."""

_PICTURE_BYTES = 1_100.0
"""Size of the head and the colours of such a PNG, in bytes in base64."""

LEAST_SIDE_PX = 16
"""Number of pixels that the longer side of a frame keeps at least."""

_BESIDE_MAPS = 150_000
"""Bytes of a page's scripts, style and settings."""

_TEXT_BYTES = 1_500
"""Bytes of the texts about a frame that a page shows."""

_MARGIN = 1.1
"""Factor on measured sizes. Frames differ, and the frames that are measured may need less space than others."""


def planned_page(samples: Sequence[Planes], frames: int, /, *, limit_bytes: float, whole: int | None) -> PagePlan:
    """Return which frames of a run a page of a given size shows, and how many pixels of each it can hold.

    It shows all frames, or as many as fit, evenly spread over the run: at least one, and not fewer than `whole`. If there is no
    room for all pixels of all shown frames, some frames keep all pixels; they are evenly spread too. All others keep every n-th
    row and column.

    Args:
        samples: layers of some frames; sizes are measured on them.
        frames: number of the frames of the run.
        limit_bytes: largest size of the page. It is exceeded only if one frame or `whole` frames need more.
        whole: number of frames that keep all pixels. None: as many as fit into half of the room, and some more if the
            other frames leave room.
    """
    most, room = _largest_step(samples), limit_bytes - _BESIDE_MAPS
    least = _TEXT_BYTES + _thumbnail_bytes(samples, THUMBNAIL_PX[-1]) + _bytes_at(samples, most)
    shown = min(frames, max(whole or 1, int(room / least)))
    room = max(room - _TEXT_BYTES * shown, 0.0)
    sizes = [(px, shown * _thumbnail_bytes(samples, px)) for px in THUMBNAIL_PX]
    thumbnail_px, taken = next((one for one in sizes if one[1] < THUMBNAIL_SHARE * room), sizes[-1])
    room, full_bytes = room - taken, _bytes_at(samples, 1)
    count = shown if shown * full_bytes <= room else max(0, int(0.5 * room / full_bytes))
    count = min(shown, count if whole is None else whole)
    left, others = room - count * full_bytes, shown - count
    steps = ((step, full_bytes if step == 1 else _bytes_at(samples, step)) for step in range(1, most + 1))
    step, each = next(one for one in steps if others * one[1] <= left or one[0] == most)
    if whole is None and step > 1:
        # steps are coarse: the other frames leave room for all pixels of some more frames
        count += max(0, int((left - others * each) / (full_bytes - each)))
    return PagePlan(_spread(frames, shown), _spread(shown, count), step, thumbnail_px)


def _spread(frames: int, count: int) -> frozenset[int]:
    """Return `count` places among frames, evenly spread."""
    return frozenset(int(place) for place in np.linspace(0, frames - 1, count).round())


def _largest_step(samples: Sequence[Planes]) -> int:
    longest: int = max(max(next(iter(planes.values())).shape) for planes in samples)
    return max(1, longest // LEAST_SIDE_PX)


def _bytes_at(samples: Sequence[Planes], step: int) -> float:
    return _MARGIN * max(len(embedded_frame(planes, step=step).data) for planes in samples)


def _thumbnail_bytes(samples: Sequence[Planes], longest_px: int) -> float:
    shapes = [next(iter(planes.values())).shape for planes in samples]
    pixels = max(float(height * width) * (longest_px / max(height, width)) ** 2 for height, width in shapes)
    return _PICTURE_BYTES + 4.0 / 3.0 * _THUMBNAIL_BYTES_PER_PIXEL * float(pixels)
