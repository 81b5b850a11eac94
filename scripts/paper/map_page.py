"""The sections of the page on resolved peaks: Table 1 and Figs. 6 to 9. Ours and the paper's way stand beside the paper."""

import numpy as np

from cadtof_cli.workflows.simulate.outcome import TrialsSummary
from paper.effort import Effort
from paper.resolver_experiments import (
    GRID_ASRS,
    GRID_LENGTHS,
    SEEDS,
    TABLE_1,
    WORST,
    Maps,
    Table1Row,
    extremes,
)

SHORT = 1.0e4
"""Largest n_av of the cells that come closest to the paper's ranges."""

RANGES = (
    ("9(a)", 0.3, "direct", "0.1 to 0.7"),
    ("9(b)", 0.3, "second", "0.5 to 3.4"),
    ("9(c)", 0.1, "direct", "0.1 to 0.7"),
    ("9(d)", 0.1, "second", "0.5 to 12.8"),
    ("9(e)", 0.0, "direct", "0.4 to 0.7"),
)
"""Figure, MPI ratio, path, and the range of standard deviations that the paper states."""


def _std(summary: TrialsSummary, path: str) -> float:
    value: float = getattr(summary, path).std_ns
    return value


def table_1_section(found: list[Table1Row], effort: Effort) -> str:
    photon_length = found[0].photon_length
    scale = (photon_length / 1.0e5) ** 0.5
    scaled = "" if scale == 1.0 else f", at n_av {photon_length:g} and scaled by {scale:.3f}"
    lines = []
    for row in found:
        second_ns, *paper = TABLE_1[row.name]
        for name, path, stated in zip(("first", "second"), ("direct", "second"), paper, strict=True):
            ours, counted = _std(row.statistics, path), scale * _std(row.photons, path)
            bound = getattr(row.statistics, path).bound_ns
            theirs = _std(row.paper_way, path)
            shown = (f"{value:.3f} {_verdict(value, stated)}" for value in (theirs, ours, counted))
            lines.append(
                f"| 7{row.name}: 5, {second_ns:g} ns | {name} | {stated:.2f} | {' | '.join(shown)} | {bound:.3f} |"
            )
    steps = ", ".join(f"{row.paper_way.steps_per_start:.1f}" for row in found)
    return f"""## Figs. 6 and 7, Table 1: two peaks resolved

![Fig. 6](fig6.png)

The text of the paper on Fig. 6 puts the peaks at 10 and 16 ns, Table 1 and Fig. 7 put them at 5 and 16 ns. The standard
deviations of Table 1 fit 5 and 16 ns. At 10 and 16 ns they would be those of 7(c), where the peaks are 6 ns apart.

![Fig. 7](fig7.png)

The table has standard deviations in ns, at ASR 5, n_av 1e5, MPI/laser 0.3 and a pulse of 1.7 ns, over
{effort.resolver_runs} solves. Photon by photon, there are as many recordings{scaled}. (=) means: within 15 % of the number
in the paper, or equal to it after the paper's rounding.

| condition | peak | paper | as the paper | ours, by statistics | ours, photon by photon | Cramér–Rao bound |
|---|---|---|---|---|---|---|
{chr(10).join(lines)}

**As the paper** means:

- Eq. (9) by Levenberg–Marquardt from ten random starts;
- always two peaks, of which the stronger is called the first;
- the pulse is not corrected;
- times are as the angles give them, within ±20 ns.

The command is `cadtof simulate --solver lm --order 2 --return strongest --no-pulse-correction --wrapped`. A start takes
{steps} steps on average in (a), (b), (c). The paper says 20 on average, without saying when its search stops. Our search
stops if a step promises to lower the cost by less than a thousandth, and gives up after 100 steps.
"""


def _verdict(ours: float, stated: float) -> str:
    return "(=)" if abs(ours / stated - 1) <= 0.15 or round(ours, 2) == stated else "(≠)"


def _grid(cells: list[TrialsSummary], ratio: float, path: str, column: str) -> str:
    found = {
        (cell.trials.condition.asr, cell.trials.model.averaging.integration_length): getattr(
            getattr(cell, path), column
        )
        for cell in cells
        if cell.trials.condition.mpi_ratio == ratio
    }
    head = "| ASR | " + " | ".join(f"n_av {length:,.0f}" for length in GRID_LENGTHS) + " |"
    rows = [
        f"| {asr:g} | " + " | ".join(f"{found[asr, length]:.3f}" for length in GRID_LENGTHS) + " |" for asr in GRID_ASRS
    ]
    return "\n".join([head, "|---" * (1 + len(GRID_LENGTHS)) + "|", *rows])


