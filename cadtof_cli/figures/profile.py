"""A cross-section of maps, as in the paper's Figs. 4(c) and 5(d). Runs are drawn over each other, with their sigma."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from cadtof_cli.arrays import Float
from cadtof_cli.figures.canvas import Figure, drawable, legend_beside, within
from cadtof_cli.figures.kinds import save
from cadtof_cli.maps.layers import error_unit
from cadtof_cli.maps.profile import Curve, Profile
from cadtof_cli.units import shortened

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of runs, in their order. They are those of Okabe and Ito, which colour-blind people can tell apart."""

_LINES = ("-", "-.", ":")
"""Lines of runs, in their order: in black and white, they tell runs apart. No two of 18 runs share both colour and line."""

_ENTRY_IN, _BESIDE_ENTRIES_IN, _HIGHEST_IN = 0.17, 0.8, 100.0
"""Height of an entry of the legend, of what is above and below the legend, and of the largest picture, in inches."""

TRUTH_COLOUR = "#000000"

DOTS_PER_INCH = 130


def draw_profile(profile: Profile, path: Path, /) -> None:
    """Draw a cross-section, and below it the errors if truth is known; raises OutputError if the file cannot be written."""
    rows = 1 if profile.truth is None else 2
    figure = Figure(figsize=(10.0, 4.4 if rows == 1 else 6.6), layout="constrained")
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=(3, 2)[:rows])[:, 0]
    figure.suptitle(within(f"{profile.layer}, {profile.line}", 9.5, size=11), fontsize=11, parse_math=False)
    _values(panels[0], profile)
    if profile.truth is not None:
        _errors(panels[1], profile, profile.truth)
    panels[-1].set_xlabel(f"{profile.axis}, px")
    panels[0].set_xlim(profile.along.min() - 0.5, profile.along.max() + 0.5)
    legend_in = _ENTRY_IN * len(legend_beside(panels[0]).get_texts())
    # the legend stands beside the upper panel, whose share of the height is 3/5 if there are two
    needed_in = legend_in * (1.0 if rows == 1 else 5.0 / 3.0) + _BESIDE_ENTRIES_IN
    figure.set_figheight(max(figure.get_figheight(), min(needed_in, _HIGHEST_IN)))
    save(figure, path, dpi=DOTS_PER_INCH)


def _values(axes: Axes, profile: Profile) -> None:
    _curves(axes, profile, lambda values: values, 1.0)
    if profile.truth is not None:
        points = _points(profile.truth, fewest=0)
        axes.plot(profile.along, profile.truth, lw=1.0, **points, color=TRUTH_COLOUR, label="truth", zorder=1.9)
    what = profile.depth if profile.layer.endswith(".depth") else profile.layer
    axes.set_ylabel(f"{what}, {profile.unit}" if profile.unit else what)
    _to_lines(axes)


def _errors(axes: Axes, profile: Profile, truth: Float) -> None:
    factor, unit = error_unit(profile.unit)
    _curves(axes, profile, lambda values: factor * (values - truth), factor)
    axes.axhline(0.0, color=TRUTH_COLOUR, lw=0.8, zorder=1.9)
    axes.set_ylabel(f"error, {unit or '1'}")
    _to_lines(axes)


def _curves(axes: Axes, profile: Profile, shown: Callable[[Float], Float], factor: float) -> None:
    """Draw the curves of first phasors and runs; runs have a band of ± 1 sigma, multiplied by `factor`.

    `shown` turns the values of a curve into those that are drawn: the values themselves, or their errors.
    """
    for name, first, colour in _first_phasors(profile):
        depths = shown(first)
        axes.plot(profile.along, depths, **_DASHED, **_points(depths, fewest=0), color=colour, label=name)
    for number, (curve, name, colour) in enumerate(_named(profile)):
        values, line = shown(curve.values), _LINES[(number + number // len(COLOURS)) % len(_LINES)]
        if curve.sigma is not None:
            # maps of other programs may hold infinite depths with infinite sigma
            with np.errstate(invalid="ignore"):
                low, high = values - factor * curve.sigma, values + factor * curve.sigma
            label = f"{name}: ± 1 σ, predicted"
            axes.fill_between(profile.along, low, high, color=colour, alpha=0.2, lw=0, label=label)
        axes.plot(profile.along, values, lw=1.3, ls=line, **_points(values), color=colour, label=name)


_DASHED: dict[str, Any] = {"lw": 1.0, "ls": (0, (4, 2)), "alpha": 0.8}

_FEW = 40
"""If a line has fewer pixels, its curve has a point at each pixel."""


def _named(profile: Profile) -> Iterator[tuple[Curve, str, str]]:
    """Yield each curve with its name, as a legend can show it, and its colour."""
    for number, curve in enumerate(profile.curves):
        name = shortened(drawable(curve.name), 34).replace("$", r"\$")
        # legends leave out a label that begins with `_`
        yield curve, name if name[:1] != "_" else f" {name}", COLOURS[number % len(COLOURS)]


def _first_phasors(profile: Profile) -> Iterator[tuple[str, Float, str]]:
    """Yield name, depths and colour of the first phasors; if all runs have the same depths, yield one curve in grey."""
    known = [(f"{name}: first phasor", curve.first_phasor, colour) for curve, name, colour in _named(profile)]
    found = [(name, first, colour) for name, first, colour in known if first is not None]
    if found and all(np.array_equal(first, found[0][1], equal_nan=True) for _, first, _ in found):
        found = [("first phasor", found[0][1], "0.35")]
    yield from found


def _points(values: Float, *, fewest: int = _FEW) -> dict[str, Any]:
    """Return the style of points for a curve of less than `fewest` pixels, or with a lone pixel, which a line would not show."""
    known = np.pad(np.isfinite(values), 1)
    alone = known[1:-1] & ~known[:-2] & ~known[2:]
    return {"marker": ".", "markersize": 3.0} if alone.any() or values.size < fewest else {}


def _to_lines(axes: Axes) -> None:
    """Fit the axis to the curves and not to the bands: a band can be so broad that the curves would look flat."""
    values = np.concatenate([np.asarray(line.get_ydata(), np.float64) for line in axes.get_lines()])
    finite = values[np.isfinite(values)]
    if finite.size:
        margin = 0.06 * float(np.ptp(finite)) + 1e-6 * max(1.0, float(np.abs(finite).max()))
        axes.set_ylim(float(finite.min()) - margin, float(finite.max()) + margin)
    axes.grid(alpha=0.25)
