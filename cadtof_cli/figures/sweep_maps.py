"""A sweep as heat maps over ASR and integration length, and curves of its first phasor: the paper's Figs. 3, 8, 9."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LogNorm, Normalize, TwoSlopeNorm
from matplotlib.image import AxesImage

from cadtof_cli.arrays import Float
from cadtof_cli.figures.canvas import Figure

Table = Sequence[Mapping[str, float]]

DOTS_PER_INCH = 120

_READABLE_CELLS = 12
"""Largest number of columns of a map whose cells show their numbers."""

_MOST_LENGTHS, _MOST_ASRS = 5, 20
"""Largest number of integration lengths and of ASRs that the axes of a map show; with more, their numbers would overlap."""

MARKERS = "os^Dv"
"""Points of MPI ratios, in their order: colours alone do not tell the ratios apart in black and white."""

_TITLE_INCHES = 7.5
"""Least width of a figure of maps: that of its title."""


def draw_path_maps(table: Table, column: str, path: Path, /, *, title: str) -> None:
    """Draw one heat map of a column, `bias_ns` or `std_ns`, per path and MPI ratio, with the direct path on top."""
    ratios = sorted({row["mpi_ratio"] for row in table}, reverse=True)
    paths = [name.removesuffix(f"_{column}") for name in table[0] if name.endswith(f"_{column}")]
    names = [name for name in paths if any(np.isfinite(row[f"{name}_true_ns"]) for row in table)]
    width = max(1.2 + 3.9 * len(ratios), _TITLE_INCHES)
    figure = Figure(figsize=(width, 0.8 + 2.9 * len(names)), dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.subplots(len(names), len(ratios), squeeze=False)
    signed = column == "bias_ns"
    norm = _norm(np.array([entry[f"{name}_{column}"] for entry in table for name in names]), signed=signed)
    for row, name in enumerate(names):
        for axes, ratio in zip(grid[row], ratios, strict=True):
            chosen = [entry for entry in table if entry["mpi_ratio"] == ratio]
            if not np.isfinite(chosen[0][f"{name}_true_ns"]):
                axes.set_axis_off()
                continue
            image = _heat_map(axes, chosen, f"{name}_{column}", norm, signed=signed)
            axes.set_title(f"{name if name.startswith('path') else f'{name} path'}, MPI/laser {ratio:g}", fontsize=10)
    figure.colorbar(image, ax=grid, label="ns")
    figure.suptitle(f"{title}, ns")
    figure.savefig(path)


def draw_confidence(table: Table, path: Path, /) -> None:
    """Draw confidence, phase precision and phase error of the first phasor over ASR, one curve per MPI ratio.

    The curves are those of the longest integration length. Lines show the analytical model, points the simulation.
    """
    longest = max(row["integration_length"] for row in table)
    chosen = [row for row in table if row["integration_length"] == longest]
    ratios = sorted({row["mpi_ratio"] for row in chosen})
    figure = Figure(figsize=(11.5, 3.7), dpi=DOTS_PER_INCH, layout="constrained")
    for axes, (column, model, scale, label) in zip(
        figure.subplots(1, 3),
        (
            ("confidence_v", "confidence_model_v", 1e3, "confidence, mV"),
            ("phase_std_rad", "phase_model_std_rad", 180.0 / np.pi, "phase precision, °"),
            ("phase_bias_rad", None, 180.0 / np.pi, "phase error, °"),
        ),
        strict=True,
    ):
        for index, ratio in enumerate(ratios):
            rows = sorted((row for row in chosen if row["mpi_ratio"] == ratio), key=lambda row: row["asr"])
            asr = [row["asr"] for row in rows]
            points = {"marker": MARKERS[index % len(MARKERS)], "ls": "", "ms": 4}
            axes.plot(asr, [scale * row[column] for row in rows], **points, color=f"C{index}", label=f"{ratio:g}")
            if model:
                # a line of one point would not be seen
                line = "-" if len(asr) > 1 else "_"
                axes.plot(asr, [scale * row[model] for row in rows], line, lw=1, ms=24, color=f"C{index}")
            if column == "phase_bias_rad":
                errors = [scale * row["phase_std_rad"] for row in rows]
                axes.errorbar(asr, [scale * row[column] for row in rows], errors, fmt="none", color=f"C{index}", lw=0.8)
        axes.set(xlabel="ambient-to-signal ratio", ylabel=label)
    figure.legend(*axes.get_legend_handles_labels(), title="MPI/laser", loc="outside right center", fontsize=8)
    figure.suptitle(f"first phasor at integration length {longest:g}; lines: analytical model (Fig. 3 of the paper)")
    figure.savefig(path)


def _heat_map(axes: Axes, table: Table, column: str, norm: Normalize, *, signed: bool) -> AxesImage:
    asrs = sorted({row["asr"] for row in table})
    lengths = sorted({row["integration_length"] for row in table})
    values = np.full((len(asrs), len(lengths)), np.nan)
    for row in table:
        values[asrs.index(row["asr"]), lengths.index(row["integration_length"])] = row[column]
    image = axes.imshow(values, origin="lower", aspect="auto", cmap="RdBu_r" if signed else "viridis", norm=norm)
    columns, rows = _shown(len(lengths), _MOST_LENGTHS), _shown(len(asrs), _MOST_ASRS)
    axes.set_xticks(columns, [f"{lengths[column]:,.0f}" for column in columns], fontsize=8)
    axes.set_yticks(rows, [f"{asrs[row]:g}" for row in rows], fontsize=8)
    axes.set_xlabel("integration length", fontsize=9)
    axes.set_ylabel("ASR", fontsize=9)
    if len(lengths) <= _READABLE_CELLS:
        _write_numbers(axes, values, image.cmap, norm, digits="+.3f" if signed else "#.2g")
    return image


def _shown(count: int, most: int) -> list[int]:
    """Return numbers from 0 to count − 1: all of them, or every second, third and so on if there are more than `most`."""
    return list(range(0, count, -(-count // most)))


def _norm(values: Float, *, signed: bool) -> Normalize:
    finite = values[np.isfinite(values)]
    if signed:
        largest = float(np.abs(finite).max(initial=1e-3))
        return TwoSlopeNorm(0.0, -largest, largest)
    positive = finite[finite > 0]
    if not len(positive) or positive.min() == positive.max():
        return Normalize(0.0, float(positive.max(initial=1.0)))
    return LogNorm(float(positive.min()), float(positive.max()))


def _write_numbers(axes: Axes, values: Float, colours: Colormap, norm: Normalize, *, digits: str) -> None:
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            red, green, blue, _ = colours(norm(value))
            ink = "black" if 0.3 * red + 0.59 * green + 0.11 * blue > 0.5 else "white"
            shown = f"{value:{digits}}".rstrip(".").replace("-0.000", "0.000").replace("+0.000", "0.000")
        else:
            # no run found this path
            shown, ink = "none", "black"
        axes.text(column, row, shown.replace("-", "\N{MINUS SIGN}"), ha="center", va="center", fontsize=7, color=ink)
