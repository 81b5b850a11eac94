"""Pictures of a frame's maps, and of the differences between two maps.

They show depths, errors if truth is known, sigma, confidence and the class of each pixel.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.figures.layers import Shown, on_one_scale
from cadtof_cli.figures.page import Block, Panel, draw_page
from cadtof_cli.figures.pixel_classes import PixelClass
from cadtof_cli.figures.scales import Scale
from cadtof_cli.maps.comparison import difference
from cadtof_cli.maps.layers import CONFIDENCE, DIRECT_AMPLITUDE, DIRECT_DEPTH, DIRECT_SIGMA, MPI_DEPTH, error_unit

OF_A_MAP = (DIRECT_DEPTH, MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA)
"""Layers that the picture needs; `cadtof resolve` writes them with all options."""


def draw_maps(
    shown: Shown, path: Path, /, *, truth_m: Float | None = None, first_phasor_m: Float | None = None
) -> None:
    """Draw the maps of a frame, which has the layers `OF_A_MAP`. A legend explains the colours of pixels without a depth.

    `truth_m` are true direct depths, (Y, X), and `first_phasor_m` depths from the first phasor alone.
    """
    direct, status = shown.values(DIRECT_DEPTH), shown.status
    known = {"direct": direct} if first_phasor_m is None else {"first phasor": first_phasor_m, "direct": direct}
    titles = {"direct": "direct depth", "first phasor": "first phasor alone"}
    depths = tuple(Panel(titles[name], depth, status) for name, depth in known.items())
    mpi = Panel("MPI depth", shown.values(MPI_DEPTH), status, lacking=PixelClass.ONE_PATH)
    unit = shown.unit(DIRECT_DEPTH)
    upper: list[Block] = [on_one_scale(DIRECT_DEPTH, depths, unit), on_one_scale(MPI_DEPTH, (mpi,), unit)]
    if status is not None:
        upper.append(Block.of_classes(paths=status))
    lower: list[Block] = []
    if truth_m is not None:
        errors = {name: 100 * (depth - truth_m) for name, depth in known.items()}
        untold = ~np.isfinite(truth_m)
        panels = tuple(
            Panel(f"{name} − truth\n{_median(error)}", error, status, in_one=untold & np.isfinite(known[name]))
            for name, error in errors.items()
        )
        lower.append(Block(panels, "cm", Scale.of_differences(*errors.values())))
    for name, title, unit, factor in (
        (DIRECT_SIGMA, "σ of direct depth", "predicted, cm", 100),
        (CONFIDENCE, "confidence", "first phasor, mV", 1000),
        (DIRECT_AMPLITUDE, "direct amplitude", "mV", 1000),
    ):
        if name in OF_A_MAP or (name in shown.layers and truth_m is None):
            values = factor * shown.values(name)
            lower.append(on_one_scale(name, (Panel(title, values, status),), unit))
    draw_page((upper, lower), path, title=shown.title, shares=shown.shares())


def _median(error: Float) -> str:
    finite = np.abs(error[np.isfinite(error)])
    return f"median {np.median(finite):.2f} cm off" if finite.size else "no pixel has both"


def draw_comparison(one: Shown, other: Shown, names: Sequence[str], path: Path, /, *, title: str) -> None:
    """Draw a row for each named layer: A and B on one scale, and A − B.

    If both have status bits, a last row shows the class of each pixel, and where the bits differ.
    """
    rows: list[list[Block]] = []
    for name in names:
        pair = tuple(
            Panel(f"{letter}: {name}", shown.values(name), shown.status, lacking=PixelClass.ONE_PATH)
            for letter, shown in (("A", one), ("B", other))
        )
        factor, unit = error_unit(one.units[name])
        change = factor * difference(one.layers[name], other.layers[name])
        in_one = np.isfinite(one.layers[name]) != np.isfinite(other.layers[name])
        # the status of A explains pixels that have no value in either map
        panel = Panel("A − B", change, one.status, lacking=PixelClass.ONE_PATH, in_one=in_one)
        of_change = Block((panel,), unit, Scale.of_differences(change))
        # layers other than depths have the scale of depths here too
        rows.append([on_one_scale(DIRECT_DEPTH, pair, one.unit(name)), of_change])
    if one.status is not None and other.status is not None:
        changed = np.where(one.status != other.status, 1.0, 0.0)
        rows.append(
            [
                Block.of_classes(**{"A: paths": one.status, "B: paths": other.status}),
                Block((Panel("status differs", changed),), "any bit", Scale("magma", (0.0, 1.0), ends=("no", "yes"))),
            ]
        )
    draw_page(rows, path, title=title)
