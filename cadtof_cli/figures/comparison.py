"""What differs between two maps of a frame: depths on one scale, differences, and what became of each pixel."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cadtof_cli.figures.layers import Shown
from cadtof_cli.figures.page import Block, Classes, Panel, Scaled, draw_page
from cadtof_cli.figures.scales import DEPTHS, ERRORS, limits_of, signed_limits
from cadtof_cli.maps.comparison import difference
from cadtof_cli.maps.layers import error_unit


def draw_comparison(one: Shown, other: Shown, names: Sequence[str], path: Path, /, *, title: str) -> None:
    """Draw, a row for each named layer, A and B on one scale and A − B; and what became of each pixel where both say so."""
    rows: list[list[Block]] = []
    for name in names:
        pair = tuple(
            Panel(f"{letter}: {name}", shown.values(name), shown.status, one_path=True)
            for letter, shown in (("A", one), ("B", other))
        )
        both = np.concatenate([panel.values.ravel() for panel in pair])
        factor, unit = error_unit(one.units[name])
        change = factor * difference(one.layers[name], other.layers[name])
        rows.append(
            [
                Scaled(pair, one.units[name], DEPTHS, limits_of(both)),
                Scaled((Panel("A − B", change),), unit, ERRORS, signed_limits(change)),
            ]
        )
    if one.status is not None and other.status is not None:
        changed = np.where(one.status != other.status, 1.0, 0.0)
        rows.append(
            [
                Classes.of(**{"A: paths": one.status, "B: paths": other.status}),
                Scaled((Panel("status differs", changed),), "1: in some bit", "magma", (0.0, 1.0)),
            ]
        )
    draw_page(rows, path, title=title)