def maps_section(maps: Maps, effort: Effort) -> str:
    runs = f"{len(SEEDS)} seeds × {effort.resolver_runs} solves"
    parts = [
        f"""## Figs. 8 and 9: over ASR and integration length

![Fig. 8, ours](fig8.png)

![Fig. 8, as the paper](fig8_as_the_paper.png)

![Fig. 9, ours](fig9.png)

![Fig. 9, as the paper](fig9_as_the_paper.png)

Paths at 5 and 16 ns, {effort.resolver_runs} solves per cell. The paper does not state its grid. Ours is ASR 1 to 6 and
n_av 1e3 to 1e5. All values are in ns.

| standard deviation | paper | as the paper, n_av 1e3 to 1e4 | as the paper, all n_av | ours, all n_av |
|---|---|---|---|---|
{chr(10).join(_range(maps, *given) for given in RANGES)}

Ours without MPI is with the order test and {10 * effort.resolver_runs} solves per cell.

| second path at ASR 6, n_av 1e3, as the paper | largest in the paper | mean of {runs} | smallest and largest of a seed |
|---|---|---|---|
{chr(10).join(_seeds(maps, *given) for given in WORST)}

Steps per start of Levenberg–Marquardt, with all ten starts counted, on average (and smallest to largest average of a
cell); the paper says 20 on average: {_steps(maps)}.
"""
    ]
    for figure, ratio, path, paper in RANGES:
        light = f"MPI/laser {ratio:g}" if ratio else "no MPI"
        bias = (extremes(cells, ratio, path, "bias_ns")[1] for cells in (maps.as_the_paper, maps.ours))
        eight = "\n(the paper's Fig. 8: as low as 0.1)" if path == "direct" else ""
        told = "largest bias {:.3f} as the paper, {:.3f} ours".format(*bias)
        parts.append(
            f"""**Fig. {figure}: std of the {path} path, {light}.** Paper: {paper}; {told}{eight}.

As the paper:

{_grid(maps.as_the_paper, ratio, path, "std_ns")}

Ours{"" if ratio else ", order test"}:

{_grid(maps.ours, ratio, path, "std_ns")}
"""
        )
    low, high = extremes(maps.always_two, 0.0, "direct", "std_ns")
    parts.append(
        f"""Ours without MPI if two paths are always resolved, with the pulse corrected ({low:.3f} to {high:.3f}):

{_grid(maps.always_two, 0.0, "direct", "std_ns")}
"""
    )
    parts.append(READINGS)
    return "\n".join(parts)


def _range(maps: Maps, figure: str, ratio: float, path: str, paper: str) -> str:
    spans = (
        extremes(maps.as_the_paper, ratio, path, "std_ns", longest=SHORT),
        extremes(maps.as_the_paper, ratio, path, "std_ns"),
        extremes(maps.ours, ratio, path, "std_ns"),
    )
    light = f"MPI/laser {ratio:g}" if ratio else "no MPI"
    return f"| {figure}: {path} path, {light} | {paper} | {' | '.join(f'{low:.2f} to {high:.2f}' for low, high in spans)} |"


def _seeds(maps: Maps, ratio: float, paper: float) -> str:
    found = maps.seeds[ratio]
    return f"| MPI/laser {ratio:g} | {paper} | {np.mean(found):.2f} | {min(found):.2f}, {max(found):.2f} |"


def _steps(maps: Maps) -> str:
    means = {
        ratio: [cell.steps_per_start for cell in maps.as_the_paper if cell.trials.condition.mpi_ratio == ratio]
        for ratio in (0.3, 0.1, 0.0)
    }
    return ", ".join(
        f"{np.mean(found):.1f} ({min(found):.1f} to {max(found):.1f}) {f'at MPI/laser {ratio:g}' if ratio else 'without MPI'}"
        for ratio, found in means.items()
    )


READINGS = """### What the ranges say about the paper's own conditions

- **Shorter integration.** The paper's smallest std of the direct path is 0.1 ns. That is more than its own Table 1 has at
  n_av 1e5 (0.03 to 0.05 ns). So Figs. 8 and 9 were made with a shorter integration; n_av 1e3 to 1e4 comes closest.
- **Wrapped times.** The paper's largest std of the second path is 12.8 ns. That is more than the 11.5 ns of an angle that
  is uniform over 40 ns. A std of wrapped angles can be that large only if times about a true 16 ns, near the end of an
  interval of ±20 ns, fall on both of its ends. This is an artefact of wrapping, and our runs as the paper show it, too.
  Ours measures differences from the truth within ±20 ns.
- The paper's largest std of the second path at MPI/laser 0.3, 3.4 ns, comes from a few such wraps, too: our runs as the
  paper reach it between ASR 5 and 6 at n_av 1e3.
- **The pulse.** Without MPI, the paper's std of the direct path does not fall below 0.4 ns. If a pulse of 1.7 ns is not
  divided out, a two-path solver sees two equal peaks at ±0.72 ns. Either of them may be the stronger, and is then called
  the first. That makes the floor. The floor is gone if each harmonic is divided by its own r_h (0.994 and 0.975). Eq. (3)
  has another exponent, and takes the factor as common to all harmonics.
"""
