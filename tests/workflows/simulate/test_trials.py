"""Simulated runs agree with the paper's Table 1 and with the Cramér–Rao bound; the two ways of simulating agree."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Modulation
from cadtof_cli.errors import SettingsError
from cadtof_cli.figures.canvas import Figure
from cadtof_cli.figures.sweep_maps import draw_confidence
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages
from cadtof_cli.simulation.pixel.mix import Condition
from cadtof_cli.simulation.pixel.pixel import PixelModel, noise_length
from cadtof_cli.workflows.simulate.outcome import TrialsSummary, summary
from cadtof_cli.workflows.simulate.sweep import rows
from cadtof_cli.workflows.simulate.trials import (
    Recordings,
    Trials,
    block_voltages,
    recordings,
    resolved,
)

TABLE_1 = [(16.0, 0.05, 0.16), (25.0, 0.03, 0.12), (11.0, 0.17, 0.52)]
"""Time of the second path, then the standard deviations of both paths, in ns, at ASR 5, MPI ratio 0.3 and n_av 1e5."""


def trials(integration_length: float = 1e5, **settings: Any) -> Trials:
    base = Trials(
        condition=Condition(asr=5.0, mpi_ratio=0.3),
        model=PixelModel(averaging=Averaging(integration_length=integration_length)),
    )
    return replace(base, **settings)


def outcome(wanted: Trials) -> TrialsSummary:
    return summary(wanted, Recordings.joined([recordings(wanted, runs) for runs in wanted.blocks]))


@pytest.mark.parametrize(("second_ns", "direct_std", "second_std"), TABLE_1)
def test_table_1_of_the_paper_is_reproduced(second_ns: float, direct_std: float, second_std: float) -> None:
    found = outcome(trials(condition=Condition(asr=5.0, mpi_ratio=0.3, second_ns=second_ns), runs=4000))
    for path, paper in ((found.direct, direct_std), (found.second, second_std)):
        assert path.std_ns == pytest.approx(paper, rel=0.15) or round(path.std_ns, 2) == paper
        assert path.std_ns == pytest.approx(path.bound_ns, rel=0.06)
        assert abs(path.bias_ns) < 0.1 * path.std_ns


def test_photon_by_photon_agrees_with_statistics_within_sampling_error() -> None:
    runs = 240
    by_photons = outcome(trials(3000.0, runs=runs, photon_by_photon=True))
    exact = outcome(trials(3000.0, runs=20_000))
    for first, second in ((by_photons.direct, exact.direct), (by_photons.second, exact.second)):
        assert first.std_ns == pytest.approx(second.std_ns, rel=4 / math.sqrt(2 * runs))
        assert first.mean_ns == pytest.approx(second.mean_ns, abs=4 * second.std_ns / math.sqrt(runs))
    assert by_photons.confidence_v == pytest.approx(exact.confidence_v, rel=0.02)


@pytest.mark.parametrize("asr", [1.0, 3.0, 6.0])
def test_the_direct_path_without_mpi_has_the_noise_of_one_path_on_two_harmonics(asr: float) -> None:
    """For a short pulse, the phase of harmonic h over h has the standard deviation √(ASR(1+ASR)/(2(2n_av−1)))/h.

    Both harmonics together have that of the first over √(1+4).
    """
    found = outcome(trials(condition=Condition(asr=asr, mpi_ratio=0.0, fwhm_ns=1e-3), runs=20_000))
    alone = math.sqrt(asr * (1 + asr) / (2 * (2e5 - 1))) * 40.0 / (2 * math.pi)
    # at most one run in a hundred is taken for two paths, which scatter more
    assert found.direct.std_ns == pytest.approx(alone / math.sqrt(5.0), rel=0.06)
    assert abs(found.direct.bias_ns) < 4 * found.direct.std_ns / math.sqrt(20_000)
    assert found.phase_std_rad * 40.0 / (2 * math.pi) == pytest.approx(alone, rel=0.02)
    assert math.isnan(found.second.true_ns)
    assert math.isnan(found.second.within_1ns)


def of_triangles(length: float, harmonics: int = 2, **options: Any) -> Trials:
    """Return trials of a pixel with triangle waves."""
    modulation = Modulation(periods_ns=tuple(40.0 / h for h in range(1, harmonics + 1)), waveform="triangle")
    return trials(model=PixelModel(averaging=Averaging(integration_length=length), modulation=modulation), **options)


@pytest.mark.parametrize("harmonics", [2, 3])
def test_triangles_are_resolved_with_all_their_terms_and_reach_the_bound(harmonics: int) -> None:
    found = outcome(of_triangles(1e5, harmonics, runs=2000))
    for one in (found.direct, found.second):
        assert abs(one.bias_ns) < 5.0 * one.std_ns / math.sqrt(2000)
        assert one.std_ns == pytest.approx(one.bound_ns, rel=0.12)


@pytest.mark.parametrize("direct_ns", [0.1, 5.0, 9.9])
def test_voltages_near_the_peaks_of_a_triangle_are_not_impossible(direct_ns: float) -> None:
    """There, they exceed the amplitude of the triangle's fundamental."""
    condition = Condition(asr=0.05, mpi_ratio=0.0, direct_ns=direct_ns)
    wanted = of_triangles(1e5, condition=condition, runs=200)
    found = Recordings.joined([recordings(wanted, runs) for runs in wanted.blocks])
    assert not found.impossible.any()
    np.testing.assert_allclose(found.times_ns[0], direct_ns, atol=0.1)


