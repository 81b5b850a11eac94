"""Measure the depth of a target that moves between harmonics: bias, scatter and share of two paths, over its speed."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cadtof_cli.capture.metadata import Modulation
from cadtof_cli.figures.sweep_maps import MARKERS
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import Averaging
from cadtof_cli.simulation.pixel.mix import Condition, Motion
from cadtof_cli.simulation.pixel.pixel import PixelModel
from cadtof_cli.units import C_M_PER_NS
from cadtof_cli.workflows.simulate.outcome import summary
from cadtof_cli.workflows.simulate.trials import Recordings, Trials, recordings
from limits.drawn import SEEDS, markdown, named_noise, write_csv

SPEEDS_M_S = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
RATE_HZ = 30.0
HARMONICS = (2, 3)
RATIOS = (0.0, 0.3)
NOISE = ((6.0, 1e4), (2.0, 1e5))
"""ASR and n_av."""

MATTERS = 1.2
"""A speed matters if its RMSE is more than this many times the RMSE at rest."""

CM_PER_NS = 100.0 * C_M_PER_NS / 2.0


@dataclass(frozen=True)
class Moved:
    """One condition at one speed: errors of the direct depth in cm, and `two`, the share of pixels found as two paths."""

    harmonics: int
    mpi_ratio: float
    asr: float
    n_av: float
    speed_m_s: float
    bias_cm: float
    std_cm: float
    rmse_cm: float
    two: float


def measured(harmonics: int, ratio: float, noise: tuple[float, float], speed_m_s: float, *, runs: int) -> Moved:
    """Record and resolve one condition, with every seed."""
    asr, n_av = noise
    base = Trials(
        condition=Condition(asr=asr, mpi_ratio=ratio),
        model=PixelModel(
            modulation=Modulation(periods_ns=tuple(40.0 / h for h in range(1, 1 + harmonics))),
            averaging=Averaging(integration_length=n_av),
            motion=Motion(speed_m_s=speed_m_s, frame_rate_hz=RATE_HZ),
        ),
        resolver=ResolverSettings(),
        runs=runs,
    )
    trials = [replace(base, seed=seed) for seed in range(SEEDS)]
    found = Recordings.joined([recordings(each, block) for each in trials for block in each.blocks])
    direct = summary(base, found).direct
    two = float(np.isfinite(found.times_ns[1]).mean())
    bias, spread = CM_PER_NS * direct.bias_ns, CM_PER_NS * direct.std_ns
    return Moved(harmonics, ratio, asr, n_av, speed_m_s, bias, spread, float(np.hypot(bias, spread)), two)


def motion(out: Path, *, runs: int) -> str:
    """Sweep the speed, write table and figure, and return the page."""
    found = [
        measured(harmonics, ratio, noise, speed, runs=runs)
        for harmonics, ratio, noise, speed in itertools.product(HARMONICS, RATIOS, NOISE, SPEEDS_M_S)
    ]
    write_csv(out / "motion.csv", (asdict(one) for one in found))
    groups = [
        (key, list(some))
        for key, some in itertools.groupby(found, key=lambda one: (one.harmonics, one.mpi_ratio, one.asr, one.n_av))
    ]
    draw(groups, out / "motion.png")
    return PAGE.format(
        seeds=SEEDS,
        runs=runs,
        rate=RATE_HZ,
        table=_table(groups),
        matters=_matters(groups),
        between=100.0 / (2 * RATE_HZ),
    )


Key = tuple[int, float, float, float]


def draw(groups: Sequence[tuple[Key, list[Moved]]], path: Path) -> None:
    """Draw RMSE and share of two paths over the speed."""
    figure = Figure(figsize=(13, 4.8), dpi=110, layout="constrained")
    error, share = figure.subplots(1, 2)
    for index, (key, some) in enumerate(groups):
        place = index % (len(RATIOS) * len(NOISE))
        style, colour = MARKERS[place] + ("-", "--")[key[0] - 2], f"C{place}"
        speeds = [max(one.speed_m_s, 0.03) for one in some]
        error.plot(speeds, [one.rmse_cm for one in some], style, color=colour, label=_named(key))
        share.plot(speeds, [one.two for one in some], style, color=colour)
    error.set(xscale="log", yscale="log", xlabel="speed, m/s; leftmost: at rest", ylabel="RMSE of the direct depth, cm")
    share.set(xscale="log", xlabel="speed, m/s; leftmost: at rest", ylabel="share found as two paths")
    for axes in (error, share):
        axes.grid(alpha=0.3)
    figure.legend(*error.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    figure.suptitle(
        f"A target that moves between harmonics, {RATE_HZ:g} frames a second; truth in the middle of the frame"
    )
    figure.savefig(path)


def _named(key: Key) -> str:
    harmonics, ratio, asr, n_av = key
    return f"{harmonics} harmonics, {f'MPI {ratio:g}' if ratio else 'no MPI'}, {named_noise(asr, n_av)}"


def _table(groups: Sequence[tuple[Key, list[Moved]]]) -> str:
    shown = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
    return markdown(
        ["bias / RMSE in cm, found as two", *(f"{speed:g} m/s" for speed in shown)],
        (
            [
                _named(key),
                *(f"{one.bias_cm:+.2f} / {one.rmse_cm:.2f}, {one.two:.0%}" for one in some if one.speed_m_s in shown),
            ]
            for key, some in groups
        ),
    )


def _matters(groups: Sequence[tuple[Key, list[Moved]]]) -> str:
    lines = []
    for key, some in groups:
        rest = some[0].rmse_cm
        first = next((one.speed_m_s for one in some if one.rmse_cm > MATTERS * rest), None)
        doubled = next((one.speed_m_s for one in some if one.rmse_cm > 2.0 * rest), None)
        lines.append(
            [
                _named(key),
                f"{rest:.2f}",
                *(f"{v:g}" if v is not None else f"> {SPEEDS_M_S[-1]:g}" for v in (first, doubled)),
            ]
        )
    head = ["", "RMSE at rest, cm", "RMSE 1.2 × as large from, m/s", "RMSE 2 × as large from, m/s"]
    return markdown(head, lines)


PAGE = """# A target that moves between harmonics

