"""Means and covariances are those of a quadrature, of the photon-by-photon pixel, and of published closed forms."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import Modulation, Waveform
from cadtof_cli.errors import SettingsError
from cadtof_cli.simulation.pixel.averaging import Averaging, averaging_gain
from cadtof_cli.simulation.pixel.mix import Condition, PhotonMix
from cadtof_cli.simulation.pixel.pixel import PixelModel, record_pixel
from cadtof_cli.simulation.pixel.statistics import (
    VoltageStatistics,
    draw_voltages,
    sample_mean,
    time_bounds_ns,
    voltage_statistics,
)

RUNS = 2500


def paper_mix(asr: float, *, mpi_ratio: float = 0.3, second_ns: float = 16.0, fwhm_ns: float = 1.7) -> PhotonMix:
    return Condition(asr=asr, mpi_ratio=mpi_ratio, second_ns=second_ns, fwhm_ns=fwhm_ns).mix(40.0)


def test_moments_are_the_fourier_integrals_of_the_arrival_density() -> None:
    mix = paper_mix(2.0).jittered(0.4)
    time = np.linspace(-20.0, 60.0, 400_001)
    sigma = math.hypot(1.7 / 2.354820045, 0.4)
    density = np.zeros_like(time)
    for delay, share in ((5.0, 1 / 3.3), (16.0, 0.3 / 3.3)):
        density += share * np.exp(-(((time - delay) / sigma) ** 2) / 2) / (sigma * math.sqrt(2 * math.pi))
    moments = mix.moments(6)
    for k in range(1, 7):
        integral = np.trapezoid(density * np.exp(2j * np.pi * k * time / 40.0), time)
        assert moments[k] == pytest.approx(integral, abs=1e-9)


@pytest.mark.parametrize("asr", [0.2, 8.0])
@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_photon_by_photon_has_the_exact_mean_and_covariance(waveform: Waveform, asr: float) -> None:
    modulation = Modulation(waveform=waveform)
    model, mix = PixelModel(modulation=modulation, averaging=Averaging(integration_length=60.0)), paper_mix(asr)
    streams = np.random.default_rng(20).spawn(2 * RUNS)
    runs = np.stack([record_pixel(model, mix, streams[2 * i : 2 * i + 2]) for i in range(RUNS)])
    exact = voltage_statistics(mix, modulation, variance_gain=averaging_gain(60.0))
    for row in range(2):
        first, both, second = exact.covariances_v2[row]
        observed = np.cov(runs[:, row].T)
        error = np.sqrt(np.array([2 * first**2, first * second + both**2, 2 * second**2]) / (RUNS - 1))
        difference = np.array([observed[0, 0], observed[0, 1], observed[1, 1]]) - exact.covariances_v2[row]
        assert np.abs(difference / error).max() < 4.0
        mean_error = np.sqrt(np.array([first, second]) / RUNS)
        assert np.abs((runs[:, row].mean(axis=0) - exact.means_v[row]) / mean_error).max() < 4.0


def recorded(mix: PhotonMix, variance_gain: float = 1e-5, *, sample_noise_v: float = 0.0) -> VoltageStatistics:
    return voltage_statistics(mix, Modulation(), variance_gain=variance_gain, sample_noise_v=sample_noise_v)


def bounds_ns(mix: PhotonMix, variance_gain: float = 1e-5, *, sample_noise_v: float = 0.0) -> Float:
    return time_bounds_ns(mix, Modulation(), recorded(mix, variance_gain, sample_noise_v=sample_noise_v))


def test_drawn_voltages_have_the_covariance_they_are_drawn_from() -> None:
    exact = voltage_statistics(paper_mix(0.5), Modulation(), variance_gain=0.01)
    drawn = draw_voltages(exact, np.random.default_rng(3), draws=40_000)
    for row in range(2):
        first, both, second = exact.covariances_v2[row]
        observed = np.cov(drawn[:, row].T)
        np.testing.assert_allclose(observed, [[first, both], [both, second]], atol=0.03 * max(first, second))


def test_voltages_without_variance_are_drawn_as_their_mean() -> None:
    still = VoltageStatistics(np.full((1, 2, 3), 0.1), np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(draw_voltages(still, np.random.default_rng(0), draws=4), np.full((4, 1, 2, 3), 0.1))


def test_confidence_of_one_path_follows_the_analytical_model() -> None:
    first = math.exp(-((2 * math.pi * 1.7 / 2.354820045 / 40) ** 2) / 2)
    for asr in (0.0, 1.0, 6.0):
        confidence = float(recorded(paper_mix(asr, mpi_ratio=0.0)).confidence_v)
        assert confidence == pytest.approx(0.2746 * first / (1 + asr), rel=1e-12)


@pytest.mark.parametrize("direct_ns", [0.0, 3.7, 10.0, 28.0])
def test_confidence_is_the_length_of_the_mean_whatever_its_phase(direct_ns: float) -> None:
    """Both channels count: of light at 10 ns SC1 shows almost nothing, and of light at 0 ns SC2."""
    light = replace(paper_mix(2.0), delays_ns=np.array([direct_ns, direct_ns + 6.0]))
    means = recorded(light).means_v[0]
    length = math.sqrt(means[0] ** 2 + means[1] ** 2)
    assert float(recorded(light).confidence_v) == pytest.approx(length, rel=1e-12)
    shift = replace(light, delays_ns=light.delays_ns + 5.0)
    assert float(recorded(shift).confidence_v) == pytest.approx(length, rel=1e-12)


def test_phase_precision_of_a_short_pulse_is_the_published_root() -> None:
    for asr in (0.5, 2.0, 6.0):
        expected = math.sqrt(asr * (1 + asr) / (2 * (2 * 4000 - 1)))
        short = paper_mix(asr, mpi_ratio=0.0, fwhm_ns=0.0)
        found = recorded(short, averaging_gain(4000)).phase_precision_rad
        assert float(found) == pytest.approx(expected, rel=1e-9)


def test_phase_precision_is_right_for_one_path_and_for_a_mix() -> None:
    """One path has the variance (1 − r2/(1 + ASR))/2 across its phasor r1/(1 + ASR). Two paths: compare with draws."""
    r1, r2 = (math.exp(-((k * 2 * math.pi * 1.7 / 2.354820045 / 40) ** 2) / 2) for k in (1, 2))
    alone = recorded(paper_mix(2.0, mpi_ratio=0.0), averaging_gain(4000)).phase_precision_rad
    single = math.sqrt((1 - r2 / 3) / 2 / (2 * 4000 - 1)) * 3 / r1
    assert float(alone) == pytest.approx(single, rel=1e-9)
    mixed = recorded(paper_mix(0.5, mpi_ratio=0.8), averaging_gain(4000))
    drawn = draw_voltages(mixed, np.random.default_rng(5), draws=20_000)
    phase = np.angle(drawn[:, 0, 0] + 1j * drawn[:, 0, 1])
    assert phase.std() == pytest.approx(float(mixed.phase_precision_rad), rel=0.02)


def test_bound_is_that_of_table_1() -> None:
    """The bounds .049/.165, .032/.107, .157/.510 ns were derived independently, from the Fisher information."""
    for second, expected in ((16.0, (0.049, 0.165)), (25.0, (0.032, 0.107)), (11.0, (0.157, 0.510))):
        bounds = bounds_ns(paper_mix(5.0, second_ns=second), averaging_gain(1e5))
        np.testing.assert_allclose(bounds, expected, atol=6e-4)


def test_bound_contains_the_noise_of_the_samples() -> None:
    """If that noise is 100 times the photons', the covariance is its own: the bound of white noise, of docs/physics.md."""
    mix, sample_noise_v = replace(paper_mix(5.0), fwhm_ns=0.0), 100.0 * 0.2746
    bounds = bounds_ns(mix, 1e-9, sample_noise_v=sample_noise_v)
    c, a = math.cos(2 * math.pi * 11.0 / 40.0), 0.2746 / 6.3
    shape = math.sqrt(13 + 20 * c + 12 * c * c) / (2 * (1 - c) * (2 + c)) * 40.0 / (2 * math.pi)
    sigma_v = sample_noise_v * math.sqrt(1e-9)
    np.testing.assert_allclose(bounds, [sigma_v / a * shape, sigma_v / (0.3 * a) * shape], rtol=1e-3)


