"""Pictures of named layers: one at full resolution, all that a file holds, and what the scale of each is."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Status
from cadtof_cli.figures.maps import DEPTHS, ERRORS, SIGMAS, VOLTAGES, limits_of, signed_limits
from cadtof_cli.figures.page import Block, Classes, Panel, Rows, Scaled, draw_page, page_figure
from cadtof_cli.figures.pixel_classes import class_shares

ANGLES = "twilight"

PIXELS = 960
"""A layer is magnified, by a whole number, to so many pixels of the picture at most."""

PER_INCH = 100

_MOST_IN_A_ROW = 4


@dataclass(frozen=True, eq=False)
class Shown:
    """What can be drawn of a frame.

    Attributes:
        title: of its pictures.
        layers: by name, (Y, X) each; NaN where there is no value.
        units: of the layers, by name; empty for pure numbers.
        status: bits, (Y, X); None where they are not known.
        depth: what depths are: radial range or planar depth z.
    """

    title: str
    layers: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    status: Status | None
    depth: str = ""

    def unit(self, name: str, /) -> str:
        """Return what a layer's values are, with their unit."""
        unit = self.units.get(name, "")
        return f"{self.depth}, {unit}" if self.depth and name.endswith((".depth", ".mean")) else unit

    def panel(self, name: str, /) -> Panel:
        """Return a layer as a panel."""
        one_path = not name.startswith("direct.")
        return Panel(name, np.asarray(self.layers[name]).astype(np.float64), self.status, one_path=one_path)


def scale_of(
    name: str, panels: tuple[Panel, ...], unit: str, /, *, limits: tuple[float, float] | None, colours: str | None
) -> Scaled:
    """Return panels of a layer, or of layers like it, with the limits and colours that suit them where none are asked for."""
    values = np.concatenate([panel.values.ravel() for panel in panels])
    default, found = default_scale(name, values)
    return Scaled(panels, unit, colours or default, limits or found)


def default_scale(name: str, values: NDArray[np.floating], /) -> tuple[str, tuple[float, float]]:
    """Return colours and limits that suit a layer by its name and values."""
    if name.endswith(".phase"):
        return ANGLES, (0.0, 2.0 * np.pi)
    if ".SC" in name or ".offset" in name:
        return ERRORS, signed_limits(values, share=99.5)
    if name.endswith((".sigma", ".std", ".noise")):
        return SIGMAS, (0.0, limits_of(values)[1])
    if name.endswith(("amplitude", "confidence")):
        return VOLTAGES, (0.0, limits_of(values)[1])
    return DEPTHS, limits_of(values)


def block_of(
    shown: Shown, name: str, /, *, limits: tuple[float, float] | None = None, colours: str | None = None
) -> Block:
    """Return one layer as a block of a page; the status as what became of each pixel."""
    if name == "status" and shown.status is not None:
        return Classes.of(status=shown.status)
    return scale_of(name, (shown.panel(name),), shown.unit(name), limits=limits, colours=colours)


def magnified_width(shape: tuple[int, ...], most: int, /) -> float:
    """Return a panel's width that shows a pixel of a map (Y, X) as a whole number of pixels, `most` along its longer side."""
    return float(shape[1] * max(1, most // max(shape)))


def draw_layer(block: Block, shown: Shown, path: Path, /, *, kind: str) -> None:
    """Draw one layer at full resolution: nothing is averaged or left out."""
    shares = None if shown.status is None else class_shares(shown.status)
    width = magnified_width(block.panels[0].values.shape, PIXELS)
    figure = page_figure(((block,),), title=shown.title, shares=shares, panel_width=width)
    figure.savefig(path, dpi=PER_INCH, format=kind)


def draw_all_layers(shown: Shown, path: Path, /, *, kind: str) -> None:
    """Draw all layers that a file such as truth holds, depths on one scale."""
    depths = [name for name in shown.layers if name.endswith(".depth")]
    blocks: list[Block] = []
    if depths:
        panels = tuple(shown.panel(name) for name in depths)
        blocks.append(scale_of(depths[0], panels, shown.unit(depths[0]), limits=None, colours=None))
    blocks += [block_of(shown, name) for name in shown.layers if name not in depths]
    shares = None if shown.status is None else class_shares(shown.status)
    draw_page(_in_rows(blocks), path, title=shown.title, kind=kind, shares=shares)


def _in_rows(blocks: list[Block]) -> Rows:
    rows: list[list[Block]] = [[]]
    for block in blocks:
        if rows[-1] and sum(len(one.panels) for one in (*rows[-1], block)) > _MOST_IN_A_ROW:
            rows.append([])
        rows[-1].append(block)
    return rows


def draw_recorded(shown: Shown, path: Path, /, *, kind: str) -> None:
    """Draw what a frame recorded, a row for each harmonic: SC1 and SC2, amplitude and phase, each on one scale in all rows."""
    rows: list[list[Block]] = []
    harmonics = [name.removesuffix(".phase") for name in shown.layers if name.endswith(".phase")]
    kinds = {what: [f"{one}.{what}" for one in harmonics] for what in ("SC1", "SC2", "amplitude")}
    volts = np.concatenate([np.ravel(shown.layers[name]) for what in ("SC1", "SC2") for name in kinds[what]])
    light = np.concatenate([np.ravel(shown.layers[name]) for name in kinds["amplitude"]])
    of_volts, of_light = default_scale("H1.SC1", volts)[1], default_scale("H1.amplitude", light)[1]
    for one in harmonics:
        names = f"{one}.SC1", f"{one}.SC2"
        unit = shown.unit(names[0])
        rows.append(
            [
                scale_of(names[0], tuple(map(shown.panel, names)), unit, limits=of_volts, colours=None),
                block_of(shown, f"{one}.amplitude", limits=of_light),
                block_of(shown, f"{one}.phase"),
            ]
        )
    draw_page(rows, path, title=shown.title, kind=kind)