For everyone who records moving targets: how large the errors are, and from which speed they matter.

Made by `scripts/measure_limits motion`: {seeds} seeds × {runs} recordings per condition, in [motion.csv](motion.csv).
To try one speed, use `cadtof simulate --speed 1 --frame-rate 30`, without or with `--scene`.

Harmonics are recorded one after the other. At {rate:g} frames a second and with two harmonics, a target that moves
away at 1 m/s is {between:.2f} cm farther away for the second harmonic than for the first.

What is simulated:

- The whole scene, with its MPI, moves along the line of sight.
- Each harmonic sees the scene where it is when the harmonic is read. (The average forgets within n_av photons: 0.8 ms
  at n_av 1e5 and 5 photons a cycle.)
- The true distance is the distance in the middle of the frame. So the errors do not hold the delay of the frame. They
  hold only what is left because the harmonics disagree.

![Error over the speed](motion.png)

{table}

## From which speed it matters

{matters}

**One path.** The weight of harmonic h in the distance is h² times the weight of the first. With two harmonics, the
depth is off by (−1 + 4)/5 of half the way that the target moves between them. That is 0.3 · v/(2 · frame rate): 0.5
cm at 1 m/s and 30 Hz. With little noise, a faster target looks like two paths: the phases disagree by more than noise
explains, and the order test takes a second path.

**Two paths from two harmonics.** Two paths fit two harmonics exactly, so nothing can disagree. The second path takes
up most of the motion, and the direct path hardly moves.

**Three harmonics.** They are more precise, so motion matters earlier. The last harmonic has the largest weight, so
the depth is that at the end of the frame rather than in its middle.

**A false first return.** In the table, the direct light comes after 5 ns, from .75 m. From 8 m/s on (at 30 Hz; from 6.5
m/s on with three harmonics), a target without MPI that moves away gets a false path 13 ns before it (9 ns with three)
that is strong enough to be the first return. Where the target is farther than 2 m (1.3 m with three), this path lies in
front of the camera, and the depth is 2 m (1.3 m) too near, by many sigma and without a status bit. Nearer targets, and
targets that come nearer, are as in the table. `--return strongest` avoids it: the errors are again those of the table.

A higher frame rate makes the error smaller in proportion. If the speed of the target is known, its motion can be
subtracted from the phase of each harmonic; cadtof neither measures nor corrects motion.
"""
