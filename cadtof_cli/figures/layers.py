"""Pictures of named layers: one layer at full resolution, or all layers of a file; and layers as blocks of a page."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Float, Status
from cadtof_cli.figures.kinds import save
from cadtof_cli.figures.page import Block, Panel, Rows, draw_page, page_figure
from cadtof_cli.figures.pixel_classes import PixelClass, class_shares
from cadtof_cli.figures.scales import Scale
from cadtof_cli.files.maps import STATUS
from cadtof_cli.maps.layers import layer_unit

PIXELS = 960
"""Largest side of a layer in pixels of the picture, after magnification by a whole number."""

DOTS_PER_INCH = 100

_MOST_IN_A_ROW = 4


@dataclass(frozen=True, eq=False)
class Shown:
    """The layers of a frame that can be drawn.

    Attributes:
        title: of the pictures.
        layers: by name, (Y, X) each; NaN: no value.
        units: of the layers, by name; empty for pure numbers.
        status: status bits, (Y, X); None: not known.
        depth: in words, the kind of the depths: radial range or planar depth z.
    """

    title: str
    layers: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    status: Status | None
    depth: str = ""

    @classmethod
    def of(cls, title: str, layers: Mapping[str, NDArray[Any]], /, *, depth: str = "") -> "Shown":
        """Return the layers of a map; its status bits are taken from the layer `status`, if there is one."""
        return cls(title, layers, {name: layer_unit(name) for name in layers}, layers.get(STATUS), depth)

    def shares(self) -> dict[PixelClass, float] | None:
        """Return the share of pixels in each class; None if their status is not known."""
        return None if self.status is None else class_shares(self.status)

    def unit(self, name: str, /) -> str:
        """Return the unit of a layer; for depths, also their kind."""
        unit = self.units.get(name, "")
        return f"{self.depth}, {unit}" if self.depth and name.endswith((".depth", ".mean")) else unit

    def values(self, name: str, /) -> Float:
        """Return the values of a layer, float64 (Y, X)."""
        return np.asarray(self.layers[name]).astype(np.float64)

    def panel(self, name: str, /) -> Panel:
        """Return a layer as a panel."""
        lacking = PixelClass.FEWER_PATHS if name.startswith("path") else PixelClass.ONE_PATH
        return Panel(name, self.values(name), self.status, lacking=None if name.startswith("direct.") else lacking)


def on_one_scale(name: str, panels: tuple[Panel, ...], unit: str, /, scale: Scale | None = None) -> Block:
    """Return panels of a layer, or of layers like it, on one scale; None: the one that suits them."""
    return Block(panels, unit, scale or Scale.of_layer(name, *(panel.values for panel in panels)))


def block_of(shown: Shown, name: str, /, scale: Scale | None = None) -> Block:
    """Return one layer as a block of a page. The layer `status` is shown as the class of each pixel."""
    if name == "status" and shown.status is not None:
        return Block.of_classes(status=shown.status)
    return on_one_scale(name, (shown.panel(name),), shown.unit(name), scale)


def magnified_width(shape: tuple[int, ...], most: int, /) -> float:
    """Return the width of a panel for a map (Y, X), magnified by a whole number, whose longer side has `most` pixels at most."""
    return float(shape[1] * max(1, most // max(shape)))


def draw_layer(block: Block, shown: Shown, path: Path, /) -> None:
    """Draw one layer at full resolution; no pixel is averaged or left out."""
    width = magnified_width(block.panels[0].values.shape, PIXELS)
    figure = page_figure(((block,),), title=shown.title, shares=shown.shares(), panel_width=width)
    save(figure, path, dpi=DOTS_PER_INCH)


def draw_all_layers(shown: Shown, path: Path, /) -> None:
    """Draw all layers of a file such as truth; all depths have one scale."""
    depths = [name for name in shown.layers if name.endswith(".depth")]
    blocks: list[Block] = []
    if depths:
        panels = tuple(shown.panel(name) for name in depths)
        blocks.append(on_one_scale(depths[0], panels, shown.unit(depths[0])))
    blocks += [block_of(shown, name) for name in shown.layers if name not in depths]
    draw_page(_in_rows(blocks), path, title=shown.title, shares=shown.shares())


def _in_rows(blocks: list[Block]) -> Rows:
    rows: list[list[Block]] = [[]]
    for block in blocks:
        if rows[-1] and sum(len(one.panels) for one in (*rows[-1], block)) > _MOST_IN_A_ROW:
            rows.append([])
        rows[-1].append(block)
    return rows


def draw_recorded(shown: Shown, path: Path, /) -> None:
    """Draw a recorded frame, a row for each harmonic: SC1 and SC2, amplitude, and phase, each on one scale in all rows."""
    rows: list[list[Block]] = []
    harmonics = [name.removesuffix(".phase") for name in shown.layers if name.endswith(".phase")]
    of_volts = Scale.of_layer("H1.SC1", *(shown.values(f"{one}.{sc}") for one in harmonics for sc in ("SC1", "SC2")))
    of_light = Scale.of_layer("H1.amplitude", *(shown.values(f"{one}.amplitude") for one in harmonics))
    for one in harmonics:
        names = f"{one}.SC1", f"{one}.SC2"
        volts = Block(tuple(map(shown.panel, names)), shown.unit(names[0]), of_volts)
        rows.append([volts, block_of(shown, f"{one}.amplitude", of_light), block_of(shown, f"{one}.phase")])
    draw_page(rows, path, title=shown.title)
