"""A page of panels: maps beside each other in rows, those that are compared with one scale, and a legend of what has no value.

Places are worked out here instead of by matplotlib's layout, so that wide and tall frames fill the page and nothing moves
between the frames of a sequence. Lengths are in hundredths of an inch.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Status
from cadtof_cli.figures.canvas import Figure, add_title
from cadtof_cli.figures.kinds import save
from cadtof_cli.figures.pixel_classes import NO_VALUE, PixelClass, classes_of

Image = NDArray[np.uint8]

DOTS_PER_INCH = 130

LEGEND_ENTRY = 190
"""Width of an entry of the legend."""

_AREA, _WIDEST, _TALLEST, _NARROWEST = 88_000.0, 760.0, 900.0, 122.0
"""Area of a panel; the largest width and height, where the area gives way; and the least width, which its titles take."""

_GAP, _BAR, _LEFT, _TOP, _TITLE, _BOTTOM, _LEGEND_ROW = 14.0, 80.0, 58.0, 40.0, 42.0, 44.0, 24.0
"""Between panels; for a bar of colours; left of all; for the page's title; for a panel's; below all; for a row of the legend."""

_WIDE, _TALL = 2.2, 0.6
"""Width over height from which on all panels stand below each other, and below which they stand beside each other."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A map, (Y, X), with NaN where it has no value; `status` says why, and `one_path` whether one path is a reason.

    `in_one` are the pixels of a difference that only one of two maps has a value for.
    """

    title: str
    values: NDArray[np.floating]
    status: Status | None = None
    one_path: bool = False
    in_one: Bool | None = None

    def without_value(self) -> dict[PixelClass, Bool]:
        """Return which pixels have no value for which reason."""
        found = classes_of(self.status, np.isfinite(self.values), one_path=self.one_path)
        reasons = {kind: pixels for kind, pixels in found.items() if kind in NO_VALUE}
        if self.in_one is not None:
            reasons = {kind: pixels & ~self.in_one for kind, pixels in reasons.items()} | {
                PixelClass.IN_ONE: self.in_one
            }
        return reasons


@dataclass(frozen=True, eq=False)
class Scaled:
    """Panels that are compared: one unit, one scale, one bar of colours; `ends` says in words what the bar's two ends mean."""

    panels: tuple[Panel, ...]
    unit: str
    colours: str
    limits: tuple[float, float]
    ends: tuple[str, ...] = ()

    def painted(self, panel: Panel, /) -> Image:
        """Return a panel's colours, (Y, X, 4)."""
        low, high = self.limits
        known = np.isfinite(panel.values)
        image: Image = mpl.colormaps[self.colours](
            Normalize(low, high, clip=True)(np.where(known, panel.values, low)), bytes=True
        )
        for kind, pixels in panel.without_value().items():
            image[pixels] = _bytes(kind)
        return image

    def shown(self, panel: Panel, /) -> set[PixelClass]:
        """Return for which reasons pixels of a panel have no value."""
        return {kind for kind, pixels in panel.without_value().items() if pixels.any()}


@dataclass(frozen=True, eq=False)
class Classes:
    """Panels of what became of each pixel; without a bar, as the legend says it."""

    panels: tuple[Panel, ...]
    unit: str = "as the legend says"

    @classmethod
    def of(cls, **statuses: Status) -> "Classes":
        """Return panels of status bits, (Y, X) each, by their titles."""
        return cls(tuple(Panel(title, np.zeros(status.shape), status) for title, status in statuses.items()))

    def painted(self, panel: Panel, /) -> Image:
        """Return the colours, (Y, X, 4)."""
        image = np.empty((*panel.values.shape, 4), np.uint8)
        for kind, pixels in classes_of(panel.status).items():
            image[pixels] = _bytes(kind)
        return image

    def shown(self, panel: Panel, /) -> set[PixelClass]:
        """Return what became of pixels."""
        return {kind for kind, pixels in classes_of(panel.status).items() if pixels.any()}


