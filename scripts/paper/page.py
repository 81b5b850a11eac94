"""The Markdown page: ours beside the paper's, condition by condition."""

from cadtof_cli.workflows.simulate.sweep import SweepCell
from cadtof_cli.workflows.simulate.trials import TrialsSummary
from paper.effort import Effort
from paper.pixel_experiments import Figure2, Figure3
from paper.resolver_experiments import GRID_ASRS, GRID_LENGTHS, TABLE_1, Maps, Table1Row, extremes
from paper.scene_experiments import Figure4, Figure5

INTRODUCTION = """# The paper, reproduced

Morsy, Blinder, Kuijk: *Multi-Path Interference Challenges and Suggested Solution for Correlation-Assisted Direct
Time-of-Flight*. Made by `scripts/reproduce_paper` from a fixed seed; every picture has its numbers in a CSV beside it.

Photons are mixed as **laser : MPI : ambient = 1 : MPI/laser : ASR** throughout. The captions of the paper are not consistent
about it: Table 1 fits this reading, but Fig. 2 gives ASR 1 without and 0.8 with an MPI of 0.3, and 1/1.3 = 0.77, so there the
same ambient light seems to be counted over laser *and* MPI photons.
"""


def page(
    effort: Effort,
    *,
    figure_2: Figure2,
    figure_3: Figure3,
    table_1: list[Table1Row],
    maps: Maps,
    figure_4: Figure4,
    figure_5: Figure5,
) -> str:
    """Return the page."""
    return "\n".join(
        [
            INTRODUCTION,
            _figure_2(figure_2, effort),
            _figure_3(figure_3, effort),
            _scenes(figure_4, figure_5, effort),
            _table_1(table_1, effort),
            _maps(maps, effort),
        ]
    )


def _figure_2(found: Figure2, effort: Effort) -> str:
    (clean, mpi), (_, uncertainty) = found.error_deg, found.standard_error_deg
    return f"""## Fig. 2: one pixel

![Fig. 2](fig2.png)

| | paper | ours, photon by photon, {effort.pixel_runs} recordings | expected from geometry |
|---|---|---|---|
| phase error without MPI | none | {clean:+.2f}° | 0° |
| phase error, 90° and 153°, MPI/laser 0.3 | a shift, no number | {mpi:.2f}° ± {uncertainty:.2f}° | 13.24° (1.471 ns) |

n_av 4000, 5 photons a cycle, 10,000 cycles, 274.6 mV.
"""


def _figure_3(found: Figure3, effort: Effort) -> str:
    lines = [
        f"| {ratio:g} | {found.error_deg[ratio]:.2f}° | {found.error_spread_deg[ratio]:.2f}° "
        f"| ± {found.error_noise_deg[ratio]:.2f}° |"
        for ratio in found.error_deg
    ]
    return f"""## Fig. 3: what MPI does to confidence, precision and accuracy

![Fig. 3](fig3.png)

90° and 153°, n_av 4000, {effort.pixel_runs} recordings a condition, photon by photon; ASR 0.5 to 6.

| | paper | ours, worst condition |
|---|---|---|
| confidence against the model of the whole mix, A·\\|m₁\\| | | {found.confidence_mix:.1%} off |
| confidence against the one-path model A·r₁/(1 + ASR), MPI as signal | less than 10 % off | {found.confidence_single:.1%} off |
| phase precision against the model of the whole mix | | {found.precision_mix:.1%} off |
| phase precision against the one-path model, MPI as signal | similar | {found.precision_single:.1%} off |

The one-path model cannot know that two phasors at 63° add up to less than their sum. At MPI/laser 0.3 they add up to
{1.1668 / 1.3:.1%} of it, so a deviation of 10.2 % follows from geometry alone: the paper's "less than 10 %" fits if MPI
counts as signal in its ASR, and the rest is the noise of its 200 runs. A standard deviation from {effort.pixel_runs}
runs is itself {1 / (2 * effort.pixel_runs) ** 0.5:.0%} uncertain. With little ambient light the one-path model is far too
hopeful about precision: photons of two paths scatter along the line between their phasors, which needs no ambient light.

| MPI/laser | phase error, mean over ASR | spread over ASR | standard error of one condition |
|---|---|---|---|
{chr(10).join(lines)}

The phase error does not depend on ASR: its spread is that of the noise, which is largest at ASR 6.
"""