def test_bound_is_infinite_where_paths_coincide_and_absent_without_photons() -> None:
    together = replace(paper_mix(5.0), delays_ns=np.array([5.0, 5.0]))
    same = bounds_ns(together)
    assert np.isinf(same).all()
    alone = bounds_ns(paper_mix(5.0, mpi_ratio=0.0))
    assert np.isfinite(alone[0])
    assert np.isnan(alone[1])


def test_bound_of_weak_mpi_is_finite_and_grows_as_the_mpi_becomes_weaker() -> None:
    """With an MPI ratio of 1e-6, both bounds were infinite, as if the paths coincided."""
    weak, weaker = (bounds_ns(paper_mix(1.0, mpi_ratio=ratio)) for ratio in (1e-4, 1e-6))
    np.testing.assert_allclose(weaker, weak * [1.0, 100.0], rtol=1e-3)
    # its information rounds to 0
    assert np.isinf(bounds_ns(paper_mix(1.0, mpi_ratio=1e-300))).all()


def test_bound_without_any_noise_is_nothing() -> None:
    """Without ambient light and with a pulse of no length, all photons of one path give the same voltages."""
    mix = replace(paper_mix(0.0, mpi_ratio=0.0), fwhm_ns=0.0)
    assert 0.0 < bounds_ns(mix)[0] < 1e-4


