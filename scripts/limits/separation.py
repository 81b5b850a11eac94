"""Measure how near two paths may be, over separation, ambient light, noise and MPI ratio; make table, figure and page."""

import itertools
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cadtof_cli.figures.sweep_maps import MARKERS
from limits.drawn import SEEDS, markdown, named_noise, power, write_csv
from limits.separation_cells import ASRS, LENGTHS, RATIOS, SEAM, SEPARATIONS_NS, SHOWN, WORTH, Cell, measured


def separation(out: Path, *, pixels: int) -> str:
    """Measure all conditions, write table and figure, and return the page."""
    conditions = itertools.product(RATIOS, SEPARATIONS_NS, ASRS, LENGTHS)
    cells = [measured(*condition, pixels=pixels) for condition in conditions]
    clean = [measured(0.0, 0.0, asr, n_av, pixels=pixels) for asr, n_av in itertools.product(ASRS, LENGTHS)]
    three = [
        measured(ratio, apart, *noise, pixels=max(pixels // 5, 25), harmonics=(1, 2, 3))
        for ratio, apart, noise in itertools.product(RATIOS, SEPARATIONS_NS, SHOWN)
    ]
    write_csv(out / "separation.csv", (asdict(cell) for cell in [*clean, *cells]))
    write_csv(out / "separation_three.csv", (asdict(cell) for cell in three))
    draw(cells, out / "separation.png")
    return page(cells, clean, three, pixels)


def draw(cells: list[Cell], path: Path) -> None:
    """Draw errors and shares at MPI/laser 0.3 over the separation, in one colour and with one kind of points per noise."""
    figure = Figure(figsize=(13, 8), dpi=110, layout="constrained")
    error, share, doubt, order = figure.subplots(2, 2).ravel()
    for index, noise in enumerate(SHOWN):
        chosen = [cell for cell in cells if cell.mpi_ratio == 0.3 and (cell.asr, cell.n_av) == noise]
        x, style = [cell.separation_ns for cell in chosen], {"color": f"C{index}", "marker": MARKERS[index], "ms": 4}
        error.plot(x, [cell.rmse_cm for cell in chosen], "-", **style, label=named_noise(*noise))
        error.plot(x, [cell.sigma_cm for cell in chosen], ":", **style)
        share.plot(x, [cell.two for cell in chosen], "-", **style)
        doubt.plot(x, [cell.beyond for cell in chosen], "-", **style)
        doubt.plot(x, [cell.missed for cell in chosen], "--", **style)
        order.plot(x, [cell.over_better for cell in chosen], "-", **style)
    order.axhline(WORTH, color="black", lw=0.8)
    _titled(error, "RMSE of the direct depth; dotted: median predicted sigma", "cm")
    error.set_yscale("log")
    _titled(share, "found as two paths", "share of pixels")
    _titled(doubt, "wrong by more than three sigma; dashed: and not called ill-conditioned", "share of pixels")
    _titled(order, "RMSE of the order test over the better fixed order; line: 1.05", "")
    figure.legend(*error.get_legend_handles_labels(), loc="outside lower center", ncols=len(SHOWN))
    figure.suptitle("Two paths, MPI/laser 0.3, harmonics 1 and 2 of 40 ns, pulse 1.7 ns")
    figure.savefig(path)


def _titled(axes: Axes, title: str, label: str) -> None:
    axes.set(title=title, xlabel="separation, ns", ylabel=label, xscale="log")
    ticks = (1, 2, 3, 5, 8, 11, 16, 20)
    axes.set_xticks(ticks, map(str, ticks))
    axes.minorticks_off()
    axes.grid(alpha=0.3)


def by_separation(cells: Iterable[Cell], ratio: float) -> str:
    """Return the table of one MPI ratio: separations down, noise across."""
    found = {(cell.separation_ns, cell.asr, cell.n_av): cell for cell in cells if cell.mpi_ratio == ratio}
    head = ["separation, ns", *(named_noise(*noise) for noise in SHOWN)]
    lines = []
    for separation_ns in SEPARATIONS_NS:
        row = [found[separation_ns, *noise] for noise in SHOWN]
        lines.append([f"{separation_ns:g}", *map(_shown, row)])
    return markdown(head, lines)


def _shown(cell: Cell) -> str:
    lengths = " / ".join(f"{value:.1f}" if value >= 1.0 else f"{value:.2f}" for value in (cell.rmse_cm, cell.sigma_cm))
    return f"{cell.bias_cm:+.1f} / {lengths}, {cell.beyond:.0%}, {cell.doubtful:.0%}"


def least_separation(cells: Iterable[Cell], ratio: float, noise: tuple[float, float], most: float) -> str:
    """Return the least separation from which on no more than the share `most` of pixels is wrong by more than three sigma."""
    chosen = [cell for cell in cells if cell.mpi_ratio == ratio and (cell.asr, cell.n_av) == noise]
    failed = [index for index, cell in enumerate(chosen) if cell.beyond > most]
    first = failed[-1] + 1 if failed else 0
    return f"{chosen[first].separation_ns:g}" if first < len(chosen) else f"> {chosen[-1].separation_ns:g}"


def page(cells: list[Cell], clean: list[Cell], three: list[Cell], pixels: int) -> str:
    """Return the page."""
    worse = [cell for cell in [*clean, *cells] if cell.over_better > WORTH + 2.0 * cell.over_better_error]
    doubted = [cell for cell in cells if cell.beyond > 0.5]
    caught = [1.0 - cell.missed / cell.beyond for cell in doubted]
    examples = [
        cell
        for cell in cells
        if (cell.mpi_ratio, cell.separation_ns, cell.asr, cell.n_av)
        in {(0.3, 2.0, 6.0, 1e5), (0.3, 3.0, 6.0, 1e5), (0.05, 6.0, 6.0, 1e5), (0.3, 2.5, 2.0, 1e5)}
    ]
    told = markdown(
        [
            "MPI/laser, separation, ASR, n_av",
            "bias, cm",
            "sigma, cm",
            "beyond 3 sigma",
            "ill-conditioned",
            "ill-conditioned, of those beyond 3 sigma",
        ],
        (
            [
                f"{cell.mpi_ratio:g}, {cell.separation_ns:g} ns, {cell.asr:g}, {power(cell.n_av)}",
                f"{cell.bias_cm:+.2f}",
                f"{cell.sigma_cm:.2f}",
                f"{cell.beyond:.0%}",
                f"{cell.doubtful:.0%}",
                f"{1.0 - cell.missed / cell.beyond:.0%}",
            ]
            for cell in examples
        ),
    )
    return PAGE.format(
        seeds=SEEDS,
        pixels=pixels,
        cells=len(cells),
        all=len(cells) + len(clean),
        close=by_separation(cells, 0.3),
        weak=by_separation(cells, 0.1),
        least=_least(cells),
        least_three=_least(three),
        thresholds=_thresholds(cells),
        told=told,
        clean=np.mean([cell.doubtful for cell in clean]),
        doubted=len(doubted),
        caught=np.mean(caught),
        caught_least=min(caught),
        worse=len(worse),
        reasons=_reasons(worse),
        worst_table=_worst(worse),
        clean_count=len(clean),
        half=np.mean([cell.over_better < 1.0 for cell in cells]),
    )


def _least(cells: list[Cell]) -> str:
    return markdown(
        ["MPI/laser", *(named_noise(*noise) for noise in SHOWN)],
        ([f"{ratio:g}", *(least_separation(cells, ratio, noise, 0.02) for noise in SHOWN)] for ratio in RATIOS),
    )


def _thresholds(cells: list[Cell]) -> str:
    """Return a table by probability of a false alarm: how many conditions miss the goal of the order test, and the worst."""
    ways = {
        "0.001": [cell.strict for cell in cells],
        "0.01 (default)": [cell.over_better for cell in cells],
        "0.1": [cell.loose for cell in cells],
    }
    return markdown(
        ["`--false-alarm`", "conditions over 1.05 ×", "worst"],
        ([name, str(sum(value > WORTH for value in found)), f"{max(found):.2f} ×"] for name, found in ways.items()),
    )


def _reason(cell: Cell) -> str:
    if cell.mpi_ratio == 0.0 or cell.two < SEAM:
        return "false alarms: fewer than 2 % found as two"
    if cell.separation_ns == 20.0:
        return "half a turn apart, 20 ns"
    return "the seam: 2 % to 98 % found as two" if cell.two < 1.0 - SEAM else "others: more than 98 % found as two"


def _reasons(worse: list[Cell]) -> str:
    """Return a table by reason: how many conditions miss the goal of the order test, and the worst of them."""
    lines = []
    for reason in sorted({_reason(cell) for cell in worse}):
        some = [cell for cell in worse if _reason(cell) == reason]
        worst = max(some, key=lambda cell: cell.over_better)
        light = f"MPI/laser {worst.mpi_ratio:g} at {worst.separation_ns:g} ns" if worst.mpi_ratio else "no MPI"
        where = f"{light}, {named_noise(worst.asr, worst.n_av)}"
        rmse = f"{worst.rmse_cm:.2f}, {worst.rmse_one_cm:.2f}, {worst.rmse_two_cm:.2f}"
        typical = float(np.median([cell.over_better for cell in some]))
        lines.append([reason, str(len(some)), f"{typical:.2f} ×", f"{worst.over_better:.2f} ×", where, rmse])
    head = [
        "reason",
        "conditions",
        "median",
        "worst",
        "the worst condition",
        "its RMSE: order test, one path, two paths, cm",
    ]
    return markdown(head, lines)


def _worst(worse: list[Cell]) -> str:
    seam = [cell for cell in worse if _reason(cell).startswith("the seam")]
    ordered = sorted(seam, key=lambda cell: -cell.over_better)[:10]
    head = [
        "MPI/laser",
        "separation, ns",
        "ASR",
        "n_av",
        "order test, cm",
        "one path, cm",
        "two paths, cm",
        "over the better order",
        "found as two",
    ]
    return markdown(
        head,
        (
            [
                *(f"{cell.mpi_ratio:g}", f"{cell.separation_ns:g}", f"{cell.asr:g}", power(cell.n_av)),
                *(f"{value:.2f}" for value in (cell.rmse_cm, cell.rmse_one_cm, cell.rmse_two_cm)),
                *(f"{cell.over_better:.2f} ± {cell.over_better_error:.2f}", f"{cell.two:.0%}"),
            ]
            for cell in ordered
        ),
    )


PAGE = """# How near two paths may be

For everyone who relies on sigma: from which separation a second path is found, and how wrong the depth is below that.

Made by `scripts/measure_limits separation`: {cells} conditions, {seeds} seeds × {pixels} pixels each, harmonics 1 and
2 of 40 ns, pulse 1.7 ns, in [separation.csv](separation.csv). `tests/support/mixtures.py` draws the light, not the
simulator of the package.

![Error, order and doubt over the separation](separation.png)

## What sigma holds, and what it leaves out

`direct.sigma` is the scatter of the depth by noise, **if the number of paths is right**. If one path was found where
there are two, sigma does not include the error that the second path causes.

Two paths that are too close for the noise look like one path. Their depth is the depth of both together, and its
sigma is that of one path, which is small. No sigma can know better. If two paths are D apart, the amplitudes of the
harmonics differ from those of one path in proportion to D², and the depth is off in proportion to D. So if the noise
is four times smaller, it still hides separations that are half as large. The error is then half as large, which is
twice as many sigma.

Each cell of these tables holds, for the direct depth: bias / RMSE / median sigma in cm; the share of pixels that are
wrong by more than three sigma; the share of pixels that are called ill-conditioned.

**MPI/laser 0.3**

{close}

**MPI/laser 0.1**

{weak}

## From which separation on sigma is right

The smallest separation, in ns, from which on at most 2 % of the pixels are wrong by more than three sigma (0.3 % if
errors were Gaussian). The paper says three pulse widths, 5.1 ns, for any noise:

{least}

The same light, shared by three modulation periods (harmonics 1, 2 and 3;
[separation_three.csv](separation_three.csv)):

{least_three}

## What `ill-conditioned` catches

The bit says that the answer is doubtful. It is set in two cases:

- two paths are nearer than four of their sigmas;
- a single path has a second harmonic that is so short that noise makes it so in only one pixel of ten.

The second case has a price: without MPI, the bit is set in {clean:.1%} of the pixels.

In {doubted} conditions, more than half of the pixels are wrong by more than three sigma. There the bit is set in
{caught:.0%} of these wrong pixels on average over the conditions, and in {caught_least:.0%} at least. If paths are so
close that the harmonics show next to nothing of the second path, nothing can be said about it.

{told}

## The order test against fixed orders

Asked: the RMSE is at most 1.05 × that of the better fixed order. **That is not reached in {worse} of {all}
conditions** (two standard errors are allowed; the {clean_count} conditions without MPI count, too). In {half:.0%} of
the conditions with MPI, the order test is better than both fixed orders. Where it is worse, by reason (× is the RMSE
of the order test over that of the better fixed order):

{reasons}

**False alarms.** One path is the best answer here, but a few pixels in a thousand get two. Those are far off, because
two paths scatter ten times as much as one. They show in the RMSE and in no median. `--false-alarm 0.001` makes them
rarer.

**The seam** between one path and two. The misfit of one path is just as large as that of noise here. The pixels that
get two paths are those whose noise makes the misfit large. The same noise throws their second path, and with it the
direct path, farther than two paths scatter on average. So some pixels have the bias of one path, others scatter more
than two paths do, and the RMSE is above that of both fixed orders. The worst conditions:

{worst_table}

**Half a turn.** At 20 ns of 40 ns, the second path makes the first harmonic shorter and the second harmonic longer,
and turns neither. So one path happens to have no bias there, and it scatters less than two. The misfit cannot know
that.

Another threshold moves the seam to other separations, but does not remove it:

{thresholds}

What helps there is more light (`--pool`, `--average`) or a third modulation period.
"""
