"""Figs. 2 and 3: the effect of MPI on one pixel, photon by photon."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cadtof_cli.execution.workers import Workers
from cadtof_cli.figures.pixel_evolution import plot_histogram, plot_phase, plot_voltages
from cadtof_cli.figures.sweep_maps import MARKERS
from cadtof_cli.files.documents import write_rows
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.evolution import evolution
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.workflows.simulate.outcome import TrialsSummary
from cadtof_cli.workflows.simulate.simulate import simulate_trials
from cadtof_cli.workflows.simulate.sweep import SweepSettings, rows, sweep, table_text
from cadtof_cli.workflows.simulate.trials import Trials
from paper.effort import SEED, Effort

FIG_2 = (
    Condition(asr=1.0, mpi_ratio=0.0, direct_ns=10.0, second_ns=17.0),
    Condition(asr=0.8, mpi_ratio=0.3, direct_ns=10.0, second_ns=17.0),
)
"""Paths at 90° and 153° of 40 ns; the conditions of Fig. 2 (a, c, e) and (b, d, f)."""

PIXEL = PixelModel(averaging=Averaging(integration_length=4000.0), cycles=10_000, photons_per_cycle=5)

FIG_3_ASRS = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
FIG_3_RATIOS = (0.0, 0.1, 0.2, 0.3)


@dataclass(frozen=True)
class Figure2:
    """Mean phase error of each condition over many recordings, and its standard error, in degrees."""

    error_deg: tuple[float, float]
    standard_error_deg: tuple[float, float]


def figure_2(effort: Effort) -> Figure2:
    """Draw one recording of each condition; measure the phase error over many."""
    figure = Figure(figsize=(13, 9), dpi=110, layout="constrained")
    grid = figure.subplots(3, 2)
    errors, uncertainties = [], []
    for column, condition in enumerate(FIG_2):
        recording = evolution(
            PIXEL, condition.mix(PIXEL.modulation.periods_ns[0]), np.random.default_rng([SEED, column])
        )
        plot_histogram(grid[0, column], recording, condition)
        plot_voltages(grid[1, column], recording)
        plot_phase(grid[2, column], recording, condition)
        title = "no MPI, ASR 1" if condition.mpi_ratio == 0 else f"MPI/laser {condition.mpi_ratio:g}, ASR 0.8"
        grid[0, column].set_title(title)
        name = "ace" if column == 0 else "bdf"
        write_rows(
            effort.out / f"fig2_{name}.csv",
            ("photons", "sc1_v", "sc2_v", "phase_deg"),
            zip(recording.photons, *recording.voltages_v, recording.phase_deg, strict=True),
        )
        trials = Trials(
            condition=condition, model=PIXEL, runs=effort.pixel_runs, photon_by_photon=True, seed=SEED, stream=column
        )
        (outcome,) = simulate_trials((trials,), workers=Workers(jobs=effort.jobs))
        errors.append(math.degrees(outcome.phase_bias_rad))
        uncertainties.append(math.degrees(outcome.phase_std_rad) / math.sqrt(effort.pixel_runs))
    figure.savefig(effort.out / "fig2.png")
    return Figure2((errors[0], errors[1]), (uncertainties[0], uncertainties[1]))


@dataclass(frozen=True)
class Figure3:
    """Largest deviations of the simulation from the analytical models, and how the phase error varies with ASR.

    Attributes:
        confidence_mix: relative deviation of the confidence from the model of the whole mix.
        confidence_single: relative deviation of the confidence from the one-path model A·r1/(1 + ASR), with ASR as
            ambient photons over laser and MPI photons.
        precision_mix: relative deviation of the phase precision from the model of the whole mix.
        precision_single: relative deviation of the phase precision from the same one-path model.
        error_deg: mean phase error by MPI ratio.
        error_spread_deg: largest minus smallest phase error over ASR, by MPI ratio.
        error_noise_deg: largest standard error of one of these phase errors, by MPI ratio.
        precision: phase precision at the largest MPI ratio, by ASR.
    """

    confidence_mix: float
    confidence_single: float
    precision_mix: float
    precision_single: float
    error_deg: dict[float, float]
    error_spread_deg: dict[float, float]
    error_noise_deg: dict[float, float]
    precision: "list[Precision]"


@dataclass(frozen=True)
class Precision:
    """Phase precision at one condition in degrees, and by which factors it exceeds the one-path model.

    Attributes:
        seen_deg: precision of the simulation photon by photon.
        single_deg: precision of the one-path model, with MPI counted as signal.
        shorter: confidence of the one-path model over that of the mix: two phasors add up to less than their sum.
        wider: standard deviation of the mix across its phasor over that of the one-path model.
    """

    asr: float
    seen_deg: float
    single_deg: float
    shorter: float
    wider: float


def figure_3(effort: Effort) -> Figure3:
    """Sweep ASR and MPI ratio photon by photon, and draw confidence, precision and error."""
    base = Trials(condition=FIG_2[1], model=PIXEL, runs=effort.pixel_runs, photon_by_photon=True, seed=SEED)
    settings = SweepSettings(base=base, asrs=FIG_3_ASRS, mpi_ratios=FIG_3_RATIOS, integration_lengths=(4000.0,))
    cells = sweep(settings, workers=Workers(jobs=effort.jobs))
    (effort.out / "fig3.csv").write_text(table_text(cells), newline="")
    single = [_single_path(cell.trials.condition) for cell in cells]
    draw_figure_3(list(rows(cells)), effort.out)
    by_ratio = {ratio: [cell for cell in cells if cell.trials.condition.mpi_ratio == ratio] for ratio in FIG_3_RATIOS}
    errors = {r: [math.degrees(cell.phase_bias_rad) for cell in group] for r, group in by_ratio.items()}
    noise = {r: max(math.degrees(cell.phase_std_rad) for cell in group) for r, group in by_ratio.items()}
    return Figure3(
        max(abs(cell.confidence_v / cell.confidence_model_v - 1) for cell in cells),
        max(abs(cell.confidence_v / model[0] - 1) for cell, model in zip(cells, single, strict=True)),
        max(abs(row["phase_std_rad"] / row["phase_model_std_rad"] - 1) for row in rows(cells)),
        max(abs(cell.phase_std_rad / model[1] - 1) for cell, model in zip(cells, single, strict=True)),
        {ratio: float(np.mean(values)) for ratio, values in errors.items()},
        {ratio: max(values) - min(values) for ratio, values in errors.items()},
        {ratio: value / math.sqrt(effort.pixel_runs) for ratio, value in noise.items()},
        [_precision(cell) for cell in by_ratio[max(FIG_3_RATIOS)]],
    )


def _precision(cell: TrialsSummary) -> Precision:
    confidence_v, precision_rad = _single_path(cell.trials.condition)
    (row,) = rows([cell])
    shorter = confidence_v / cell.confidence_model_v
    return Precision(
        cell.trials.condition.asr,
        math.degrees(cell.phase_std_rad),
        math.degrees(precision_rad),
        shorter,
        row["phase_model_std_rad"] / precision_rad / shorter,
    )


def _single_path(condition: Condition) -> tuple[float, float]:
    """Return the one-path model's confidence in V and precision in rad, with MPI counted as signal."""
    asr, modulation = condition.asr / (1.0 + condition.mpi_ratio), PIXEL.modulation
    spread = condition.mix(modulation.periods_ns[0]).spread_rad
    first, second = math.exp(-(spread**2) / 2), math.exp(-2 * spread**2)
    across = (1 - second / (1 + asr)) / 2 / (2 * PIXEL.averaging.integration_length - 1)
    return modulation.amplitude_v * first / (1 + asr), math.sqrt(across) * (1 + asr) / first


