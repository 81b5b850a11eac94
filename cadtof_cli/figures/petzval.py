"""Cross-sections of flat walls before and after the correction of field curvature, as in the paper's Fig. 4(c)."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from cadtof_cli.arrays import Float
from cadtof_cli.calibration.petzval import PetzvalCalibration
from cadtof_cli.capture.metadata import Optics
from cadtof_cli.figures.canvas import Figure, drawable, legend_beside
from cadtof_cli.figures.kinds import save
from cadtof_cli.optics import squared_field_radius, wall_range_m
from cadtof_cli.units import unambiguous_range_m

ROWS = 5
"""Number of rows around the principal point; their median is drawn."""

DOTS_PER_INCH = 110

_BEFORE: dict[str, Any] = {"ls": "", "marker": "x", "ms": 4, "color": "tab:red"}
_AFTER: dict[str, Any] = {"ls": "", "marker": ".", "ms": 5, "color": "tab:blue"}
"""Styles of points before and after the correction. Their shapes tell them apart in black and white, too."""


def draw_petzval(ranges_m: Sequence[Float], petzval: PetzvalCalibration, path: Path, /) -> None:
    """Draw a row of plots per wall: planar depth along the row next to the principal point, and deviation from flat.

    `ranges_m` is the measured range of each wall of the calibration in m, (Y, X).
    """
    figure = Figure(figsize=(15.0, 3.4 * len(ranges_m) + 0.5), layout="constrained")
    axes = figure.subplots(len(ranges_m), 2, squeeze=False)
    quality, curvature = petzval.quality, petzval.curvature
    figure.suptitle(
        f"Field curvature: k2 = {_with_error_cm(curvature.k2_m, curvature.k2_stderr_m)}, "
        f"k4 = {_with_error_cm(curvature.k4_m, curvature.k4_stderr_m)}; residual RMS "
        f"{1000 * quality.rms_before_m:.2f} mm before, {1000 * quality.rms_after_m:.2f} mm after, "
        f"{1000 * quality.noise_rms_m:.2f} mm by noise",
        fontsize=10,
    )
    optics = Optics(focal_length_px=quality.focal_length_px, principal_point_px=curvature.principal_point_px)
    facing = wall_range_m(optics, petzval.origin.pixels, distance_m=1.0)
    for row, capture, range_m, wall in zip(axes, petzval.origin.captures, ranges_m, quality.walls, strict=True):
        name = Path(capture).name
        flat = wall_range_m(optics, petzval.origin.pixels, distance_m=wall.distance_m, slopes=wall.slopes)
        unwrapped = _unwrapped(range_m, flat + petzval.range_offset_m, petzval)
        _section(row[0], name, unwrapped, petzval, flat, facing)
        _radial(row[1], name, unwrapped, petzval, flat)
    save(figure, path, dpi=DOTS_PER_INCH)


def _unwrapped(range_m: Float, fitted_m: Float, petzval: PetzvalCalibration) -> Float:
    """Return the ranges with as many unambiguous ranges added as bring them near the fitted wall."""
    unambiguous = unambiguous_range_m(petzval.origin.periods_ns[0])
    return np.asarray(range_m + unambiguous * np.round((fitted_m - range_m) / unambiguous))


def _with_error_cm(value_m: float, stderr_m: float) -> str:
    """Return a length and its standard error in cm, as text with two digits of the error."""
    decimals = max(2, 1 - math.floor(math.log10(100.0 * stderr_m))) if stderr_m > 0.0 else 2
    return f"{100.0 * value_m:.{decimals}f} ± {100.0 * stderr_m:.{decimals}f} cm"


def _section(axes: Axes, name: str, range_m: Float, petzval: PetzvalCalibration, flat: Float, facing: Float) -> None:
    height = len(flat)
    middle = min(max(round(petzval.curvature.principal_point_px[1]), 0), height - 1)
    rows = slice(max(middle - ROWS // 2, 0), min(middle + ROWS // 2 + 1, height))
    columns = np.arange(flat.shape[1])
    corrected = range_m - petzval.range_offset_m
    for values, label, style in ((range_m, "before", _BEFORE), (corrected, "after", _AFTER)):
        medians = [_median(column) for column in (values / facing)[rows].T]
        axes.plot(columns, medians, **style, label=label)
    axes.plot(columns, (flat / facing)[middle], color="black", linewidth=1, label="flat wall, as fitted")
    axes.set(xlabel="column, px", ylabel="planar depth, m")
    _finish(axes, f"{name}: rows {rows.start} to {rows.stop - 1}")


def _radial(axes: Axes, name: str, range_m: Float, petzval: PetzvalCalibration, flat: Float) -> None:
    rho = np.sqrt(squared_field_radius(petzval.origin.pixels, petzval.curvature.principal_point_px))
    edges = np.linspace(0.0, float(rho.max()), 41)
    place = np.digitize(rho.ravel(), edges[1:-1])
    centres = 0.5 * (edges[1:] + edges[:-1])
    before = 100 * (range_m - flat)
    after = before - 100 * petzval.range_offset_m
    for values, label, style in ((before, "before", _BEFORE), (after, "after", _AFTER)):
        medians = [_median(values.ravel()[place == index]) for index in range(centres.size)]
        axes.plot(centres, medians, **style, label=f"{label}, median of a ring")
    curve = 100 * (petzval.curvature.k2_m * centres**2 + petzval.curvature.k4_m * centres**4)
    axes.plot(centres, curve, color="black", linewidth=1, label="k2 ρ² + k4 ρ⁴")
    axes.set(xlabel="ρ, distance from the principal point over half the diagonal", ylabel="range − flat wall, cm")
    _finish(axes, name)


def _finish(axes: Axes, title: str) -> None:
    axes.set_title(drawable(title), parse_math=False)
    legend_beside(axes)
    axes.grid(alpha=0.3)


def _median(values: Float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")
