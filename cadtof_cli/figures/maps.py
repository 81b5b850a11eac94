"""A picture of a frame's maps: direct depth, MPI depth, confidence, and the error where truth is known, else sigma."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cadtof_cli.arrays import Bool, Float, Status
from cadtof_cli.figures.text import drawable
from cadtof_cli.resolver.status import StatusBit

NO_ANSWER, ONE_PATH, SATURATED = "0.45", "0.85", "#ff2fd0"
"""Colours of pixels that have no depth, by the reason: none of them is in a scale of colours beside them."""

_PANEL_AREA = 15.0
_WIDE, _TALL = 2.2, 0.6


@dataclass(frozen=True)
class MapPicture:
    """What the picture shows, (Y, X) each: depths, sigma and truth in m, confidence in V, status bits; and which depth it is."""

    title: str
    direct_m: Float
    mpi_m: Float
    confidence_v: Float
    sigma_m: Float
    status: Status
    truth_m: Float | None = None
    first_phasor_m: Float | None = None
    depth: str = "depth"


@dataclass(frozen=True)
class _Panel:
    title: str
    values: Float
    one_path: bool = False


@dataclass(frozen=True)
class _Group:
    """Panels that are compared: one scale, one bar of colours."""

    panels: tuple[_Panel, ...]
    unit: str
    colours: str
    limits: tuple[float, float]


def draw_maps(picture: MapPicture, path: Path, /, *, kind: str = "png") -> None:
    """Draw the maps as a picture of a kind such as png or pdf; a legend tells the colours of pixels that have no depth."""
    groups = _groups(picture)
    count = sum(len(group.panels) for group in groups)
    height, width = picture.direct_m.shape
    aspect = width / height
    rows, columns = (count, 1) if aspect > _WIDE else (1, count) if aspect < _TALL else (2, count // 2)
    panel = np.clip(math.sqrt(_PANEL_AREA * aspect), 1.6, 9.0)
    size = (columns * (panel + 1.3), rows * (max(panel / aspect, 0.8) + 0.75) + 0.8)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    # side by side where there are two rows, so that what is compared has one bar
    order = [(panel, group) for group in groups for panel in range(len(group.panels))]
    places = list(axes.ravel()) if 1 in (rows, columns) else _in_two_rows(axes, [len(group.panels) for group in groups])
    figure.suptitle(drawable(picture.title), parse_math=False)
    assert len(order) == len(places)
    free, shown = iter(places), set[str]()
    for group in groups:
        cells = [next(free) for _ in group.panels]
        images = [
            _draw(cell, panel, group, picture.status, shown) for cell, panel in zip(cells, group.panels, strict=True)
        ]
        _bar(figure, images[0], cells, group)
    if shown:
        patches = [Patch(facecolor=colour, edgecolor="black", label=name) for name, colour in _CLASSES if name in shown]
        figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=9, frameon=False)
    figure.savefig(path, dpi=110, format=kind)


_CLASSES = (("one path: no MPI", ONE_PATH), ("no answer", NO_ANSWER), ("saturated", SATURATED))


def _in_two_rows(axes: NDArray[np.object_], sizes: Sequence[int]) -> list[Axes]:
    """Return cells for groups of one or two panels: two groups above each other, in the columns that they need."""
    cells: list[Axes] = []
    column = 0
    for upper, lower in zip(sizes[::2], sizes[1::2], strict=True):
        assert upper == lower
        cells += [*axes[0, column : column + upper], *axes[1, column : column + lower]]
        column += upper
    return cells


def _groups(picture: MapPicture) -> list[_Group]:
    """Return depth, error or sigma, MPI depth and confidence, in this order."""
    direct, first, truth = picture.direct_m, picture.first_phasor_m, picture.truth_m
    word, compared = picture.depth, truth is not None and first is not None
    depths = [_Panel(f"direct {word}", direct)]
    shown = [direct, *([] if truth is None else [truth]), *([first] if compared and first is not None else [])]
    if compared and first is not None:
        depths.insert(0, _Panel("first phasor alone", first))
    groups = [_Group(tuple(depths), "m", "viridis", _limits(np.concatenate([one.ravel() for one in shown])))]
    if truth is None:
        sigma = 100 * picture.sigma_m
        panel = _Panel(f"predicted σ of direct {word}", sigma)
        groups.append(_Group((panel,), "cm", "magma", (0.0, _limits(sigma)[1])))
    else:
        named = [("first phasor", first)] if compared and first is not None else []
        errors = [_error(name, depth, truth) for name, depth in (*named, ("direct", direct))]
        limit = max(_error_limit(error.values) for error in errors)
        groups.append(_Group(tuple(errors), "cm", "RdBu_r", (-limit, limit)))
    groups.append(
        _Group((_Panel(f"MPI {word}", picture.mpi_m, one_path=True),), "m", "viridis", _limits(picture.mpi_m))
    )
    confidence = 1000 * picture.confidence_v
    groups.append(_Group((_Panel("confidence", confidence),), "mV", "gray", (0.0, _limits(confidence)[1])))
    return groups


def _error(name: str, depth: Float, truth: Float) -> _Panel:
    error = 100 * (depth - truth)
    finite = np.abs(error[np.isfinite(error)])
    median = f": median {np.median(finite):.2f} cm off" if finite.size else ""
    return _Panel(f"{name} − truth{median}", error)


def _error_limit(error: Float) -> float:
    finite = np.abs(error[np.isfinite(error)])
    return max(float(np.percentile(finite, 90)), 1e-3) if finite.size else 1.0


def _limits(values: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range that all but the outermost half per cent of the finite values lie in, a little widened."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (0.5, 99.5))
    margin = 0.02 * (high - low) + 1e-6
    return float(low - margin), float(high + margin)


def _draw(axes: Axes, panel: _Panel, group: _Group, status: Status, shown: set[str]) -> AxesImage:
    low, high = group.limits
    cmap = mpl.colormaps[group.colours].with_extremes(bad=NO_ANSWER)
    image = axes.imshow(np.ma.masked_invalid(panel.values), cmap=cmap, vmin=low, vmax=high, interpolation="nearest")
    missing = ~np.isfinite(panel.values)
    classes: list[tuple[str, Bool]] = [("saturated", missing & ((status & StatusBit.SATURATED) != 0))]
    if panel.one_path:
        classes.append(("one path: no MPI", missing & ((status & StatusBit.ONE_PATH) != 0)))
    overlay = np.zeros((*missing.shape, 4))
    for name, pixels in classes:
        if pixels.any():
            overlay[pixels] = (*to_rgb(dict(_CLASSES)[name]), 1.0)
            shown.add(name)
            missing = missing & ~pixels
    if overlay.any():
        axes.imshow(overlay, interpolation="nearest")
    if missing.any():
        shown.add("no answer")
    axes.set_title(f"{panel.title}, {group.unit}" if ":" not in panel.title else panel.title, fontsize=10)
    axes.set_xlabel("column, px", fontsize=8)
    axes.set_ylabel("row, px", fontsize=8)
    axes.tick_params(labelsize=7)
    return image


def _bar(figure: Figure, image: AxesImage, cells: list[Axes], group: _Group) -> None:
    low, high = group.limits
    values = np.concatenate([panel.values[np.isfinite(panel.values)].ravel() for panel in group.panels])
    beyond = values.size and (values.min() < low, values.max() > high)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond or (False, False), "neither")
    bar = figure.colorbar(image, ax=cells, extend=extend, aspect=30, pad=0.02)
    bar.set_label(group.unit, fontsize=8)
    bar.ax.tick_params(labelsize=7)
