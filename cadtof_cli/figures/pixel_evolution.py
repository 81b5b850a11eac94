"""One recording of a pixel, as in the paper's Fig. 2: arrivals, voltages, phase."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cadtof_cli.figures.canvas import Figure, legend_beside
from cadtof_cli.figures.scales import AMBIENT_COLOUR, DIRECT_COLOUR, MEASURED_COLOUR, MPI_COLOUR, OTHER_COLOUR
from cadtof_cli.simulation.pixel.evolution import Evolution
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.waveforms import sampled_pair

DOTS_PER_INCH = 120


def draw_evolution(recording: Evolution, condition: Condition, folder: Path, /) -> None:
    """Draw one recording into a folder: `histogram.png`, `voltages.png` and `phase.png`."""
    plots: dict[str, tuple[str, Callable[[Axes, Evolution], None]]] = {
        "histogram": ("When the photons of a recording arrive", partial(plot_histogram, condition=condition)),
        "voltages": ("How the voltages settle", plot_voltages),
        "phase": ("How the phase of the first phasor settles", partial(plot_phase, condition=condition)),
    }
    for name, (title, plot) in plots.items():
        figure = Figure(figsize=(7.6, 3.6), dpi=DOTS_PER_INCH, layout="constrained")
        axes = figure.subplots()
        axes.set_title(title, fontsize=11)
        plot(axes, recording)
        figure.savefig(folder / f"{name}.png")


def plot_histogram(
    axes: Axes, recording: Evolution, /, condition: Condition, *, harmonics: tuple[int, ...] = (1,)
) -> None:
    """Plot the arrivals of photons, and the modulation of some harmonics, on the given axes."""
    width = recording.period_ns / len(recording.bin_ns)
    axes.bar(recording.bin_ns, recording.counts, width=width, color=AMBIENT_COLOUR)
    axes.axvline(condition.direct_ns, color=DIRECT_COLOUR, lw=1.2, label=f"direct, {condition.direct_ns:g} ns")
    for ratio, time_ns in zip(condition.ratios[1:], condition.times_ns[1:], strict=True):
        if ratio > 0:
            axes.axvline(time_ns, color=MPI_COLOUR, lw=1.2, label=f"MPI, {time_ns:g} ns")
    axes.set(xlim=(0, recording.period_ns), xlabel="arrival time, ns", ylabel="photons per bin")
    wave = axes.twinx()
    for harmonic, colour in zip(harmonics, (MEASURED_COLOUR, OTHER_COLOUR), strict=False):
        turn = 2.0 * np.pi * harmonic * recording.bin_ns / recording.period_ns
        first, second = sampled_pair(recording.waveform, turn)
        for channel, value, style in (("SC1", first, "-"), ("SC2", second, "--")):
            label = f"{channel}, {recording.period_ns / harmonic:g} ns"
            wave.plot(recording.bin_ns, value, color=colour, lw=0.8, ls=style, label=label)
    wave.set(ylim=(-3.2, 1.2), yticks=[])
    legend_beside(axes, wave)


def plot_voltages(axes: Axes, recording: Evolution, /) -> None:
    """Plot SC1 and SC2 after each photon on the given axes."""
    thousands = recording.photons / 1e3
    axes.plot(thousands, 1e3 * recording.voltages_v[0], color=DIRECT_COLOUR, lw=0.9, label="SC1")
    axes.plot(thousands, 1e3 * recording.voltages_v[1], color=MPI_COLOUR, lw=0.9, ls="--", label="SC2")
    axes.set(xlim=(0, thousands[-1]), xlabel="photons sampled (thousands)", ylabel="voltage, mV")
    legend_beside(axes)


def plot_phase(axes: Axes, recording: Evolution, /, condition: Condition) -> None:
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
        ylabel="phase, °",
    )
    legend_beside(axes)