def _scenes(four: Figure4, five: Figure5, effort: Effort) -> str:
    first, resolved = (
        f"{spread[0]:.2f} cm | {spread[1]:.2f} cm | {bias:+.2f} cm | {angle:.1f}°"
        for spread, bias, angle in zip(
            (five.first_cm, five.resolved_cm), five.bias_cm, five.opening_deg[1:], strict=True
        )
    )
    return f"""## Fig. 4: inter-reflection

![Fig. 4](fig4.png)

| panel at 335 cm | paper | ours |
|---|---|---|
| without the second object | 335 cm | {four.without_cm:.1f} cm |
| with it, first phasor | around 333 cm | {four.with_cm:.1f} cm |
| with it, resolved | not tried | {four.resolved_cm:.1f} cm |

Light that goes by way of another object travels farther, so it should make the panel look farther. It looks nearer, as the
paper measured, only if that light arrives more than half a period after the direct light, or if it comes from something
nearer than the panel and reaches its pixels inside the camera. We take the first reading, which fits "positioned farther
from the target": a reflector 5 m to the side, whose light is 24 ns late at the middle of the panel, with 0.033 of the direct
photons. The paper gives neither distance nor strength. The distance bends across the panel by field curvature, as in
Fig. 4(c).

## Fig. 5: corner

![Fig. 5](fig5.png)

Two diffuse planes (albedo 0.8) at 90°, edge at 2 m; the light of one bounce is integrated over the other plane, in 300
directions a pixel. {effort.frames} frames at n_av 1e5.

| error of planar depth | median | 90 % | bias | angle of the corner (true {five.opening_deg[0]:.1f}°) |
|---|---|---|---|---|
| first phasor, as the paper measured | {first} |
| resolved, one frame each | {resolved} |

The paper says that the bounces make the path *shorter* than the geometry. A bounced path is longer; what its Fig. 5(d)
shows, a corner that is rounded off, follows all the same, because the shift vanishes at the edge and grows away from it. The
MPI here is a distribution of delays, not a second peak, so two ideal paths leave a rest: near the edge the delays are shorter
than the pulse, and pixels there are sometimes split in two or not split where they should be.
"""


def _std(summary: TrialsSummary, path: str) -> float:
    value: float = getattr(summary, path).std_ns
    return value


def _table_1(found: list[Table1Row], effort: Effort) -> str:
    photon_length = found[0].photon_length
    scale = (photon_length / 1.0e5) ** 0.5
    scaled = "" if scale == 1.0 else f", at n_av {photon_length:g} and scaled by {scale:.3f}"
    lines = []
    for row in found:
        second_ns, *paper = TABLE_1[row.name]
        for name, path, stated in zip(("first", "second"), ("direct", "second"), paper, strict=True):
            ours, counted = _std(row.statistics, path), scale * _std(row.photons, path)
            bound = getattr(row.statistics, path).bound_ns
            verdict = _verdict(ours, stated), _verdict(counted, stated)
            lines.append(
                f"| 7{row.name}: 5, {second_ns:g} ns | {name} | {stated:.2f} | {ours:.3f} {verdict[0]} "
                f"| {counted:.3f} {verdict[1]} | {bound:.3f} |"
            )
    return f"""## Figs. 6 and 7, Table 1: two peaks resolved

![Fig. 6](fig6.png)

The text on Fig. 6 puts the peaks at 10 and 16 ns, Table 1 and Fig. 7 at 5 and 16 ns. The standard deviations of Table 1 fit
5 and 16 ns; at 10 and 16 ns they would be those of 7(c), 6 ns apart.

![Fig. 7](fig7.png)

Standard deviations in ns; ASR 5, n_av 1e5, MPI/laser 0.3, pulse 1.7 ns; {effort.resolver_runs} solves; photon by photon: as many
recordings{scaled}. (=) within 15 % of the paper's figure or equal after its rounding.

| condition | peak | paper | ours, by statistics | ours, photon by photon | Cramér–Rao bound |
|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _verdict(ours: float, stated: float) -> str:
    return "(=)" if abs(ours / stated - 1) <= 0.15 or round(ours, 2) == stated else "(≠)"


def _grid(cells: list[SweepCell], ratio: float, path: str, column: str) -> str:
    found = {
        (cell.trials.condition.asr, cell.trials.model.averaging.integration_length): getattr(
            getattr(cell.outcome, path), column
        )
        for cell in cells
        if cell.trials.condition.mpi_ratio == ratio
    }
    head = "| ASR | " + " | ".join(f"n_av {length:,.0f}" for length in GRID_LENGTHS) + " |"
    rows = [
        f"| {asr:g} | " + " | ".join(f"{found[asr, length]:.3f}" for length in GRID_LENGTHS) + " |" for asr in GRID_ASRS
    ]
    return "\n".join([head, "|---" * (1 + len(GRID_LENGTHS)) + "|", *rows])


def _maps(maps: Maps, effort: Effort) -> str:
    parts = [
        f"""## Figs. 8 and 9: over ASR and integration length