def test_bound_of_voltages_with_noise_in_one_direction_is_that_with_a_little_ambient_light() -> None:
    """Two paths, without ambient light and with a pulse of no length: the voltages vary along one line only."""
    without, little = (bounds_ns(replace(paper_mix(asr), fwhm_ns=0.0)) for asr in (0.0, 1e-5))
    np.testing.assert_allclose(without, little, rtol=0.01)


def test_taking_triangles_for_sines_costs_up_to_68_mm() -> None:
    delays = np.linspace(0.0, 40.0, 801)
    mix = PhotonMix(
        delays_ns=delays[None], photons=np.ones((1, 801)), ambient=np.zeros(801), period_ns=40.0, fwhm_ns=0.1
    )
    phasors = sample_mean(mix.moments(1500), harmonic=1, waveform="triangle")
    error_rad = np.angle(phasors * np.exp(-2j * np.pi * delays / 40.0))
    assert np.abs(error_rad).max() * 0.299792458 * 40.0 / (4 * np.pi) == pytest.approx(0.068, abs=5e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"photons": np.array([1.0, -0.1])}, "photons"),
        ({"ambient": np.array(-1.0)}, "ambient"),
        ({"fwhm_ns": -1.0}, "pulse width: found -1 ns, expected 0 to 1e9 ns"),
        ({"period_ns": 0.0}, "period: found 0 ns"),
        ({"photons": np.zeros(2), "ambient": np.array(0.0)}, "a pixel without any, expected some light"),
    ],
)
def test_impossible_light_is_refused(change: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {
        "delays_ns": np.array([5.0, 16.0]),
        "photons": np.array([1.0, 0.3]),
        "ambient": np.array(1.0),
        "period_ns": 40.0,
        "fwhm_ns": 1.7,
    }
    with pytest.raises(SettingsError, match=message):
        PhotonMix(**(settings | change))


@pytest.mark.parametrize(("ratio", "refused"), [(0.0, False), (0.5, False), (-0.1, True), (np.nan, True)])
def test_a_further_path_may_have_a_ratio_of_zero_but_not_below(ratio: float, refused: bool) -> None:
    if refused:
        with pytest.raises(SettingsError, match="path: found a ratio of"):
            Condition(asr=5.0, mpi_ratio=0.1, further=((ratio, 20.0),))
    else:
        assert Condition(asr=5.0, mpi_ratio=0.1, further=((ratio, 20.0),)).ratios == (1.0, 0.1, ratio)


def test_the_average_scales_means_variances_and_sample_noise() -> None:
    """Means scale with Σ w, variances with Σ w². The samples' own noise is independent in SC1 and SC2."""
    mix = PhotonMix(
        delays_ns=np.array([5.0]), photons=np.array([1.0]), ambient=np.array(2.0), period_ns=40.0, fwhm_ns=1.7
    )
    settled = voltage_statistics(mix, Modulation(), variance_gain=1.0)
    found = voltage_statistics(mix, Modulation(), variance_gain=0.01, mean_gain=0.8, sample_noise_v=0.05)
    np.testing.assert_allclose(found.means_v, 0.8 * settled.means_v)
    more = found.covariances_v2 / 0.01 - settled.covariances_v2
    np.testing.assert_allclose(more, [[0.05**2, 0.0, 0.05**2]] * 2, atol=1e-12)


def test_voltages_of_photons_that_come_at_the_same_moment_do_not_scatter() -> None:
    """All photons give the same sample, so voltages do not scatter, except by the rounding of their covariances."""
    for moment in np.linspace(0.0, 39.0, 200):
        light = Condition(asr=0.0, direct_ns=float(moment), second_ns=39.9, mpi_ratio=0.0, fwhm_ns=0.0).mix(40.0)
        exact = voltage_statistics(light, Modulation(), variance_gain=1.0)
        drawn = draw_voltages(exact, np.random.default_rng(1), draws=20)
        np.testing.assert_allclose(drawn, np.broadcast_to(exact.means_v, drawn.shape), atol=1e-7)
