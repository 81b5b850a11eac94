"""A picture of a frame's maps: direct depth, MPI depth, confidence, and the error where truth is known, else sigma."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cadtof_cli.arrays import Float

NO_ANSWER = "0.82"


@dataclass(frozen=True)
class MapPicture:
    """What the picture shows, (Y, X) each: depths, sigma and truth in m, confidence in V."""

    title: str
    direct_m: Float
    mpi_m: Float
    confidence_v: Float
    sigma_m: Float
    truth_m: Float | None = None
    first_phasor_m: Float | None = None


def draw_maps(picture: MapPicture, path: Path, /, *, kind: str = "png") -> None:
    """Draw the maps as a picture of a kind such as png or pdf; pixels without an answer are light grey."""
    panels = 4 if picture.first_phasor_m is None else 6
    figure = Figure(figsize=(11.0, 8.2 * panels / 4 / (1.5 if panels == 6 else 1)), layout="constrained")
    if panels == 6:
        figure.set_size_inches(15.0, 8.2)
    axes = figure.subplots(2, panels // 2)
    figure.suptitle(picture.title)
    shared = np.concatenate([picture.direct_m.ravel(), [] if picture.truth_m is None else picture.truth_m.ravel()])
    near, far = _limits(shared)
    cells = iter(axes.ravel() if panels == 4 else axes.T.ravel())
    if picture.first_phasor_m is not None and picture.truth_m is not None:
        _panel(figure, next(cells), picture.first_phasor_m, "first phasor alone, m", "viridis", near, far)
        _error_panel(figure, next(cells), picture.first_phasor_m, picture.truth_m, "first phasor − truth, cm", None)
    _panel(figure, next(cells), picture.direct_m, "direct depth, m", "viridis", near, far)
    if picture.truth_m is None:
        _panel(figure, next(cells), 100 * picture.sigma_m, "predicted σ of direct depth, cm", "magma", 0, None)
    else:
        limit = _error_limit(picture.first_phasor_m, picture.truth_m) if picture.first_phasor_m is not None else None
        _error_panel(figure, next(cells), picture.direct_m, picture.truth_m, "direct − truth, cm", limit)
    _panel(figure, next(cells), picture.mpi_m, "MPI depth, m (grey: one path)", "viridis", None, None)
    _panel(figure, next(cells), 1000 * picture.confidence_v, "confidence, mV", "gray", 0, None)
    figure.savefig(path, dpi=110, format=kind)


def _limits(values: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range that all but the outermost half per cent of the finite values lie in, a little widened."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, (0.5, 99.5))
    margin = 0.02 * (high - low) + 1e-6
    return float(low - margin), float(high + margin)


def _panel(
    figure: Figure, axes: Axes, values: Float, title: str, colours: str, low: float | None, high: float | None
) -> None:
    finite = values[np.isfinite(values)]
    if low is None or high is None:
        auto_low, auto_high = _limits(values)
        low, high = (auto_low if low is None else low), (auto_high if high is None else high)
    cmap = mpl.colormaps[colours].with_extremes(bad=NO_ANSWER)
    image = axes.imshow(np.ma.masked_invalid(values), cmap=cmap, vmin=low, vmax=high, interpolation="nearest")
    axes.set_title(title, fontsize=10)
    axes.tick_params(labelsize=7)
    extend = "neither" if not finite.size or (finite.min() >= low and finite.max() <= high) else "both"
    figure.colorbar(image, ax=axes, shrink=0.8, extend=extend)


def _error_panel(figure: Figure, axes: Axes, depth: Float, truth: Float, title: str, limit: float | None) -> None:
    limit = _error_limit(depth, truth) if limit is None else limit
    error = 100 * (depth - truth)
    finite = np.abs(error[np.isfinite(error)])
    median = f"  (median |error| {np.median(finite):.2f} cm)" if finite.size else ""
    _panel(figure, axes, error, title + median, "RdBu_r", -limit, limit)


def _error_limit(depth: Float, truth: Float) -> float:
    error = 100 * np.abs(depth - truth)
    finite = error[np.isfinite(error)]
    return float(np.percentile(finite, 90)) if finite.size else 1.0
