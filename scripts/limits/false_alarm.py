"""Measure how often light without MPI is taken for two paths: by the misfit alone, and by the whole order test."""

import itertools
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from cadtof_cli.phasors.noise import chi_squared_threshold
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.resolver.status import StatusBit
from limits.drawn import SEEDS, drawn, markdown, power, resolved, write_csv
from tests.support.mixtures import Mixture

ASKED = (0.05, 0.01, 0.001)
HARMONICS = ((1, 2), (1, 2, 3))
LIGHTS = ((1.0, 1e4), (2.0, 1e5), (6.0, 1e5), (2.0, 1e6))
"""ASR and n_av."""

WITHIN = 0.15


@dataclass(frozen=True)
class Rate:
    """Shares of pixels without MPI under one light.

    Attributes:
        harmonics: number of harmonics.
        asr, n_av: the light.
        asked: the probability of a false alarm that was asked for.
        misfit: share whose misfit with one path exceeds the threshold.
        two: share found as two paths.
    """

    harmonics: int
    asr: float
    n_av: float
    asked: float
    misfit: float
    two: float


def measured(harmonics: tuple[int, ...], asr: float, n_av: float, *, pixels: int) -> list[Rate]:
    """Return the shares under one light, for every probability in `ASKED`."""
    phasors = drawn(
        Mixture((1.0,), (5.0,), asr=asr), harmonics, n_av, pixels=pixels, key=[len(harmonics), round(asr), round(n_av)]
    )
    misfit = resolved(phasors, harmonics, n_av, ResolverSettings(order="1")).chi_squared
    rates = []
    for asked in ASKED:
        found = resolved(phasors, harmonics, n_av, ResolverSettings(false_alarm=asked)).status
        beyond = misfit > chi_squared_threshold(asked, pairs=len(harmonics) - 1)
        two = float(np.mean((found & StatusBit.TWO_PATHS) > 0))
        rates.append(Rate(len(harmonics), asr, n_av, asked, float(beyond.mean()), two))
    return rates


def false_alarm(out: Path, *, pixels: int) -> str:
    """Measure, write the table, and return the page."""
    rates = [
        rate
        for numbers, (asr, n_av) in itertools.product(HARMONICS, LIGHTS)
        for rate in measured(numbers, asr, n_av, pixels=pixels // (len(numbers) - 1))
    ]
    write_csv(out / "false_alarm.csv", (asdict(rate) for rate in rates))
    head = ["harmonics", "ASR, n_av", "P", "misfit alone", "over P", "found as two", "over P"]
    lines = [
        [
            "{1,2}" if rate.harmonics == 2 else "{1,2,3}",
            f"{rate.asr:g}, {power(rate.n_av)}",
            f"{rate.asked:g}",
            *(f"{rate.misfit:.5f}", f"{rate.misfit / rate.asked:.2f}"),
            *(f"{rate.two:.5f}", f"{rate.two / rate.asked:.2f}"),
        ]
        for rate in rates
    ]
    off = max(abs(rate.misfit / rate.asked - 1.0) for rate in rates)
    shares = [rate.two / rate.asked for rate in rates]
    return PAGE.format(
        seeds=SEEDS,
        pixels=pixels,
        pixels_three=pixels // 2,
        table=markdown(head, lines),
        off=off,
        verdict="so" if off <= WITHIN else "**not so**",
        least=min(shares),
        most=max(shares),
        scatter=1.0 / (min(ASKED) * SEEDS * pixels / 2) ** 0.5,
    )


PAGE = """# False alarms

For everyone who sets `--false-alarm`: how often light without MPI is taken for two paths.

Made by `scripts/measure_limits false_alarm` from pixels without MPI. Each light has {seeds} seeds × {pixels} pixels
with harmonics 1 and 2 ({pixels_three} with three harmonics). All numbers are in [false_alarm.csv](false_alarm.csv).

`--false-alarm P` sets two thresholds:

- A pixel has a signal if its power is above a threshold that noise alone exceeds with probability P.
- One path is not enough if its misfit is above a threshold that noise alone exceeds with probability P.

For a second path there is one more condition, which does not depend on P: the second path must move the direct path
by more than the scatter that it adds. So fewer pixels without MPI than P **end** with two paths; for them P is an
upper limit. If the misfit alone decided, their share would be P:

- "misfit alone": share of the pixels for which one path is not enough;
- "found as two": share of the pixels that end with two paths;
- "over P": the share before it, divided by P.

{table}

Asked: the share by the misfit alone is within 15 % of P. That is {verdict}: it is off by {off:.0%} at most, while
counting alone scatters by up to {scatter:.0%}. The share found as two is {least:.2f} to {most:.2f} of P; the smaller
P is, the larger is this part.

It would be wrong to raise that share to P: the pixels that were added would get second paths that make the depth
worse. The condition on the direct path keeps such false second paths from doubling the error over all pixels, unless
light is faint.

**Faint light.** The noise of a channel is about 1/(2 sqrt(n_av)). If it is more than a fortieth of the amplitude of
the light (ASR above 14 at n_av 1e5, above 4 at 1e4), a false second path may be stronger than `--min-return-ratio`. If
it also comes first, the depth of the pixel is its depth: up to 3 m wrong, by many sigma. If the noise is a twentieth of
the amplitude, this is so in 2 to 5 pixels of a thousand. The RMSE over all pixels is then 7 times sigma; medians do not
change. With `--return strongest` the RMSE is 1.0 times sigma again (`tests/contracts/test_noise_of_frames.py`).
"""
