"""Figures in matplotlib's default style, and titles and legends that can show any file name.

A user's `matplotlibrc` is ignored: it may ask for other sizes, or for a LaTeX that is not installed.
"""

from functools import cache

import matplotlib as mpl
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.textpath import TextPath

from cadtof_cli.units import printable, shortened

mpl.rcdefaults()

__all__ = ["Figure", "add_title", "drawable", "legend_beside", "within"]


@cache
def _drawn_characters() -> frozenset[int]:
    """Return the characters that the font of pictures has."""
    font = font_manager.get_font(font_manager.findfont(font_manager.FontProperties()))
    return frozenset(font.get_charmap())


def drawable(text: str, /) -> str:
    """Return a text with the characters escaped that the font lacks, and those that cannot be seen.

    Draw it with `parse_math=False`: names may hold `$`.
    """
    return "".join(
        f"\\u{{{ord(sign):x}}}" if sign.isprintable() and ord(sign) not in _drawn_characters() else printable(sign)
        for sign in text
    )


def within(text: str, inches: float, /, *, size: float) -> str:
    """Return a drawable text that is at most `inches` wide at font size `size`; if needed, its middle is left out."""
    shown = text = drawable(text)
    # the letters that are left may be wider than the others
    while shown.strip() and len(shown) > 3 and (wide := _inches(shown, size, enough=inches)) > inches:
        shown = shortened(text, min(int(len(shown) * inches / wide), len(shown) - 1))
    return shown


def _inches(text: str, size: float, *, enough: float) -> float:
    """Return the width of a text in inches, or a bound of it if the bound is `enough` or less."""
    # `$` is replaced, so that the width is that of letters and not of mathematics
    path = TextPath((0, 0), text.replace("$", "S"), size=size)
    # most texts fit; no curve reaches beyond its control points, and these are known without its extrema
    most = float(np.ptp(path.vertices[:, 0])) / 72
    return most if most <= enough else float(path.get_extents().width) / 72


def add_title(figure: Figure, title: str, /, *, below: float, size: float = 11) -> None:
    """Add a title across a figure; its middle is `below` inches below the top."""
    width, height = figure.get_size_inches()
    told = within(title, width - 0.2, size=size)
    figure.text(0.5, 1 - below / height, told, ha="center", va="center", fontsize=size, parse_math=False)


def legend_beside(axes: Axes, /, *others: Axes) -> Legend:
    """Add a legend at the right of axes, and return it; it names their curves, and those of `others`, which lie over them."""
    found = [one.get_legend_handles_labels() for one in (axes, *others)]
    handles, labels = ([item for part in parts for item in part] for parts in zip(*found, strict=True))
    return axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize=8)