def test_the_papers_search_takes_triangles_for_sines() -> None:
    wanted = of_triangles(1e5, resolver=ResolverSettings(solver="lm"), runs=50)
    found = Recordings.joined([recordings(wanted, runs) for runs in wanted.blocks])
    sines = replace(wanted, model=replace(wanted.model, modulation=Modulation()))
    np.testing.assert_array_equal(resolved(sines, found.voltages_v).times_ns, found.times_ns)
    assert abs(outcome(wanted).direct.bias_ns) > 0.3


@pytest.mark.parametrize("direct_ns", [0.0, 0.02, 20.0, 39.98])
def test_times_at_the_ends_of_the_period_are_no_errors_of_a_period(direct_ns: float) -> None:
    """The standard deviation is .02 ns. So half of the runs at 0 ns fall on the other side of the end of the period."""
    condition = Condition(asr=2.0, mpi_ratio=0.0, direct_ns=direct_ns, second_ns=39.99)
    found = outcome(trials(3e4, condition=condition, runs=2000, resolver=ResolverSettings(order="1"))).direct
    middle = Condition(asr=2.0, mpi_ratio=0.0, direct_ns=12.0)
    expected = outcome(trials(3e4, condition=middle, runs=2000, resolver=ResolverSettings(order="1"))).direct
    assert found.std_ns == pytest.approx(expected.std_ns, rel=0.1)
    assert abs(found.bias_ns) < 5 * expected.std_ns / math.sqrt(2000)
    assert found.mean_ns == pytest.approx(direct_ns + found.bias_ns)
    assert found.true_ns == direct_ns


def test_success_is_a_time_within_one_nanosecond_of_the_truth() -> None:
    """A Gaussian of standard deviation s lies within ±1 ns with probability erf(1/(s√2))."""
    condition = Condition(asr=5.0, mpi_ratio=0.3, second_ns=16.0)
    found = outcome(trials(3000.0, condition=condition, runs=4000, resolver=ResolverSettings(order="2"))).second
    expected = math.erf(1.0 / (found.std_ns * math.sqrt(2.0)))
    assert 0.4 < expected < 0.8
    assert found.within_1ns == pytest.approx(expected, abs=0.05)


def test_jitter_widens_the_pulse_of_drawn_voltages_and_of_the_bound_alike() -> None:
    """Jitter of 2 ns and a pulse of 1.7 ns (FWHM): r1 = exp(−(2π·s/T1)²/2), where s² is the sum of both variances."""
    model = PixelModel(averaging=Averaging(integration_length=1e5), jitter_ns=2.0)
    found = outcome(trials(model=model, condition=Condition(asr=1.0, mpi_ratio=0.0), runs=2000))
    spread_rad = 2 * math.pi * math.hypot(1.7 / 2.354820045, 2.0) / 40.0
    expected_v = 0.2746 * math.exp(-(spread_rad**2) / 2) / 2.0
    assert found.confidence_v == pytest.approx(expected_v, rel=1e-3)
    assert found.confidence_model_v == pytest.approx(expected_v, rel=1e-9)
    # the phase of one harmonic scatters by the noise across its phasor over its length; the bound of both is lower
    across = (1 - math.exp(-2 * spread_rad**2) / 2) / 2
    alone_rad = math.sqrt(across / (2e5 - 1)) / (math.exp(-(spread_rad**2) / 2) / 2)
    assert found.phase_std_rad == pytest.approx(alone_rad, rel=0.05)
    second = [math.exp(-((k * spread_rad) ** 2) / 2) for k in (2, 4)]
    alone_second = math.sqrt((1 - second[1] / 2) / 2 / (2e5 - 1)) / (second[0] / 2) / 2
    together = 1 / math.sqrt(alone_rad**-2 + alone_second**-2)
    assert found.direct.bound_ns == pytest.approx(together * 40.0 / (2 * math.pi), rel=1e-3)


