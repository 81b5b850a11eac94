"""How a pixel averages its samples: Eq. (1), from an integration length or from the capacitors of the paper's Fig. 1.

Every way of averaging is linear, so its weights describe it completely: the voltage read after n photons is Σ w_i V_m,i.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.errors import SettingsError, require
from cadtof_cli.records import setting

StageDrive = Literal["dc", "switched"]

STAGE_DRIVES: tuple[StageDrive, ...] = get_args(StageDrive)

BOLTZMANN_J_PER_K = 1.380649e-23

MOST_TICKS = 2_000_000
"""How many times a stage may switch while one harmonic is recorded: every time is held in memory and followed."""

_SAME_LENGTH = 1e-6
"""Largest relative difference between the integration lengths of the two channels."""


@dataclass(frozen=True, kw_only=True)
class Capacitors:
    """C1 … C12 of Fig. 1, in fF. SC1 uses C1, C2, C5, C6, C9, C10; SC2 uses C3, C4, C7, C8, C11, C12.

    All must be above 0, and both channels must have the same integration length.
    """

    values_ff: tuple[float, ...]

    def __post_init__(self) -> None:
        require(len(self.values_ff) == 12, "capacitors", f"{len(self.values_ff)} values", "12: C1 to C12 in fF")
        require(all(1e-9 <= c < math.inf for c in self.values_ff), "capacitors", self.values_ff, "all above 0 fF")
        first, second = ((c[0] + sum(c[1:])) / c[0] for c in self.nodes_ff)
        if abs(first - second) > _SAME_LENGTH * first:
            raise SettingsError(
                f"capacitors: found n_av {first:g} for SC1 and {second:g} for SC2, expected the same: "
                "(C1 + C_total1)/C1 = (C3 + C_total2)/C3"
            )

    @property
    def nodes_ff(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Capacitances of each channel, fF: the sampling capacitor, then the nodes behind SM, ST1 and ST2."""
        c = self.values_ff
        return (c[0], c[1], c[4] + c[5], c[8] + c[9]), (c[2], c[3], c[6] + c[7], c[10] + c[11])

    @property
    def integration_length(self) -> float:
        """n_av = (C1 + C_total1)/C1, section 2 of the paper."""
        nodes = self.nodes_ff[0]
        return sum(nodes) / nodes[0]

    def ktc_noise_v(self, temperature_k: float) -> float:
        """Return the noise √(kT/C1) of one sample, in V."""
        return math.sqrt(BOLTZMANN_J_PER_K * temperature_k / (self.values_ff[0] * 1e-15))


@dataclass(frozen=True, kw_only=True)
class Stages:
    """How ST1 and ST2 are driven.

    Attributes:
        drive: `dc`: the stages are always closed, so their capacitances add to C_total. `switched`: the stages switch at f1 and
            f2, so each stage shares its charge with the stage before it at that rate.
    """

    drive: StageDrive = setting(
        "dc", "How the stages ST1 and ST2 are driven; switched needs --capacitors.", option="--stages"
    )
    f1_hz: float = setting(1.0e6, "Switching rate of ST1; with --stages switched.")
    f2_hz: float = setting(1.0e4, "Switching rate of ST2; with --stages switched.")

    def __post_init__(self) -> None:
        require(self.drive in STAGE_DRIVES, "stages", self.drive, " or ".join(STAGE_DRIVES))
        for name, value in (("F1", self.f1_hz), ("F2", self.f2_hz)):
            require(1e-3 <= value < math.inf, name, f"{value:g} Hz", "a frequency above 0")


