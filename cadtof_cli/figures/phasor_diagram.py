"""A pixel's phasors in the complex plane: one panel per harmonic, with the paths and the ellipse of the noise."""

import itertools
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from cadtof_cli.arrays import Float
from cadtof_cli.figures.canvas import Figure, add_title
from cadtof_cli.figures.kinds import save
from cadtof_cli.figures.scales import DIRECT_COLOUR, MEASURED_COLOUR, MPI_COLOUR, OTHER_COLOUR
from cadtof_cli.pipeline.one_pixel import PixelEvidence

DOTS_PER_INCH = 120

_SIDE, _LEFT, _GAP, _TOP, _BOTTOM = 4.0, 0.8, 0.6, 0.75, 1.2
"""Side of a panel, and the space around it, in inches."""

LEAST_ELLIPSE = 0.03
"""Smallest standard deviation that is drawn without magnification, as a share of the panel's half width."""

MOST_ELLIPSE = 0.1
"""Largest magnified standard deviation, as a share of the panel's half width without the ellipses."""


def draw_phasors(evidence: PixelEvidence, path: Path, /, *, title: str) -> None:
    """Draw the diagram as a picture; raises OutputError if the file cannot be written."""
    harmonics = evidence.noise.harmonics
    width, height = _LEFT + len(harmonics) * (_SIDE + _GAP), _TOP + _SIDE + _BOTTOM
    figure = Figure(figsize=(width, height))
    add_title(figure, title, below=0.2, size=10)
    for row, harmonic in enumerate(harmonics):
        left = _LEFT + row * (_SIDE + _GAP)
        axes = figure.add_axes((left / width, _BOTTOM / height, _SIDE / width, _SIDE / height))
        _panel(axes, evidence, row, harmonic)
    figure.axes[0].set_ylabel("imaginary part (SC2)", fontsize=9)
    save(figure, path, dpi=DOTS_PER_INCH)


def _panel(axes: Axes, evidence: PixelEvidence, row: int, harmonic: int) -> None:
    phasor = evidence.phasors[row]
    axes.set_aspect("equal")
    axes.set_xlabel("real part (SC1)", fontsize=9)
    axes.set_title(f"harmonic {harmonic}, divided by the modulation amplitude", fontsize=10)
    axes.tick_params(labelsize=8)
    axes.axhline(0.0, color="0.85", lw=0.8, zorder=0)
    axes.axvline(0.0, color="0.85", lw=0.8, zorder=0)
    if not np.isfinite(phasor):
        axes.text(0.5, 0.5, "not finite", ha="center", va="center", transform=axes.transAxes)
        return
    steps = evidence.of_paths[row]
    # each arrow starts at the end of the one before
    ends = [complex(end) for end in np.cumsum(steps[np.isfinite(steps)])]
    reach = 1.18 * max(abs(phasor), *(abs(end) for end in ends), 1e-9)
    _arrow(axes, 0.0, phasor, MEASURED_COLOUR, "recorded", width=1.6)
    paths = (DIRECT_COLOUR, "direct"), (MPI_COLOUR, "MPI"), (OTHER_COLOUR, "further paths")
    named = itertools.chain(paths, itertools.repeat((OTHER_COLOUR, None)))
    for start, end, (colour, name) in zip((0.0, *ends), ends, named, strict=False):
        _arrow(axes, start, end, colour, name, width=2.4)
    reach = max(reach, 1.05 * _ellipse(axes, phasor, evidence.covariance[row], reach))
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(abs(phasor) * np.cos(turn), abs(phasor) * np.sin(turn), color="0.9", lw=0.8, zorder=0)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=8, frameon=False)


def _arrow(axes: Axes, start: complex, end: complex, colour: str, name: str | None, *, width: float) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(end.real, end.imag), xytext=(start.real, start.imag), arrowprops=style)
    axes.plot([], [], color=colour, lw=width, label=name)


def _ellipse(axes: Axes, phasor: complex, covariance: Float, reach: float) -> float:
    """Draw one and two standard deviations of the noise, magnified if they are small; return how far they reach."""
    if not np.isfinite(covariance).all():
        return 0.0
    variances, directions = np.linalg.eigh(covariance)
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    times = _magnification(float(sigmas[1]), reach)
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    for count in (1, 2):
        width, height = 2.0 * count * times * sigmas[1], 2.0 * count * times * sigmas[0]
        label = None if count == 2 else "noise, 1 and 2 σ" + (f", magnified {times:g} times" if times > 1.0 else "")
        where, style = (phasor.real, phasor.imag), {"fill": False, "color": "#e08a00", "lw": 1.3 / count}
        axes.add_patch(Ellipse(where, width, height, angle=angle, label=label, **style))
    return float(max(abs(phasor.real), abs(phasor.imag)) + 2.0 * times * sigmas[1])


def _magnification(sigma: float, reach: float) -> float:
    """Return the magnification of an ellipse: 1, or for a small one the largest of 2, 5, 10 … up to `MOST_ELLIPSE`."""
    times, steps = 1.0, itertools.cycle((2.0, 2.5, 2.0))
    if 0.0 < sigma < LEAST_ELLIPSE * reach:
        while sigma * times * (step := next(steps)) <= MOST_ELLIPSE * reach:
            times *= step
    return times
