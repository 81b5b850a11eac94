"""One recording of a pixel, as in the paper's Fig. 2: arrivals, voltages, phase."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cadtof_cli.simulation.pixel.evolution import Evolution
from cadtof_cli.simulation.pixel.mix import Condition

DIRECT_COLOUR, MPI_COLOUR, MEASURED_COLOUR, AMBIENT_COLOUR = "#1b6ca8", "#d1495b", "#222222", "#b8b8b8"

DOTS_PER_INCH = 120


def draw_histogram(recording: Evolution, condition: Condition, path: Path, /) -> None:
    """Draw when photons arrived within the period, with the modulation voltages over it."""
    figure, axes = _figure()
    plot_histogram(axes, recording, condition)
    figure.savefig(path)


def draw_voltages(recording: Evolution, path: Path, /) -> None:
    """Draw how SC1 and SC2 settle."""
    figure, axes = _figure()
    plot_voltages(axes, recording)
    figure.savefig(path)


def draw_phase(recording: Evolution, condition: Condition, path: Path, /) -> None:
    """Draw how the phase settles, beside that of the direct path."""
    figure, axes = _figure()
    plot_phase(axes, recording, condition)
    figure.savefig(path)


def plot_histogram(axes: Axes, recording: Evolution, condition: Condition, /) -> None:
    """Plot arrivals and modulation on the given axes."""
    width = recording.period_ns / len(recording.bin_ns)
    axes.bar(recording.bin_ns, recording.counts, width=width, color=AMBIENT_COLOUR)
    axes.axvline(condition.direct_ns, color=DIRECT_COLOUR, lw=1.2, label=f"direct, {condition.direct_ns:g} ns")
    if condition.mpi_ratio > 0:
        axes.axvline(condition.second_ns, color=MPI_COLOUR, lw=1.2, label=f"MPI, {condition.second_ns:g} ns")
    axes.set(xlim=(0, recording.period_ns), xlabel="arrival time (ns)", ylabel="photons a bin")
    wave = axes.twinx()
    turn = 2.0 * np.pi * recording.bin_ns / recording.period_ns
    wave.plot(recording.bin_ns, np.cos(turn), color=MEASURED_COLOUR, lw=0.8)
    wave.plot(recording.bin_ns, np.sin(turn), color=MEASURED_COLOUR, lw=0.8, ls="--")
    wave.set(ylim=(-3.2, 1.2), yticks=[])
    axes.legend(loc="upper right", framealpha=0.9)


def plot_voltages(axes: Axes, recording: Evolution, /) -> None:
    """Plot SC1 and SC2 after each photon on the given axes."""
    thousands = recording.photons / 1e3
    axes.plot(thousands, 1e3 * recording.voltages_v[0], color=DIRECT_COLOUR, lw=0.9, label="SC1")
    axes.plot(thousands, 1e3 * recording.voltages_v[1], color=MPI_COLOUR, lw=0.9, label="SC2")
    axes.set(xlim=(0, thousands[-1]), xlabel="photons sampled (thousands)", ylabel="voltage (mV)")
    axes.legend(loc="upper right", framealpha=0.9)


def plot_phase(axes: Axes, recording: Evolution, condition: Condition, /) -> None:
    """Plot the phase after each photon on the given axes."""
    thousands = recording.photons / 1e3
    direct_deg = 360.0 * condition.direct_ns / recording.period_ns
    error_deg = (recording.phase_deg - direct_deg + 180.0) % 360.0 - 180.0
    settled = (recording.settled_phase_deg - direct_deg + 180.0) % 360.0 - 180.0
    axes.plot(thousands, direct_deg + error_deg, color=MEASURED_COLOUR, lw=0.9, label="first phasor")
    axes.axhline(direct_deg, color=DIRECT_COLOUR, lw=1.2, label=f"direct, {direct_deg:.1f}°")
    axes.axhline(direct_deg + settled, color=MPI_COLOUR, lw=1.0, ls="--", label=f"settled, {settled:+.1f}°")
    axes.set(
        xlim=(0, thousands[-1]),
        ylim=(direct_deg + min(settled, 0) - 20, direct_deg + max(settled, 0) + 20),
        xlabel="photons sampled (thousands)",
        ylabel="phase (°)",
    )
    axes.legend(loc="upper right", framealpha=0.9)


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, 3.6), dpi=DOTS_PER_INCH, layout="constrained")
    return figure, figure.subplots()