@dataclass(frozen=True, kw_only=True)
class Averaging:
    """The averaging of one pixel: an integration length, or capacitors, and the stages if they are switched."""

    integration_length: float
    capacitors: Capacitors | None = None
    stages: Stages = field(default_factory=Stages)

    def __post_init__(self) -> None:
        n_av = self.integration_length
        require(1 < n_av <= 1e15, "integration length", f"{n_av:g}", "a number above 1, 1e15 at most")
        require(
            self.capacitors is not None or self.stages.drive == "dc",
            "stages",
            "switched stages without capacitors",
            "the capacitors C1 to C12 (--capacitors): the stages share their charge",
        )

    def weights(self, photons: int, *, photon_rate_hz: float) -> Float:
        """Return the weights of the samples of SC1 and of SC2 in the voltages read at the end, (2, photons).

        Eq. (1) from 0 V gives w_i = (1/n_av)(1 − 1/n_av)^(N − i). If the stages switch so rarely that no sample reaches
        the last stage, a SettingsError is raised.
        """
        if self.capacitors is None or self.stages.drive == "dc":
            decay = math.log1p(-1.0 / self.integration_length)
            ages = np.arange(photons - 1, -1, -1)
            return np.broadcast_to(np.exp(decay * ages) / self.integration_length, (2, photons))
        first, second = self.capacitors.nodes_ff
        ticks = stage_ticks(self.stages, photons, photon_rate_hz)
        weights = cascade_weights(first, ticks, photons)
        if not weights.any():
            raise SettingsError(
                f"stages: found no sample that reaches ST2 within {photons} photons, expected that F1 and then F2 switch before: "
                "give more --cycles, or a higher --f1 and --f2"
            )
        return np.stack([weights, weights if second == first else cascade_weights(second, ticks, photons)])


def averaging_gain(integration_length: float) -> float:
    """Return Σ w_i² = 1/(2 n_av − 1), the factor by which Eq. (1) reduces the variance of one sample."""
    return 1.0 / (2.0 * integration_length - 1.0)


def effective_length(weights: Float, /) -> float:
    """Return the n_av with which Eq. (1) has the same noise as the weights: (1/Σ w² + 1)/2 if the weights add up to 1."""
    return (float(weights.sum()) ** 2 / float((weights**2).sum()) + 1.0) / 2.0


def stage_ticks(stages: Stages, photons: int, photon_rate_hz: float) -> list[tuple[int, int]]:
    """Return the ticks at which the stages switch, in the order of time: pairs (photons sampled before, stage 1 or 2).

    Photons arrive at an even rate here. Real photons arrive at random, which would move a tick by a few photons, but
    hundreds of photons lie between two ticks. A stage may switch MOST_TICKS times at most.
    """
    ticks = []
    for stage, frequency in ((1, stages.f1_hz), (2, stages.f2_hz)):
        per_tick = photon_rate_hz / frequency
        wanted = photons / per_tick
        require(
            wanted <= MOST_TICKS,
            f"F{stage}",
            f"{frequency:g} Hz, {wanted:g} times while {photons} photons come",
            f"{MOST_TICKS} times at most: a lower rate, or fewer --cycles",
        )
        moments = np.arange(1, math.floor(wanted + 1e-9) + 1) * per_tick
        ticks += [(float(moment), stage) for moment in moments]
    return [(min(math.ceil(moment - 1e-9), photons), stage) for moment, stage in sorted(ticks)]


def cascade_weights(nodes_ff: tuple[float, ...], ticks: list[tuple[int, int]], photons: int) -> Float:
    """Return the weights of the samples of all photons in the voltage of the last stage, (photons,).

    `nodes_ff` has the capacitances of the channel, as `Capacitors.nodes_ff`. C1 takes the sample and shares it with the node
    behind SM, to which it stays connected until the next photon. At a tick, a stage shares its charge with the stage before it.
    The effect of each sample on the final voltage is followed backwards in time, so the loop is over ticks, not over photons. If
    all stages share their charge between any two photons, this is Eq. (1) with C_total.
    """
    sampling, first, second, third = nodes_ff
    keep = first / (sampling + first)
    share1 = (sampling + first) / (sampling + first + second)
    share2 = second / (second + third)
    between = np.diff([0, *(before for before, _ in ticks), photons])
    fall = keep ** np.arange(between.max(), dtype=np.float64)
    weights = np.zeros(photons)
    on_first, on_second, on_third = 0.0, 0.0, 1.0
    stop = photons
    for before, stage in reversed([(0, 0), *ticks]):
        count = stop - before
        weights[before:stop] = on_first * (1.0 - keep) * fall[:count][::-1]
        on_first *= keep**count
        stop = before
        if stage == 1:
            both = on_first + on_second
            on_first, on_second = share1 * both, (1.0 - share1) * both
        elif stage == 2:
            both = on_second + on_third
            on_second, on_third = share2 * both, (1.0 - share2) * both
    return weights