def test_noise_of_the_samples_widens_the_scatter_and_the_bound_alike() -> None:
    """The bound was that of the photons alone: half of the scatter with a sample noise of .3 V."""
    model = PixelModel(averaging=Averaging(integration_length=1e5), sample_noise_v=0.3)
    found = outcome(trials(model=model, runs=4000))
    assert found.direct.std_ns == pytest.approx(found.direct.bound_ns, rel=0.06)
    assert found.second.std_ns == pytest.approx(found.second.bound_ns, rel=0.06)
    [row] = rows([found])
    assert row["phase_std_rad"] == pytest.approx(row["phase_model_std_rad"], rel=0.06)


def test_noise_of_the_samples_is_not_taken_for_a_second_path() -> None:
    """The order test was told the noise of the photons alone, and found a second path in 13 % of the runs."""
    model = PixelModel(averaging=Averaging(integration_length=1e5), sample_noise_v=0.3)
    wanted = trials(condition=Condition(asr=3.0, mpi_ratio=0.0), model=model, runs=1000)
    [block] = wanted.blocks
    assert np.isfinite(recordings(wanted, block).times_ns[1]).mean() < 0.015


def test_phase_error_does_not_depend_on_asr() -> None:
    """10 ns are 90°, and MPI of 0.3 at 17 ns, 153°, turns the sum by 13.24°. Ambient light turns nothing."""
    errors = [
        outcome(trials(condition=Condition(asr=asr, mpi_ratio=0.3, direct_ns=10.0, second_ns=17.0), runs=2000))
        for asr in (0.5, 2.0, 6.0)
    ]
    np.testing.assert_allclose([math.degrees(found.phase_bias_rad) for found in errors], 13.24, atol=0.1)


def test_runs_without_an_answer_count_as_failures() -> None:
    blind = trials(
        condition=Condition(asr=5.0, mpi_ratio=0.3),
        runs=500,
        resolver=ResolverSettings(order="1"),
    )
    found = outcome(blind)
    assert found.second.within_1ns == 0.0
    assert math.isnan(found.second.std_ns)


def test_streams_of_one_seed_are_independent() -> None:
    first, second = (block_voltages(trials(stream=stream), range(400)) for stream in (0, 1))
    correlation = np.corrcoef(first[:, 0, 0], second[:, 0, 0])[0, 1]
    assert abs(correlation) < 4 / math.sqrt(400)


def test_switched_stages_have_the_noise_of_their_effective_length() -> None:
    capacitors = Capacitors(values_ff=(1.0, 30.0, 1.0, 30.0, *[10.0] * 8))
    stages = Stages(drive="switched", f1_hz=125e6 / 20, f2_hz=125e6 / 100)
    averaging = Averaging(integration_length=71.0, capacitors=capacitors, stages=stages)
    model = PixelModel(averaging=averaging, cycles=4000)
    settled = trials(model=model, runs=1000)
    assert noise_length(model) > 71.0
    voltages = block_voltages(settled, settled.blocks[0])
    sample_variance = 0.5 * 0.2746**2
    assert voltages[:, 0].var(axis=0).mean() == pytest.approx(sample_variance / (2 * noise_length(model) - 1), rel=0.15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"further": ((0.2, 3.0),)}, "path: found 3 ns, a separation of -2 ns, expected a time after the direct 5 ns"),
        ({"asr": -1.0}, "ASR: found -1, expected a ratio from 0 to"),
        ({"mpi_ratio": -0.1}, "MPI ratio: found -0.1, expected a ratio from 0 to"),
        ({"direct_ns": 40.0}, "direct: found 40 ns, expected 0 to less than 40 ns"),
        ({"second_ns": 5.0}, "second: found 5 ns, a separation of 0 ns, expected a time after the direct 5 ns"),
        ({"second_ns": 41.0}, "second: found 41 ns, a separation of 36 ns"),
        ({"fwhm_ns": math.inf}, "pulse width: found inf ns"),
    ],
)
def test_impossible_conditions_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        trials(condition=Condition(**({"asr": 5.0, "mpi_ratio": 0.3} | change)))


