"""A picture of what differs between two maps of a frame: depths on one scale, differences, and what became of each pixel."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Status
from cadtof_cli.figures.maps import DEPTHS, ERRORS, limits_of, signed_limits
from cadtof_cli.figures.page import Block, Classes, Panel, Scaled, draw_page


@dataclass(frozen=True, eq=False)
class LayerPair:
    """A layer of both maps, (Y, X) each, in units that are shown; and of its differences."""

    name: str
    first: NDArray[np.floating]
    second: NDArray[np.floating]
    unit: str
    difference: NDArray[np.floating]
    difference_unit: str


def draw_comparison(
    layers: tuple[LayerPair, ...],
    status: tuple[Status | None, Status | None],
    path: Path,
    /,
    *,
    title: str,
    kind: str = "png",
) -> None:
    """Draw, a row for each layer, A and B on one scale and A − B; and what became of each pixel where both say so."""
    rows: list[list[Block]] = []
    for layer in layers:
        pair = tuple(
            Panel(f"A: {layer.name}" if which == 0 else f"B: {layer.name}", values, bits, one_path=True)
            for which, (values, bits) in enumerate(zip((layer.first, layer.second), status, strict=True))
        )
        both = np.concatenate([layer.first.ravel(), layer.second.ravel()])
        change = Panel("A − B", layer.difference)
        rows.append(
            [
                Scaled(pair, layer.unit, DEPTHS, limits_of(both)),
                Scaled((change,), layer.difference_unit, ERRORS, signed_limits(layer.difference)),
            ]
        )
    if status[0] is not None and status[1] is not None:
        changed = np.where(status[0] != status[1], 1.0, 0.0)
        rows.append(
            [
                Classes.of(**{"A: paths": status[0], "B: paths": status[1]}),
                Scaled((Panel("status differs", changed),), "1: in some bit", "magma", (0.0, 1.0)),
            ]
        )
    draw_page(rows, path, title=title, kind=kind)
