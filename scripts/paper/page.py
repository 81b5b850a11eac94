"""Make the Markdown page: ours beside the paper's, condition by condition."""

from paper.effort import Effort
from paper.map_page import maps_section, table_1_section
from paper.pixel_experiments import Figure2, Figure3
from paper.resolver_experiments import Maps, Table1Row
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

n_av 4000, 5 photons a cycle, 10,000 cycles, 274.6 mV.
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
runs is itself {1 / (2 * effort.pixel_runs) ** 0.5:.0%} uncertain.

**Where the one-path model of precision fails.** At MPI/laser 0.3:

| ASR | seen | one-path model | off | … by the shorter phasor | … by the scatter across it | both, by the model of the mix |
|---|---|---|---|---|---|---|
{chr(10).join(precision)}

The model takes the phasor for {found.precision[0].shorter - 1:.0%} longer than it is, at any ASR, so the phase scatters
by as much more. The rest comes from the light itself: photons of one path all lie in one direction, where noise does not
turn the phase, but those of two paths scatter along the line between their phasors, and that line lies across the sum.
Ambient light scatters alike in all directions; with six times as much of it as of laser light it is nearly all the noise
there is, with half as much it hides little. So the paper's "primarily consistent" holds to within a fifth from ASR 3 on,
and ever less below.

| MPI/laser | phase error, mean over ASR | spread over ASR | standard error of one condition |
|---|---|---|---|
{chr(10).join(lines)}

The phase error does not depend on ASR: its spread is that of the noise, which is largest at ASR 6.
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
| with it, resolved as each frame says: MPI {four.taken} | not tried | {four.resolved_cm:.1f} cm |
| with it, resolved with `--mpi-model discrete` | not tried | {four.discrete_cm:.1f} cm |

Light that goes by way of another object travels farther, so it should make the panel look farther. It looks nearer, as the
paper measured, only if that light arrives more than half a period after the direct light, or if it comes from something
nearer than the panel and reaches its pixels inside the camera. We take the first reading, which fits "positioned farther
from the target": a reflector 5 m to the side, whose light is 24 ns late at the middle of the panel, with 0.033 of the direct
photons. **Both numbers were tuned until the first phasor came out at 333 cm**: the paper gives neither distance nor strength,
so this figure shows that such a scene can be, not that the paper's was it. What was not tuned is what resolving makes of it.
Here the MPI is one late path, and no frame is taken for one with a tail: the last two lines are the same.
The distance bends across the panel by field curvature, as in Fig. 4(c).

## Fig. 5: corner

![Fig. 5](fig5.png)

Two diffuse planes (albedo 0.8) at 90°, edge at 2 m; the light of one bounce is integrated over the other plane, in 300
directions a pixel. {effort.frames} frames at n_av 1e5.

| error of planar depth | median | 90 % | bias | angle of the corner (true {five.opening_deg[0]:.1f}°) |
|---|---|---|---|---|
| first phasor, as the paper measured | {first} |
| resolved as each frame says: MPI {five.taken} | {resolved} |
| resolved with `--mpi-model discrete` | {discrete} |

The paper says that the bounces make the path *shorter* than the geometry. A bounced path is longer; what its Fig. 5(d)
shows, a corner that is rounded off, follows all the same, because the shift vanishes at the edge and grows away from it. The
MPI here is a distribution of delays, not a second peak, so two ideal paths leave a rest: near the edge the delays are shorter
than the pulse, and pixels there are sometimes split in two or not split where they should be. The tail that the planes themselves
predict ([docs/diffuse.md](../diffuse.md)) has no such edge.
"""