![Fig. 8](fig8.png)

![Fig. 9](fig9.png)

5 and 16 ns, {effort.resolver_runs} solves a cell. The paper does not state its grid. Ours is ASR 1 to 6 and n_av 1e3 to 1e5. All
values in ns.
"""
    ]
    for ratio, path, figure, paper in (
        (0.3, "direct", "9(a)", "0.1 to 0.7"),
        (0.3, "second", "9(b)", "0.5 to 3.4"),
        (0.1, "direct", "9(c)", "0.1 to 0.7"),
        (0.1, "second", "9(d)", "0.5 to 12.8"),
    ):
        low, high = extremes(maps.ours, ratio, path, "std_ns")
        bias = extremes(maps.ours, ratio, path, "bias_ns")
        parts.append(
            f"""**Fig. {figure}: std of the {path} path, MPI/laser {ratio:g}.** Paper: {paper}. Ours: {low:.3f} to {high:.3f};
largest bias {bias[1]:.3f}{" (the paper's Fig. 8: as low as 0.1)" if path == "direct" else ""}.

{_grid(maps.ours, ratio, path, "std_ns")}
"""
        )
    for title, cells in (
        (
            f"9(e), no MPI, order test, pulse corrected (our default; {10 * effort.resolver_runs} solves a cell)",
            maps.ours,
        ),
        ("9(e), no MPI, always two paths, pulse corrected", maps.always_two),
        ("9(e), no MPI, always two paths, pulse left in, as the paper's Eq. (3) does", maps.as_the_paper),
    ):
        low, high = extremes(cells, 0.0, "direct", "std_ns")
        parts.append(
            f"""**Fig. {title}: std of the direct path.** Paper: 0.4 to 0.7. Ours: {low:.3f} to {high:.3f}.

{_grid(cells, 0.0, "direct", "std_ns")}
"""
        )
    parts.append(READINGS)
    return "\n".join(parts)


READINGS = """### What the ranges say about the paper's own conditions

- The paper's smallest direct std, 0.1 ns, is above what its own Table 1 has at n_av 1e5 (0.03 to 0.05 ns), so Figs. 8 and 9 were
  made with shorter integration. n_av 1e3 to 1e4 comes closest.
- Its largest second std, 12.8 ns, is above the 11.5 ns of an angle that is uniform over 40 ns. A standard deviation of wrapped
  angles can only get there if a true 16 ns near the end of a ±20 ns interval falls on both of its ends: a wrap artefact. We
  measure differences from the truth within ±20 ns.
- Without MPI its direct std does not fall below 0.4 ns. A pulse of 1.7 ns that is not divided out looks to a two-path solver
  like two equal peaks at ±0.72 ns, either of which may be called first: that is the floor, and it is gone once each harmonic
  is divided by its own r_h (0.994 and 0.975). Eq. (3) has another exponent, and takes the factor as common to all harmonics.
"""