def test_impossible_trials_are_refused() -> None:
    with pytest.raises(SettingsError, match="runs: found 1, expected 2 to 1000000000"):
        trials(runs=1)
    with pytest.raises(SettingsError, match="seed: found -1"):
        trials(seed=-1)
    with pytest.raises(SettingsError, match="dead time: found without --photons"):
        trials(model=PixelModel(averaging=Averaging(integration_length=100.0), dead_time_ns=5.0))
    odd = PixelModel(modulation=Modulation(periods_ns=(40.0, 10.0)), averaging=Averaging(integration_length=100.0))
    with pytest.raises(SettingsError, match=r"found harmonics 1, 4 of the first period; with 2 periods, 2 paths"):
        trials(model=odd)


def test_figures_of_three_runs_are_those_of_a_sample() -> None:
    """Three runs of one path without noise, at 8.9, 9 and 9.1 ns; 8.95 ns is true.

    The variance of a sample divides by n − 1, so the standard deviation is 0.1 ns.
    """
    times = np.array([8.9, 9.0, 9.1])
    phasors = [0.2746 * np.exp(-((h * 2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2) / 3 for h in (1, 2)]
    waves = np.stack([a * np.exp(2j * np.pi * h * times / 40.0) for a, h in zip(phasors, (1, 2), strict=True)], axis=1)
    wanted = trials(condition=Condition(asr=2.0, mpi_ratio=0.0, direct_ns=8.95), runs=3)
    found = summary(wanted, resolved(wanted, np.stack([waves.real, waves.imag], axis=2)))
    assert found.direct.std_ns == pytest.approx(0.1, rel=1e-6)
    assert found.direct.mean_ns == pytest.approx(9.0, rel=1e-6)
    assert found.direct.bias_ns == pytest.approx(0.05, rel=1e-5)
    assert found.phase_std_rad == pytest.approx(0.1 * 2 * np.pi / 40.0, rel=1e-6)
    assert found.phase_bias_rad == pytest.approx(0.05 * 2 * np.pi / 40.0, rel=1e-5)
    assert found.direct.within_1ns == 1.0


def test_the_picture_of_a_single_asr_shows_the_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line of one point cannot be seen; it has a marker."""
    drawn: list[Figure] = []
    monkeypatch.setattr("cadtof_cli.figures.sweep_maps.Figure.savefig", lambda figure, _: drawn.append(figure))
    draw_confidence(list(rows([outcome(trials(runs=3))])), tmp_path / "first_phasor.png")
    [figure] = drawn
    assert [[line.get_marker() for line in axes.lines] for axes in figure.axes[:2]] == [["o", "_"]] * 2


THREE = PixelModel(modulation=Modulation(periods_ns=(40.0, 20.0, 13.3333)), averaging=Averaging(integration_length=1e6))


def test_three_harmonics_reach_their_bound_which_is_below_that_of_two() -> None:
    """With 6 ns between the paths and the same light in all, three harmonics are 2.9 times better (docs/solvers.md).

    Here each harmonic has the same light, so they are 2.9 · √1.5 = 3.6 times better.
    """
    light = Condition(asr=5.0, mpi_ratio=0.3, second_ns=11.0)
    three, two = (
        outcome(trials(condition=light, model=THREE, runs=2000)),
        outcome(trials(1e6, condition=light, runs=2000)),
    )
    for path in three.paths:
        assert path.std_ns == pytest.approx(path.bound_ns, rel=0.08)
    assert 2.5 < two.direct.std_ns / three.direct.std_ns < 4.5


def test_three_paths_come_back_in_falling_strength() -> None:
    light = Condition(asr=5.0, mpi_ratio=0.4, second_ns=21.0, further=((0.6, 13.0),))
    found = outcome(trials(condition=light, model=THREE, runs=1000, resolver=ResolverSettings(paths=3)))
    assert [path.true_ns for path in found.paths] == [5.0, 13.0, 21.0]
    for path in found.paths:
        assert path.std_ns == pytest.approx(path.bound_ns, rel=0.15)
        assert path.within_1ns > 0.99
    two = outcome(trials(condition=light, model=THREE, runs=50))
    assert math.isnan(two.paths[2].std_ns)
    assert two.paths[2].within_1ns == 0.0


def test_the_papers_way_wraps_times_at_half_the_period() -> None:
    """A uniform time scatters by 40/√12 = 11.5 ns; a time whose truth lies near the end of its range, by more."""
    worst = Condition(asr=6.0, mpi_ratio=0.1)
    ways = {"pulse_correction": False, "resolver": ResolverSettings(solver="lm", order="2", returns="strongest")}
    paper = outcome(trials(1e3, condition=worst, runs=1000, wrapped=True, **ways))
    ours = outcome(trials(1e3, condition=worst, runs=1000, **ways))
    assert paper.second.std_ns == pytest.approx(12.8, abs=0.7)
    assert ours.second.std_ns < 9.0
    assert paper.direct == ours.direct
    late = Condition(asr=1.0, mpi_ratio=0.3, second_ns=25.0)
    assert abs(outcome(trials(condition=late, wrapped=True)).second.bias_ns) < 0.05


def test_the_papers_search_takes_some_tens_of_steps_from_a_start() -> None:
    search = ResolverSettings(solver="lm", order="2")
    found = outcome(trials(runs=200, resolver=search))
    assert 5 < found.steps_per_start < 40
    assert math.isnan(outcome(trials(runs=200)).steps_per_start)


def test_the_starts_of_a_run_follow_from_its_number() -> None:
    wanted = trials(runs=60, resolver=ResolverSettings(solver="lm", order="2", starts=1), seed=4)
    voltages = block_voltages(wanted, range(60))
    whole, part = resolved(wanted, voltages), resolved(wanted, voltages[20:], first=20)
    np.testing.assert_array_equal(whole.times_ns[:, 20:], part.times_ns)
    np.testing.assert_array_equal(whole.steps[:, 20:], part.steps)


def test_amplitudes_that_no_light_has_count_as_no_answer() -> None:
    """The offset is .5 V, but the amplitude of the modulation is only .2746 V."""
    model = PixelModel(averaging=Averaging(integration_length=1e5), offsets_v=(0.5, 0.0))
    found = outcome(trials(model=model, runs=100))
    assert found.impossible == 1.0
    assert math.isnan(found.direct.std_ns)
    assert found.direct.within_1ns == 0.0
    assert outcome(trials(runs=100)).impossible == 0.0


def test_a_single_run_with_an_answer_counts() -> None:
    wanted = trials(runs=50)
    runs = Recordings.joined([recordings(wanted, some) for some in wanted.blocks])
    times = np.full_like(runs.times_ns, np.nan)
    times[:, 7] = runs.times_ns[:, 7]
    found = summary(wanted, replace(runs, times_ns=times))
    assert (found.direct.within_1ns, found.second.within_1ns) == (0.02, 0.02)
    assert math.isnan(found.direct.std_ns)


def test_the_bound_of_an_average_that_has_not_settled_is_that_of_its_few_photons() -> None:
    """After N = n_av/2 photons, Eq. (1) gives Σw = 1 − e^(−1/2) and Σw² = (1 − e^(−1))/(2 n_av).

    So the noise over the mean is that of a fifth to a quarter of n_av, and the standard deviation is twice that of n_av.
    """
    settled, model = trials(4000.0), PixelModel(averaging=Averaging(integration_length=4000.0), cycles=400)
    runs = 300
    few = outcome(replace(settled, model=model, photon_by_photon=True, runs=runs, resolver=ResolverSettings(order="2")))
    more = math.sqrt(1 - math.exp(-1)) / (1 - math.exp(-0.5))
    assert few.direct.bound_ns == pytest.approx(more * outcome(settled).direct.bound_ns, rel=1e-3)
    assert few.phase_std_rad == pytest.approx(few.phase_model_std_rad, rel=4 / math.sqrt(2 * runs))
    # --cycles has no effect on voltages that are drawn from their settled distribution
    assert outcome(replace(settled, model=model)).direct.bound_ns == outcome(settled).direct.bound_ns


@pytest.mark.parametrize(
    ("second_ns", "bias_rad"), [(25.0, math.pi), (24.9, math.pi - 0.0236), (25.1, 0.0236 - math.pi)]
)
def test_the_phase_of_mpi_that_outshines_the_direct_light_does_not_split_at_half_a_turn(
    second_ns: float, bias_rad: float
) -> None:
    """MPI of three times the direct light, 20 ns later: the first phasor is half a turn off."""
    found = outcome(trials(condition=Condition(asr=1.0, mpi_ratio=3.0, second_ns=second_ns)))
    assert found.phase_std_rad == pytest.approx(found.phase_model_std_rad, rel=4 / math.sqrt(800))
    assert abs(np.angle(np.exp(1j * (found.phase_bias_rad - bias_rad)))) < 1e-3
    assert abs(found.phase_bias_rad) <= math.pi
