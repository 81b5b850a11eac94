"""Averaging by Eq. (1) and by the charge-sharing cascade of Fig. 1."""

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.pixel.averaging import (
    Averaging,
    Capacitors,
    Stages,
    cascade_weights,
    effective_length,
    stage_ticks,
)

VALUES_FF = (1.0, 20.0, 1.0, 25.0, 10.0, 9.0, 8.0, 9.0, 12.0, 8.0, 9.0, 8.0)
RATE_HZ = 125e6


def capacitors() -> Capacitors:
    return Capacitors(values_ff=VALUES_FF)


def switched(f1_hz: float, f2_hz: float, photons: int = 400) -> Float:
    stages = Stages(drive="switched", f1_hz=f1_hz, f2_hz=f2_hz)
    averaging = Averaging(integration_length=60.0, capacitors=capacitors(), stages=stages)
    return averaging.weights(photons, photon_rate_hz=RATE_HZ)


def test_integration_length_is_section_2_of_the_paper() -> None:
    # C_total1 = C2 + C5 + C6 + C9 + C10 = 20 + 10 + 9 + 12 + 8 = 59 and C_total2 = 25 + 8 + 9 + 9 + 8 = 59.
    assert capacitors().integration_length == pytest.approx(60.0)


def test_weights_are_equation_1() -> None:
    weights = Averaging(integration_length=60.0).weights(300, photon_rate_hz=RATE_HZ)
    expected = [(1 / 60) * (1 - 1 / 60) ** (300 - i) for i in range(1, 301)]
    np.testing.assert_allclose(weights, [expected, expected], rtol=1e-12)


def test_fast_switching_is_equation_1_with_all_capacitors() -> None:
    fast = switched(60 * RATE_HZ, 60 * RATE_HZ)
    equation = Averaging(integration_length=60.0).weights(400, photon_rate_hz=RATE_HZ)
    np.testing.assert_allclose(fast, equation, rtol=1e-6)


def test_slower_switching_departs_from_equation_1_step_by_step() -> None:
    equation = Averaging(integration_length=60.0).weights(400, photon_rate_hz=RATE_HZ)
    departures = [np.abs(switched(f * RATE_HZ, f * RATE_HZ) - equation).max() for f in (30.0, 5.0, 1.0, 0.2)]
    assert departures == sorted(departures)


def simulated(samples: Float, nodes: tuple[float, ...], ticks: list[tuple[int, int]]) -> float:
    """Return the last stage's voltage in the end; the charges are moved event by event, forwards in time."""
    sampling, first, second, third = nodes
    v1 = v2 = v3 = 0.0
    waiting = list(ticks)
    for number, sample in enumerate(samples, start=1):
        v1 = (sampling * sample + first * v1) / (sampling + first)
        while waiting and waiting[0][0] <= number:
            if waiting.pop(0)[1] == 1:
                v1 = v2 = ((sampling + first) * v1 + second * v2) / (sampling + first + second)
            else:
                v2 = v3 = (second * v2 + third * v3) / (second + third)
    return v3


def test_cascade_weights_are_the_charges_moved_event_by_event() -> None:
    stages = Stages(drive="switched", f1_hz=RATE_HZ / 7.3, f2_hz=RATE_HZ / 41.9)
    ticks = stage_ticks(stages, 500, RATE_HZ)
    nodes = capacitors().nodes_ff[0]
    samples = np.random.default_rng(1).standard_normal(500)
    assert cascade_weights(nodes, ticks, 500) @ samples == pytest.approx(simulated(samples, nodes, ticks), rel=1e-12)


def test_ticks_fall_between_the_photons_they_separate() -> None:
    stages = Stages(drive="switched", f1_hz=RATE_HZ / 125, f2_hz=RATE_HZ / 500)
    assert stage_ticks(stages, 500, RATE_HZ) == [(125, 1), (250, 1), (375, 1), (500, 1), (500, 2)]


def test_a_steady_voltage_is_reached_by_every_stage() -> None:
    assert switched(RATE_HZ / 5, RATE_HZ / 20, photons=20_000).sum(axis=1) == pytest.approx([1.0, 1.0], abs=1e-9)


def test_switching_averages_longer_than_the_capacitors_alone() -> None:
    weights = switched(RATE_HZ / 125, RATE_HZ / 12_500, photons=2_000_000)[0]
    assert weights.sum() == pytest.approx(1.0, abs=1e-6)
    assert effective_length(weights) > 60.0


@pytest.mark.parametrize(("f1_hz", "f2_hz"), [(RATE_HZ / 125, RATE_HZ / 500), (RATE_HZ / 500, RATE_HZ / 125)])
def test_stages_that_switch_too_seldom_for_any_sample_are_refused(f1_hz: float, f2_hz: float) -> None:
    with pytest.raises(SettingsError, match="no sample that reaches ST2 within 400 photons"):
        switched(f1_hz, f2_hz)
    assert switched(f1_hz, f2_hz, photons=1000).sum() > 0.0


def test_effective_length_of_equation_1_is_its_integration_length() -> None:
    weights = Averaging(integration_length=60.0).weights(4000, photon_rate_hz=RATE_HZ)[0]
    assert effective_length(weights) == pytest.approx(60.0, rel=1e-9)


def test_ktc_noise_of_a_femtofarad_is_two_millivolts() -> None:
    assert capacitors().ktc_noise_v(300.0) == pytest.approx(2.035e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((1.0,) * 11, "found 11 values, expected 12"),
        ((0.0, *VALUES_FF[1:]), "all above 0 fF"),
        ((1.0, 21.0, *VALUES_FF[2:]), "found n_av 61 for SC1 and 60 for SC2, expected the same"),
    ],
)
def test_impossible_capacitors_are_refused(values: tuple[float, ...], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Capacitors(values_ff=values)


def test_impossible_averaging_is_refused() -> None:
    with pytest.raises(SettingsError, match="integration length: found 1, expected a number above 1"):
        Averaging(integration_length=1.0)
    with pytest.raises(SettingsError, match="switched stages without capacitors"):
        Averaging(integration_length=10.0, stages=Stages(drive="switched"))
    with pytest.raises(SettingsError, match="F1: found 0 Hz, expected a frequency above 0"):
        Stages(f1_hz=0.0)


@pytest.mark.parametrize("scale", [0.25, 3.0])
def test_the_effective_length_is_that_of_the_weights_shares(scale: float) -> None:
    """An average that has not settled yet, or is amplified, is over the same number of photons."""
    weights = switched(RATE_HZ / 7.3, RATE_HZ / 41.9, photons=5000)[0]
    assert effective_length(scale * weights) == pytest.approx(effective_length(weights), rel=1e-12)


def test_stages_are_closed_by_default_or_switch_at_a_megahertz_and_ten_kilohertz() -> None:
    assert Stages() == Stages(drive="dc", f1_hz=1e6, f2_hz=1e4)
    assert stage_ticks(Stages(drive="switched"), 25_000, RATE_HZ)[-1] == (25_000, 2)
    assert len(stage_ticks(Stages(drive="switched"), 25_000, RATE_HZ)) == 200 + 2


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_frequencies_and_capacitances_are_numbers_above_zero(value: float) -> None:
    with pytest.raises(SettingsError, match="F2: found"):
        Stages(f2_hz=value)
    with pytest.raises(SettingsError, match="all above 0 fF"):
        Capacitors(values_ff=(*VALUES_FF[:11], value))