def read_table(path: Path) -> list[dict[str, float]]:
    """Read the CSV of a sweep, as `table_text` makes it; empty cells are NaN."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: float(cell or "nan") for name, cell in row.items()} for row in csv.DictReader(file)]


def draw_figure_3(table: Sequence[Mapping[str, float]], out: Path) -> None:
    """Draw confidence, precision and error of a sweep over ASR and MPI ratio."""
    figure = Figure(figsize=(13, 4), dpi=110, layout="constrained")
    axes = figure.subplots(1, 3)
    single_deg = [
        math.degrees(_single_path(replace(FIG_2[1], asr=row["asr"], mpi_ratio=row["mpi_ratio"]))[1]) for row in table
    ]
    for index, ratio in enumerate(FIG_3_RATIOS):
        chosen = [i for i, row in enumerate(table) if row["mpi_ratio"] == ratio]
        asr = [table[i]["asr"] for i in chosen]
        colour, label = f"C{index}", f"MPI/laser {ratio:g}"
        marker = MARKERS[index]
        axes[0].plot(asr, [1e3 * table[i]["confidence_v"] for i in chosen], marker, color=colour, label=label)
        axes[0].plot(asr, [1e3 * table[i]["confidence_model_v"] for i in chosen], "-", color=colour, lw=1)
        axes[1].plot(asr, [math.degrees(table[i]["phase_std_rad"]) for i in chosen], marker, color=colour)
        axes[1].plot(asr, [math.degrees(table[i]["phase_model_std_rad"]) for i in chosen], "-", color=colour, lw=1)
        axes[1].plot(asr, [single_deg[i] for i in chosen], ":", color=colour, lw=1)
        axes[2].errorbar(
            asr,
            [math.degrees(table[i]["phase_bias_rad"]) for i in chosen],
            [math.degrees(table[i]["phase_std_rad"]) for i in chosen],
            fmt=f"{marker}-",
            lw=1,
            color=colour,
        )
    for axis, name in zip(axes, ("confidence, mV", "phase precision, °", "phase error, °"), strict=True):
        axis.set(xlabel="ambient-to-signal ratio", ylabel=name)
        axis.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", fontsize=8)
    figure.suptitle(
        "Points: photon by photon, n_av 4000; lines: analytical model of the mix; dotted: one-path model, MPI as signal;\n"
        "vertical bars: the standard deviation of single runs",
        fontsize=10,
    )
    figure.savefig(out / "fig3.png")
