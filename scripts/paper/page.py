"""Make the Markdown page: ours beside the paper's, condition by condition."""

from paper.effort import Effort
from paper.map_page import maps_section, table_1_section
from paper.pixel_experiments import Figure2, Figure3
from paper.resolver_experiments import Maps, Table1Row
from paper.scene_experiments import Figure4, Figure5

INTRODUCTION = """# The paper, reproduced

For everyone who knows the paper, or compares another method with it: its figures and tables, made again by our simulator
and resolver, beside its own numbers.

The paper is Morsy, Blinder, Kuijk: *Multi-Path Interference Challenges and Suggested Solution for Correlation-Assisted
Direct Time-of-Flight*. This page and its pictures were made by `scripts/reproduce_paper` from a fixed seed. Every picture
has its numbers in a CSV beside it. In tables and pictures,

- "paper" is what the paper states;
- "as the paper" is the method of the paper, run by us (explained at Table 1);
- "ours" is what our simulator and resolver give.

Photons are mixed as **laser : MPI : ambient = 1 : MPI/laser : ASR** on this page. The captions of the paper do not agree
on this. Table 1 fits it. But Fig. 2 gives ASR 1 without MPI and ASR 0.8 with an MPI of 0.3. Since 1/1.3 = 0.77, the same
ambient light seems to be divided by laser *and* MPI photons there.
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
            table_1_section(table_1, effort),
            maps_section(maps, effort),
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

Simulated with n_av 4000, 5 photons a cycle, 10,000 cycles and an amplitude of 274.6 mV.
"""


def _figure_3(found: Figure3, effort: Effort) -> str:
    precision = [
        f"| {one.asr:g} | {one.seen_deg:.2f}° | {one.single_deg:.2f}° | {one.seen_deg / one.single_deg - 1:+.0%} "
        f"| {one.shorter - 1:+.0%} | {one.wider - 1:+.0%} | {one.shorter * one.wider - 1:+.0%} |"
        for one in found.precision
    ]
    lines = [
        f"| {ratio:g} | {found.error_deg[ratio]:.2f}° | {found.error_spread_deg[ratio]:.2f}° "
        f"| ± {found.error_noise_deg[ratio]:.2f}° |"
        for ratio in found.error_deg
    ]
    return f"""## Fig. 3: what MPI does to confidence, precision and accuracy

![Fig. 3](fig3.png)

Direct light at 90° and MPI at 153°, ASR 0.5 to 6, n_av 4000. Each condition has {effort.pixel_runs} recordings, photon
by photon.

| | paper | ours, worst condition |
|---|---|---|
| confidence against the model of the whole mix, A·\\|m₁\\| | | {found.confidence_mix:.1%} off |
| confidence against the one-path model A·r₁/(1 + ASR), MPI as signal | less than 10 % off | {found.confidence_single:.1%} off |
| phase precision against the model of the whole mix | | {found.precision_mix:.1%} off |
| phase precision against the one-path model, MPI as signal | similar | {found.precision_single:.1%} off |

The one-path model cannot know that two phasors 63° apart add up to less than the sum of their lengths. At MPI/laser 0.3
they add up to {1.1668 / 1.3:.1%} of it, so geometry alone makes a deviation of 10.2 %. The "less than 10 %" of the paper
fits that if MPI counts as signal in its ASR; the rest is the noise of its 200 runs. A standard deviation from
{effort.pixel_runs} runs is itself uncertain by {1 / (2 * effort.pixel_runs) ** 0.5:.0%}.

**Where the one-path model of precision fails.** At MPI/laser 0.3:

| ASR | simulated | one-path model | off by | … by the shorter phasor | … by scatter across it | both, by the model of the mix |
|---|---|---|---|---|---|---|
{chr(10).join(precision)}

The simulated scatter is larger for two reasons:

- **The phasor is shorter.** The model takes it for {found.precision[0].shorter - 1:.0%} longer than it is, at any ASR. So
  the phase scatters by as much more.
- **The light itself scatters across the phasor.** Photons of one path all have one direction, along which noise does not
  turn the phase. Photons of two paths scatter along the line between their phasors, and this line lies across the sum.

Ambient light scatters alike in all directions. If there is six times as much of it as of laser light, it makes nearly all
of the noise; if there is half as much, it hides little. So the "primarily consistent" of the paper holds to within a quarter
from ASR 3 on, and less and less below.

| MPI/laser | phase error, mean over ASR | spread over ASR | standard error of one condition |
|---|---|---|---|
{chr(10).join(lines)}

The phase error does not depend on ASR. Its spread over ASR is that of the noise, which is largest at ASR 6.
"""


def _scenes(four: Figure4, five: Figure5, effort: Effort) -> str:
    first, resolved, discrete = (
        f"{spread[0]:.2f} cm | {spread[1]:.2f} cm | {bias:+.2f} cm | {angle:.1f}°"
        for spread, bias, angle in zip(five.spread_cm, five.bias_cm, five.opening_deg[1:], strict=True)
    )
    return f"""## Fig. 4: inter-reflection

![Fig. 4](fig4.png)

| panel at 335 cm | paper | ours |
|---|---|---|
| without the second object | 335 cm | {four.without_cm:.1f} cm |
| with it, first phasor | around 333 cm | {four.with_cm:.1f} cm |
| with it, resolved by default: MPI {four.taken} | not tried | {four.resolved_cm:.1f} cm |
| with it, resolved with `--mpi-model discrete` | not tried | {four.discrete_cm:.1f} cm |

Light by way of another object travels farther, so it should make the panel look farther. In the paper's measurement the
panel looks nearer. That has two possible reasons:

- This light arrives more than half a period after the direct light.
- This light comes from something nearer than the panel, and reaches the pixels of the panel inside the camera.

We take the first, which fits the paper's words "positioned farther from the target": a reflector 5 m to the side. Its
light is 24 ns late at the middle of the panel, with 0.033 of the direct photons. **Both numbers were tuned until the first
phasor came out at 333 cm.** The paper gives neither distance nor strength. So this figure shows that such a scene is
possible, not that it was the scene of the paper. The resolved distances were not tuned.

Here the MPI is one late path, and no frame is taken for one with a tail. So the last two lines are the same. The distance
bends across the panel because of field curvature, as in Fig. 4(c).

## Fig. 5: corner

![Fig. 5](fig5.png)

The scene is two diffuse planes (albedo 0.8) at 90°, with their edge at 2 m. The light of one bounce is integrated over
the other plane, in 300 directions per pixel. {effort.frames} frames at n_av 1e5.

| error of planar depth | median | 90 % | bias | angle of the corner (true {five.opening_deg[0]:.1f}°) |
|---|---|---|---|---|
| first phasor, as the paper measured | {first} |
| resolved by default: MPI {five.taken} | {resolved} |
| resolved with `--mpi-model discrete` | {discrete} |

The paper says that the bounces make the path *shorter* than the geometry. A bounced path is longer. Its Fig. 5(d) shows a
corner that is rounded off. That follows all the same, because the shift vanishes at the edge and grows away from it.

The MPI here is a distribution of delays, not a second peak. So two ideal paths leave an error: near the edge, the delays
are shorter than the pulse, and pixels there sometimes get two paths wrongly, or one path where there should be two. The
tail that is predicted from the planes themselves ([docs/diffuse.md](../diffuse.md)) has no such edge.
"""
