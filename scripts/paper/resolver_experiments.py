"""Figs. 6 to 9 and Table 1: two paths resolved many times."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from cadtof_cli.arrays import Float
from cadtof_cli.execution.workers import Workers
from cadtof_cli.figures.pixel_evolution import plot_histogram
from cadtof_cli.figures.scales import DIRECT_COLOUR, MPI_COLOUR
from cadtof_cli.figures.sweep_maps import draw_path_maps
from cadtof_cli.files.documents import write_rows
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel, evolution
from cadtof_cli.workflows.simulate.outcome import TrialsSummary, summary
from cadtof_cli.workflows.simulate.simulate import simulate_trials
from cadtof_cli.workflows.simulate.sweep import SweepSettings, rows, sweep, table_text
from cadtof_cli.workflows.simulate.trials import Recordings, Trials, recordings
from paper.effort import SEED, Effort

TABLE_1 = {"a": (16.0, 0.05, 0.16), "b": (25.0, 0.03, 0.12), "c": (11.0, 0.17, 0.52)}
"""Conditions of Fig. 7 (a), (b) and (c): time of the second peak, and the paper's standard deviations of both peaks, in ns."""

GRID_ASRS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
GRID_LENGTHS = (1.0e3, 3.0e3, 1.0e4, 3.0e4, 1.0e5)

TWO_PATHS = ResolverSettings(order="2")
"""The paper's solver always returns two peaks."""

PAPER_WAY = ResolverSettings(solver="lm", order="2", starts=10, returns="strongest")
"""Eq. (9) from ten random starts. The stronger peak is called the first: this fits what the paper says of the first
peak without MPI. Calling the earlier peak the first does not fit."""

SEEDS = range(20)

WORST = ((0.3, 3.4), (0.1, 12.8))
"""MPI ratio and the paper's largest standard deviation of the second path, at ASR 6 and n_av 1e3."""


def as_the_paper(trials: Trials) -> Trials:
    """Return the same trials the paper's way: its solver, no correction of the pulse, times within ±20 ns as angles come."""
    return replace(trials, resolver=PAPER_WAY, pulse_correction=False, wrapped=True)


def pixel(integration_length: float) -> PixelModel:
    """Return the paper's pixel."""
    return PixelModel(averaging=Averaging(integration_length=integration_length))


def condition(second_ns: float) -> Condition:
    """Return a condition of Table 1."""
    return Condition(asr=5.0, mpi_ratio=0.3, direct_ns=5.0, second_ns=second_ns)


def figure_6(effort: Effort) -> None:
    """Draw arrivals at 5 and 16 ns, as in Table 1, and at 10 and 16 ns, as in the text, with both harmonics."""
    figure = Figure(figsize=(13, 3.6), dpi=110, layout="constrained")
    for axes, direct_ns in zip(figure.subplots(1, 2), (5.0, 10.0), strict=True):
        shown = Condition(asr=5.0, mpi_ratio=0.3, direct_ns=direct_ns)
        recording = evolution(pixel(2.0e4), shown.mix(40.0), np.random.default_rng([SEED, 6]))
        plot_histogram(axes, recording, shown, harmonics=(1, 2))
        axes.set_title(f"{direct_ns:g} and 16 ns")
        write_rows(
            effort.out / f"fig6_{direct_ns:g}ns.csv",
            ("time_ns", "photons"),
            zip(recording.bin_ns, recording.counts, strict=True),
        )
    figure.savefig(effort.out / "fig6.png")


@dataclass(frozen=True)
class Table1Row:
    """One condition of Table 1.

    Attributes:
        name: part of Fig. 7.
        statistics: ours by statistics, at the paper's integration length.
        paper_way: the paper's way by statistics, at the same integration length.
        photons: ours photon by photon, at `photon_length`.
        photon_length: integration length of `photons`.
    """

    name: str
    statistics: TrialsSummary
    paper_way: TrialsSummary
    photons: TrialsSummary
    photon_length: float


def table_1(effort: Effort) -> list[Table1Row]:
    """Resolve each condition both ways, and draw the scatter of Fig. 7."""
    made, scatter = [], {}
    for name, (second_ns, *_) in TABLE_1.items():
        exact = Trials(
            condition=condition(second_ns), model=pixel(1.0e5), resolver=TWO_PATHS, runs=effort.resolver_runs, seed=SEED
        )
        by_photons = replace(
            exact,
            model=pixel(effort.photon_length),
            photon_by_photon=True,
            runs=effort.resolver_runs,
            stream=ord(name),
        )
        found = Recordings.joined([recordings(exact, runs) for runs in exact.blocks])
        scatter[name] = found.times_ns
        write_rows(effort.out / f"fig7{name}.csv", ("direct_ns", "second_ns"), scatter[name].T)
        (photons,) = simulate_trials((by_photons,), workers=Workers(jobs=effort.jobs))
        (paper_way,) = simulate_trials((as_the_paper(exact),))
        made.append(Table1Row(name, summary(exact, found), paper_way, photons, effort.photon_length))
    draw_figure_7(scatter, effort.out)
    _write_table_1(effort, made)
    return made


