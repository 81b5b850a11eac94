"""Compare switched stages ST1 and ST2 (Fig. 1) with stages closed by DC: shot noise, ripple and static errors."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cadtof_cli.figures.sweep_maps import MARKERS
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages, effective_length
from limits.drawn import SEEDS, markdown, write_csv
from tests.support.mixtures import F

RATE_HZ = 125e6
"""Photons a second: 5 in a cycle of 40 ns."""

CAPACITORS = Capacitors(values_ff=(1.0, 1333.0, 1.0, 1333.0, *[666.5] * 8))
"""C1 and C3 have 1 fF; the three stages share the rest evenly: n_av 4000."""

OF_CAPACITORS = Averaging(integration_length=CAPACITORS.integration_length, capacitors=CAPACITORS)
"""Their averaging, with stages closed by DC."""

F1_HZ, F2_HZ = 1.0e6, 1.0e4
"""Frequencies at which the paper switches the stages."""

PHOTONS = 500_000
"""Photons of one recording, 4 ms: stages of both kinds have settled by then."""

RIPPLES_HZ = (100.0, 300.0, 1e3, 2e3, 5e3, 9.7e3, 1e4, 1.03e4, 1.5e4, 2e4, 3.3e4, 1e5, 3.3e5, 1e6, 3.3e6, 1e7)
"""Frequencies of a disturbance of the sampled voltage, such as that of a supply or a clock."""


SECOND_STAGE_HZ = (1e5, 3e4, 1e4, 3e3, 1e3)
"""Values of F2 in the table of lengths."""

LONG = 4_000_000
"""Number of photons after which stages with the lowest F2 have settled, 32 ms."""


@dataclass(frozen=True)
class Ripple:
    """Reading of a sine of amplitude 1 on the sampled voltage, r.m.s. over its phase and over random photons, by the
    way of averaging."""

    frequency_hz: float
    dc: float
    dc_as_quiet: float
    switched: float


@dataclass(frozen=True)
class Way:
    """A way of averaging: the weight of each photon, the latest photon last. The weights add up to `settled`."""

    name: str
    weights: F

    @property
    def settled(self) -> float:
        """Reading of a constant of 1: offsets and gain errors pass with this factor."""
        return float(self.weights.sum())

    @property
    def length(self) -> float:
        """The n_av with the same shot noise."""
        return effective_length(self.weights)

    @property
    def memory_ms(self) -> float:
        """Time after which 90 % of a change is seen, in ms."""
        taken = np.cumsum(self.weights[::-1]) / self.settled
        return float(np.searchsorted(taken, 0.9)) / RATE_HZ * 1e3


def ways() -> tuple[Way, Way, Way]:
    """Return stages closed by DC, switched stages, and an average by DC with the same shot noise as the switched stages."""
    switched = _switched(F2_HZ, PHOTONS)
    alike = effective_length(switched)
    return (
        Way(f"DC, n_av {CAPACITORS.integration_length:,.0f}", _weights(OF_CAPACITORS, PHOTONS)),
        Way("switched at 1 MHz and 10 kHz", switched),
        Way(f"DC, n_av {alike:,.0f}: as little shot noise", _weights(Averaging(integration_length=alike), PHOTONS)),
    )


def _switched(f2_hz: float, photons: int) -> F:
    """Return the weights of photons if the stages switch at `F1_HZ` and at `f2_hz`."""
    return _weights(replace(OF_CAPACITORS, stages=Stages(drive="switched", f1_hz=F1_HZ, f2_hz=f2_hz)), photons)


def _weights(averaging: Averaging, photons: int) -> F:
    return np.asarray(averaging.weights(photons, photon_rate_hz=RATE_HZ)[0])


def ripple(weights: F, frequency_hz: float) -> float:
    """Return the r.m.s. reading of a ripple of amplitude 1, over its phase and over photons that arrive at random."""
    powers = []
    for seed in range(SEEDS):
        generator = np.random.default_rng([seed, round(frequency_hz)])
        times = np.sort(generator.random(PHOTONS)) * PHOTONS / RATE_HZ
        powers.append(0.5 * abs(weights @ np.exp(2j * np.pi * frequency_hz * times)) ** 2)
    return float(np.sqrt(np.mean(powers)))


def stages(out: Path, *, frequencies: tuple[float, ...] = RIPPLES_HZ) -> str:
    """Measure, write table and figure, and return the page."""
    closed, switched, quiet = ways()
    found = [Ripple(f, *(ripple(way.weights, f) for way in (closed, quiet, switched))) for f in frequencies]
    write_csv(out / "stages.csv", (asdict(one) for one in found))
    draw(found, (closed, quiet, switched), out / "stages.png")
    told = markdown(
        ["", "shot noise as of n_av", "90 % of a change after", "left of a constant offset"],
        (
            [way.name, f"{way.length:,.0f}", f"{way.memory_ms:.3f} ms", f"{way.settled:.3f}"]
            for way in (closed, quiet, switched)
        ),
    )
    table = markdown(
        ["ripple at", closed.name, quiet.name, switched.name, "gain over DC with as little shot noise"],
        (
            [
                f"{one.frequency_hz:g} Hz",
                *(f"{value:.4f}" for value in (one.dc, one.dc_as_quiet, one.switched)),
                f"{one.dc_as_quiet / one.switched:.2f}",
            ]
            for one in found
        ),
    )
    gains = [one.dc_as_quiet / one.switched for one in found]
    return PAGE.format(
        told=told,
        table=table,
        seeds=SEEDS,
        lengths=_lengths(),
        most=max(gains),
        worse=1.0 / min(gains),
        noise=1.0 - (closed.length / switched.length) ** 0.5,
        times=switched.length / closed.length,
        slower=switched.memory_ms / quiet.memory_ms,
    )


def _lengths() -> str:
    """Return the table of shot noise and memory over F2, with the same capacitors."""
    lines = []
    for f2_hz in SECOND_STAGE_HZ:
        way = Way("", _switched(f2_hz, LONG))
        lines.append([f"{f2_hz / 1e3:g} kHz", f"{way.length:,.0f}", f"{way.memory_ms:.2f} ms", f"{way.settled:.3f}"])
    return markdown(["F2", "shot noise as of n_av", "90 % of a change after", "left of a constant offset"], lines)


def draw(found: list[Ripple], shown: tuple[Way, Way, Way], path: Path) -> None:
    """Draw the weights of the photons, and what is left of a ripple."""
    figure = Figure(figsize=(12, 4.4), dpi=110, layout="constrained")
    weights, left = figure.subplots(1, 2)
    ages = np.arange(PHOTONS)[::-1] / RATE_HZ * 1e3
    for index, way in enumerate(shown):
        style, colour = ("-", "--", ":")[index], f"C{index}"
        weights.plot(ages[::50], way.weights[::50] * RATE_HZ / 1e3, style, color=colour, lw=1.2, label=way.name)
        column = ("dc", "dc_as_quiet", "switched")[index]
        frequencies, read = [one.frequency_hz for one in found], [getattr(one, column) for one in found]
        left.plot(frequencies, read, MARKERS[index] + style, ms=3, color=colour)
    weights.set(xlim=(0.0, 1.0), yscale="log", ylim=(1e-2, 1e2), xlabel="age of a photon, ms", ylabel="weight, 1/ms")
    left.set(
        xscale="log", yscale="log", xlabel="frequency of the ripple, Hz", ylabel="r.m.s. read of an amplitude of 1"
    )
    for axes in (weights, left):
        axes.grid(alpha=0.3)
    figure.legend(*weights.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(path)


PAGE = """# Switched stages

