"""A page of panels: maps side by side in rows, one scale for maps that are compared, and a legend of pixel classes.

The places of panels are computed here and not by matplotlib's layout. So wide and tall frames fill the page, and
nothing moves between the frames of a sequence. Lengths are in hundredths of an inch.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Status
from cadtof_cli.figures.canvas import Figure, add_title
from cadtof_cli.figures.kinds import save
from cadtof_cli.figures.pixel_classes import NO_VALUE, PixelClass, classes_of
from cadtof_cli.figures.scales import Scale

Image = NDArray[np.uint8]

DOTS_PER_INCH = 130

LEGEND_ENTRY = 190
"""Width of one entry of the legend."""

_AREA, _WIDEST, _TALLEST, _NARROWEST = 88_000.0, 760.0, 900.0, 122.0
"""Area of a panel; its largest width and height, which limit the area; and the width that its title needs at least."""

_LEAST_SIDE = 40.0
"""Least width and height of a panel."""

_GAP, _BAR, _LEFT, _TOP, _TITLE, _BOTTOM, _LEGEND_ROW = 14.0, 80.0, 58.0, 40.0, 42.0, 44.0, 24.0
"""Spaces of the page: between panels, for a bar of colours, at the left of the page, for the title of the page, for the title of
a panel, below the lowest panels, and for a row of the legend."""

_WIDE, _TALL = 2.2, 0.6
"""Limits on width over height: wider panels are all stacked, taller panels all stand side by side."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One map of a page.

    Attributes:
        title: name of the map; a second line replaces the unit below the name.
        values: (Y, X); NaN: no value.
        status: status bits, (Y, X), which say why a pixel has no value; None: not known.
        lacking: class of the pixels that have an answer but no value here; None: there are none.
        in_one: of a difference, the pixels that have the colour of a value in only one of the two; whatever their status.
    """

    title: str
    values: NDArray[np.floating]
    status: Status | None = None
    lacking: PixelClass | None = None
    in_one: Bool | None = None

    def without_value(self) -> dict[PixelClass, Bool]:
        """Return, for each reason, the pixels that have no value."""
        found = classes_of(self.status, np.isfinite(self.values), lacking=self.lacking)
        reasons = {kind: pixels for kind, pixels in found.items() if kind in NO_VALUE}
        if self.in_one is not None:
            reasons = {kind: pixels & ~self.in_one for kind, pixels in reasons.items()}
            reasons[PixelClass.IN_ONE] = self.in_one
        return reasons


@dataclass(frozen=True, eq=False)
class Block:
    """Panels that are compared: they share a unit, a scale and a bar of colours.

    Without a scale, they show the class of each pixel; they have no bar, because the legend explains the colours.
    """

    panels: tuple[Panel, ...]
    unit: str
    scale: Scale | None

    @classmethod
    def of_classes(cls, **statuses: Status) -> "Block":
        """Return one panel for each array of status bits, (Y, X); the keywords are the titles."""
        panels = tuple(Panel(title, np.zeros(status.shape), status) for title, status in statuses.items())
        return cls(panels, "as the legend says", None)

    def painted(self, panel: Panel, /) -> Image:
        """Return the colours of a panel, RGBA, (Y, X, 4)."""
        image: Image = np.empty((*panel.values.shape, 4), np.uint8)
        if self.scale is not None:
            low, high = self.scale.limits
            shares = Normalize(low, high, clip=True)(np.where(np.isfinite(panel.values), panel.values, low))
            image = mpl.colormaps[self.scale.colours](shares, bytes=True)
        for kind, pixels in self._classes(panel).items():
            image[pixels] = kind.rgba
        return image

    def shown(self, panel: Panel, /) -> set[PixelClass]:
        """Return the classes of pixels in a panel whose colours are not those of the scale."""
        return {kind for kind, pixels in self._classes(panel).items() if pixels.any()}

    def _classes(self, panel: Panel) -> dict[PixelClass, Bool]:
        return classes_of(panel.status) if self.scale is None else panel.without_value()


Rows = Sequence[Sequence[Block]]


@dataclass(frozen=True)
class _Cell:
    """The place of a panel on the page.

    Attributes:
        panel: what is drawn.
        block: the block of the panel.
        left, top: of the panel, from the top left of the page.
        leftmost: whether no panel is at its left; the panel then has labels of rows.
        lowest: whether no panel is below it; the panel then has labels of columns.
        closes: whether the panel is the last of its block.
    """

    panel: Panel
    block: Block
    left: float
    top: float
    leftmost: bool
    lowest: bool
    closes: bool


@dataclass(frozen=True)
class _Page:
    """The size of the page and of every panel on it; `framed`: the lines around a panel may cover its outermost pixels."""

    width: float
    height: float
    panel_width: float
    panel_height: float
    framed: bool

    def place(self, left: float, top: float, width: float, height: float) -> tuple[float, float, float, float]:
        """Return a rectangle, given from the top left of the page, in the coordinates of matplotlib."""
        bottom = 1.0 - (top + height) / self.height
        return left / self.width, bottom, width / self.width, height / self.height


def draw_page(rows: Rows, path: Path, /, *, title: str, shares: Mapping[PixelClass, float] | None = None) -> None:
    """Draw rows of blocks as a picture; see `page_figure`."""
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
    """Return the page as a figure.

    Args:
        rows: the blocks of each row, side by side; all panels have the same size.
        title: of the page.
        shares: share of pixels in each class, for the legend.
        kinds: classes of pixels that the legend names; None: those that occur.
        panel_width: width of every panel in hundredths of an inch; None: chosen to suit the page.
    """
    rows_px, columns_px = rows[0][0].panels[0].values.shape
    aspect = columns_px / rows_px
    framed = panel_width is None
    panel_width = panel_width or min(math.sqrt(_AREA * aspect), _WIDEST, _TALLEST * aspect)
    panel_height = panel_width / aspect
    # frames of a few rows or columns are stretched by a whole number, so that they and their bars can be seen
    panel_width, panel_height = (side * max(1, math.ceil(_LEAST_SIDE / side)) for side in (panel_width, panel_height))
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
        if cell.closes:
            _bar(figure, cell, cells, page)
    add_legend(figure, named, columns=columns, shares=shares)
    return figure


def _cells(rows: Rows, width: float, height: float, *, stacked: bool) -> Iterator[_Cell]:
    """Yield the places of the panels: the blocks of a row side by side or, if `stacked`, each panel below the last."""
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
        axis.set_major_locator(MaxNLocator(max(1, min(7, int(length / 45))), integer=True, min_n_ticks=1))
    if cell.leftmost:
        axes.set_ylabel("row, px", fontsize=7.5)
    if cell.lowest:
        axes.set_xlabel("column, px", fontsize=7.5)


def _bar(figure: Figure, cell: _Cell, cells: Sequence[_Cell], page: _Page) -> None:
    """Draw the bar of colours of a block at the right of its last panel; if panels are stacked, along all of them."""
    mine = [one for one in cells if one.block is cell.block and one.left == cell.left]
    top, bottom = min(one.top for one in mine), max(one.top for one in mine) + page.panel_height
    add_bar(
        figure, cell.block, page.place(cell.left + page.panel_width + 8, top, 11, bottom - top), length=bottom - top
    )


def add_bar(figure: Figure, block: Block, place: tuple[float, float, float, float], /, *, length: float) -> None:
    """Add the bar of colours of a block, if it has a scale, at a place of the figure.

    `length` is its length in hundredths of an inch.
    """
    if (scale := block.scale) is None:
        return
    low, high = scale.limits
    values = np.concatenate([one.values[np.isfinite(one.values)].ravel() for one in block.panels])
    lowest, highest = scale.reach or ((values.min(), values.max()) if values.size else scale.limits)
    beyond = bool(lowest < low), bool(highest > high)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    mappable = ScalarMappable(Normalize(low, high), mpl.colormaps[scale.colours])
    ticks = MaxNLocator(max(2, min(8, int(length / 28))))
    bar = figure.colorbar(mappable, cax=figure.add_axes(place), extend=extend, extendfrac=0.03, ticks=ticks)
    if scale.ends:
        bar.set_ticks(scale.limits, labels=scale.ends)
    bar.ax.tick_params(labelsize=7, length=2.5)
    bar.set_label(block.unit.rpartition(", ")[2], fontsize=8, labelpad=2)


def add_legend(
    figure: Figure, kinds: Sequence[PixelClass], /, *, columns: int, shares: Mapping[PixelClass, float] | None = None
) -> None:
    """Add a legend of the colours of pixel classes at the foot of the figure."""
    if kinds:
        labels = [f"{one.label}: {shares[one]:.1%}" if shares and one in shares else one.label for one in kinds]
        squares = (Patch(facecolor=one.colour, edgecolor="black", lw=0.5) for one in kinds)
        style = {"ncols": columns, "fontsize": 8.5, "frameon": False, "borderaxespad": 0.3}
        figure.legend(list(squares), labels, loc="lower center", **style)