Block = Scaled | Classes

Rows = Sequence[Sequence[Block]]


@dataclass(frozen=True)
class _Cell:
    """Where a panel is drawn, from the page's top left: its block, and whether it closes it."""

    panel: Panel
    block: Block
    left: float
    top: float
    leftmost: bool
    lowest: bool
    closes: bool


@dataclass(frozen=True)
class _Page:
    """The size of the page and of every panel on it; `framed`: lines around panels may cover their outermost pixels."""

    width: float
    height: float
    panel_width: float
    panel_height: float
    framed: bool

    def place(self, left: float, top: float, width: float, height: float) -> tuple[float, float, float, float]:
        """Return a rectangle, given from the top left, as matplotlib takes it."""
        bottom = 1.0 - (top + height) / self.height
        return left / self.width, bottom, width / self.width, height / self.height


def draw_page(rows: Rows, path: Path, /, *, title: str, shares: Mapping[PixelClass, float] | None = None) -> None:
    """Draw rows of blocks as a picture.

    Args:
        rows: blocks beside each other; all panels have the same size.
        path: file to write.
        title: of the page.
        shares: of the pixels, for the legend.
    """
    save(page_figure(rows, title=title, shares=shares), path, dpi=DOTS_PER_INCH)


def page_figure(
    rows: Rows,
    /,
    *,
    title: str,
    shares: Mapping[PixelClass, float] | None = None,
    kinds: Collection[PixelClass] | None = None,
    panel_width: float | None = None,
) -> Figure:
    """Return the page as a figure (see `draw_page`).

    Args:
        rows: blocks beside each other.
        title: of the page.
        shares: of the pixels, for the legend.
        kinds: of pixels that the legend names; None: those that are there.
        panel_width: of every panel, in hundredths of an inch; None: as suits the page.
    """
    rows_px, columns_px = rows[0][0].panels[0].values.shape
    aspect = columns_px / rows_px
    framed = panel_width is None
    panel_width = panel_width or min(math.sqrt(_AREA * aspect), _WIDEST, _TALLEST * aspect)
    panel_height = panel_width / aspect
    if aspect > _WIDE:
        rows = [(block,) for row in rows for block in row]
    elif aspect < _TALL:
        rows = [[block for row in rows for block in row]]
    cells = list(_cells(rows, panel_width, panel_height, stacked=aspect > _WIDE))
    shown = set[PixelClass](kinds or ())
    if kinds is None:
        shown.update(*(cell.block.shown(cell.panel) for cell in cells))
    named = [one for one in PixelClass if one in shown]
    width = max(cell.left for cell in cells) + max(panel_width + _BAR, _NARROWEST)
    columns = max(1, min(len(named), int(width // LEGEND_ENTRY)))
    legend = _LEGEND_ROW * math.ceil(len(named) / columns) if named else 0.0
    height = max(cell.top for cell in cells) + panel_height + _BOTTOM + legend
    page = _Page(width, height, panel_width, panel_height, framed)
    figure = Figure(figsize=(width / 100, height / 100))
    add_title(figure, title, below=(_TOP / 2 - 2) / 100)
    for cell in cells:
        _draw(figure, cell, page)
        if cell.closes and isinstance(cell.block, Scaled):
            _bar(figure, cell, cells, page)
    add_legend(figure, named, columns=columns, shares=shares)
    return figure


def _cells(rows: Rows, width: float, height: float, *, stacked: bool) -> Iterator[_Cell]:
    """Yield where the panels go: blocks of a row beside each other, or, stacked, every panel below the other."""
    top = _TOP
    for place, row in enumerate(rows):
        left, last_row = _LEFT, place == len(rows) - 1
        for block in row:
            for number, panel in enumerate(block.panels, start=1):
                closes = number == len(block.panels)
                lowest = last_row and (closes or not stacked)
                yield _Cell(panel, block, left, top + _TITLE, stacked or left == _LEFT, lowest, closes)
                if stacked:
                    top += _TITLE + height
                else:
                    left += max(width + (_BAR if closes else _GAP), _NARROWEST)
        if not stacked:
            top += _TITLE + height


def _draw(figure: Figure, cell: _Cell, page: _Page) -> None:
    axes = figure.add_axes(page.place(cell.left, cell.top, page.panel_width, page.panel_height))
    axes.imshow(cell.block.painted(cell.panel), interpolation="nearest", aspect="auto")
    if not page.framed:
        axes.spines[:].set_position(("outward", 2))
    name, _, detail = cell.panel.title.partition("\n")
    middle = cell.left + page.panel_width / 2
    for text, above, size, ink in ((name, 24, 9.5, "black"), (detail or cell.block.unit, 8, 8, "0.3")):
        x, y, _, _ = page.place(middle, cell.top - above, 0, 0)
        figure.text(x, y, text, fontsize=size, color=ink, ha="center", va="center", parse_math=False)
    axes.tick_params(labelsize=7, length=2.5, labelleft=cell.leftmost, labelbottom=cell.lowest)
    for axis, length in ((axes.xaxis, page.panel_width), (axes.yaxis, page.panel_height)):
        axis.set_major_locator(MaxNLocator(max(1, min(7, int(length / 45))), integer=True))
    if cell.leftmost:
        axes.set_ylabel("row, px", fontsize=7.5)
    if cell.lowest:
        axes.set_xlabel("column, px", fontsize=7.5)


def _bar(figure: Figure, cell: _Cell, cells: Sequence[_Cell], page: _Page) -> None:
    """Draw the bar of colours of a block at the right of its last panel, along all of them where they are stacked."""
    block = cell.block
    assert isinstance(block, Scaled)
    mine = [one for one in cells if one.block is block and one.left == cell.left]
    top, bottom = min(one.top for one in mine), max(one.top for one in mine) + page.panel_height
    add_bar(figure, block, page.place(cell.left + page.panel_width + 8, top, 11, bottom - top), length=bottom - top)


def add_bar(figure: Figure, block: Scaled, place: tuple[float, float, float, float], /, *, length: float) -> None:
    """Add the bar of colours of a block at a place of the figure, `length` hundredths of an inch long."""
    low, high = block.limits
    values = np.concatenate([one.values[np.isfinite(one.values)].ravel() for one in block.panels])
    beyond = bool(values.size and values.min() < low), bool(values.size and values.max() > high)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    mappable = ScalarMappable(Normalize(low, high), mpl.colormaps[block.colours])
    ticks = MaxNLocator(max(2, min(8, int(length / 28))))
    bar = figure.colorbar(mappable, cax=figure.add_axes(place), extend=extend, extendfrac=0.03, ticks=ticks)
    if block.ends:
        bar.set_ticks(block.limits, labels=block.ends)
    bar.ax.tick_params(labelsize=7, length=2.5)
    bar.set_label(block.unit.rpartition(", ")[2], fontsize=8, labelpad=2)


def add_legend(
    figure: Figure, kinds: Sequence[PixelClass], /, *, columns: int, shares: Mapping[PixelClass, float] | None = None
) -> None:
    """Add what the colours of pixels mean, at the foot of the figure."""
    if kinds:
        handles = [Patch(facecolor=one.colour, edgecolor="black", lw=0.5, label=_label(one, shares)) for one in kinds]
        figure.legend(
            handles=handles, loc="lower center", ncols=columns, fontsize=8.5, frameon=False, borderaxespad=0.3
        )


def _label(kind: PixelClass, shares: Mapping[PixelClass, float] | None) -> str:
    share = (shares or {}).get(kind)
    return kind.label if share is None else f"{kind.label}: {share:.1%}"


def _bytes(kind: PixelClass) -> Image:
    return np.array([round(255 * part) for part in to_rgba(kind.colour)], np.uint8)