For everyone who designs a pixel: what switching its stages gains.

The camera of the paper switches ST1 and ST2 (Fig. 1) at F1 = 1 MHz and F2 = 10 kHz "to reduce the systematic noise"
(its reference 23). It does not say by how much.

Made by `scripts/measure_limits stages` from the exact weights of all photons in the voltage that is read
(`simulation/pixel/averaging.py`), with capacitors of n_av 4000 and 125 million photons a second.

**Shot noise: a gain.** With the same capacitors, switched stages average longer: {times:.1f} times the n_av at 1 MHz
and 10 kHz, which is {noise:.0%} less shot noise. A slower F2 hardly brings more. The gain is one of area: stages
closed by DC need larger capacitors for the same shot noise.

**Systematic errors: no gain was found** that a longer average by DC would not bring as well, apart from slow ripple:

- Static errors, which are offsets and gain errors, pass unchanged.
- Ripple between 1 and 5 kHz is up to {most:.1f} times smaller than with DC at the same shot noise.
- Ripple near multiples of F2 is up to {worse:.1f} times larger. The second stage samples at that rate and folds such
  ripple down to a constant.
- A change takes {slower:.1f} times as long.

If reference 23 means an effect inside the pixel, such as charge that switching injects, this model does not have it.

{told}

The next table is about a disturbance of the sampled voltage, such as ripple of a supply or of another clock. It holds
the r.m.s. of what is read if the amplitude of the ripple is 1, over its phase and over {seeds} draws of the photons'
times, as in [stages.csv](stages.csv). At high frequencies, what stays comes from the random times of the photons.

![Weights of photons, and ripple](stages.png)

{table}

The same capacitors with another F2. The last stage averages over few of its steps, however far apart they are.

{lengths}
"""