def draw_figure_7(scatter: Mapping[str, Float], out: Path) -> None:
    """Draw first and second peaks, (2, n) in ns, of each condition of Table 1, and the paper's success region about the truth."""
    figure = Figure(figsize=(13, 4.2), dpi=110, layout="constrained")
    for axes, (name, times) in zip(figure.subplots(1, len(scatter)), scatter.items(), strict=True):
        second_ns = TABLE_1[name][0]
        axes.plot(times[0], times[1], ".", ms=3, color=DIRECT_COLOUR, label=f"{times.shape[1]} solves")
        axes.plot(5.0, second_ns, "o", color=MPI_COLOUR, ms=5, label="truth")
        region = Rectangle((4.0, second_ns - 1.0), 2.0, 2.0, fill=False, color=MPI_COLOUR, label="truth ± 1 ns")
        axes.add_patch(region)
        axes.set(xlim=(3.5, 6.5), ylim=(second_ns - 2.5, second_ns + 2.5), aspect="auto")
        axes.set(xlabel="first peak, ns", ylabel="second peak, ns", title=f"({name}) 5 and {second_ns:g} ns")
        axes.grid(alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    figure.savefig(out / "fig7.png")


def _write_table_1(effort: Effort, made: list[Table1Row]) -> None:
    lines = [
        "figure,second_ns,path,paper_std_ns,as_the_paper_std_ns,statistics_std_ns,photons_std_ns,bound_ns,photon_length"
    ]
    for row in made:
        second_ns, *paper = TABLE_1[row.name]
        for path, stated in zip(("direct", "second"), paper, strict=True):
            theirs, ours, counted = (getattr(one, path) for one in (row.paper_way, row.statistics, row.photons))
            lines.append(
                f"7{row.name},{second_ns:g},{path},{stated},{theirs.std_ns:.4f},{ours.std_ns:.4f},{counted.std_ns:.4f},"
                f"{ours.bound_ns:.4f},{row.photon_length:g}"
            )
    (effort.out / "table1.csv").write_text("\n".join(lines) + "\n")


@dataclass(frozen=True)
class Maps:
    """Figs. 8 and 9: every cell, for MPI ratios 0.3, 0.1 and 0.

    Attributes:
        ours: always two paths at MPI 0.3 and 0.1; the order test at 0.
        always_two: always two paths at 0, with the pulse corrected.
        as_the_paper: all cells the paper's way.
        seeds: standard deviation of the second path, the paper's way at `WORST`, by MPI ratio, for every seed.
    """

    ours: list[TrialsSummary]
    always_two: list[TrialsSummary]
    as_the_paper: list[TrialsSummary]
    seeds: dict[float, list[float]]


def figures_8_and_9(effort: Effort) -> Maps:
    """Sweep ASR and integration length, and draw bias and standard deviation."""
    base = Trials(
        condition=condition(16.0), model=pixel(1.0e5), resolver=TWO_PATHS, runs=effort.resolver_runs, seed=SEED
    )

    def swept(trials: Trials, ratios: tuple[float, ...]) -> list[TrialsSummary]:
        settings = SweepSettings(base=trials, asrs=GRID_ASRS, mpi_ratios=ratios, integration_lengths=GRID_LENGTHS)
        return sweep(settings, workers=Workers(jobs=effort.jobs))

    with_mpi = swept(base, (0.3, 0.1))
    without = swept(replace(base, resolver=ResolverSettings(), runs=10 * effort.resolver_runs), (0.0,))
    paper_way = swept(as_the_paper(base), (0.3, 0.1, 0.0))
    maps = Maps(
        with_mpi + without, swept(base, (0.0,)), paper_way, {ratio: _over_seeds(base, ratio) for ratio, _ in WORST}
    )
    for name, cells in (("", maps.ours), ("_always_two", maps.always_two), ("_as_the_paper", maps.as_the_paper)):
        (effort.out / f"fig8_9{name}.csv").write_text(table_text(cells), newline="")
    draw_figures_8_and_9(list(rows(maps.ours)), list(rows(maps.as_the_paper)), effort.out)
    return maps


def draw_figures_8_and_9(
    ours: Sequence[Mapping[str, float]], as_the_paper: Sequence[Mapping[str, float]], out: Path
) -> None:
    """Draw bias and standard deviation of both sweeps."""
    for suffix, table, whose in (("", ours, "ours"), ("_as_the_paper", as_the_paper, "as the paper")):
        for figure, column, title in (
            ("fig8", "bias_ns", f"Fig. 8, {whose}: mean error of the resolved time"),
            ("fig9", "std_ns", f"Fig. 9, {whose}: standard deviation of the resolved time"),
        ):
            draw_path_maps(table, column, out / f"{figure}{suffix}.png", title=title)


def _over_seeds(base: Trials, ratio: float) -> list[float]:
    """Return the second path's standard deviation at ASR 6 and n_av 1e3, the paper's way, for every seed."""
    worst = replace(base, condition=replace(base.condition, asr=6.0, mpi_ratio=ratio), model=pixel(1.0e3))
    by_seed = [replace(as_the_paper(worst), seed=seed) for seed in SEEDS]
    return [outcome.second.std_ns for outcome in simulate_trials(by_seed)]


def extremes(
    cells: list[TrialsSummary], ratio: float, path: str, column: str, *, longest: float = math.inf
) -> tuple[float, float]:
    """Return the smallest and the largest magnitude of a column over the cells of one MPI ratio, up to the n_av `longest`."""
    values = [
        abs(getattr(getattr(cell, path), column))
        for cell in cells
        if cell.trials.condition.mpi_ratio == ratio and cell.trials.model.averaging.integration_length <= longest
    ]
    finite = [value for value in values if math.isfinite(value)]
    return min(finite), max(finite)
