"""The pixel photon by photon: Eq. (1) written out, arrivals, dead time, and the paper's Fig. 2."""

import math
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Modulation, Waveform
from cadtof_cli.errors import SettingsError
from cadtof_cli.figures.canvas import Figure
from cadtof_cli.figures.pixel_evolution import plot_histogram
from cadtof_cli.simulation.pixel.arrivals import detected, draw_detections, draw_phases
from cadtof_cli.simulation.pixel.averaging import Averaging, Capacitors, Stages
from cadtof_cli.simulation.pixel.evolution import evolution, trace_pixel
from cadtof_cli.simulation.pixel.mix import Condition, PhotonMix
from cadtof_cli.simulation.pixel.pixel import (
    CHUNK,
    PixelModel,
    chunks,
    noise_length,
    pixel_weights,
    record_pixel,
    seen_length,
    weight_sums,
)

AMPLITUDE_V = 0.2746


def mix(asr: float = 1.0, mpi_ratio: float = 0.3, *, direct_ns: float = 10.0, second_ns: float = 17.0) -> PhotonMix:
    return Condition(asr=asr, mpi_ratio=mpi_ratio, direct_ns=direct_ns, second_ns=second_ns).mix(40.0)


def model(integration_length: float = 200.0, **settings: Any) -> PixelModel:
    return PixelModel(averaging=Averaging(integration_length=integration_length), **settings)


def final(pixel: PixelModel, light: PhotonMix, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return record_pixel(pixel, light, np.random.default_rng(seed).spawn(2))


def test_trace_is_equation_1() -> None:
    pixel = model(50.0, cycles=60)
    times_ns, voltages_v = trace_pixel(pixel, mix(), np.random.default_rng(1), harmonic=1)
    voltage, turn = 0.0, 2 * np.pi * times_ns / 40.0
    for i in range(300):
        voltage = AMPLITUDE_V * math.cos(turn[i]) / 50.0 + (1 - 1 / 50.0) * voltage
        assert voltages_v[0, i] == pytest.approx(voltage, abs=1e-9)


@pytest.mark.usefixtures("no_memory_for_scipy")
def test_too_little_memory_for_a_trace_is_told_and_not_waited_for() -> None:
    with pytest.raises(MemoryError):
        trace_pixel(model(50.0, cycles=60), mix(), np.random.default_rng(1), harmonic=1)


@pytest.mark.parametrize("waveform", ["sine", "triangle"])
def test_final_voltages_are_the_end_of_the_trace(waveform: Waveform) -> None:
    pixel = model(8000.0, modulation=Modulation(waveform=waveform))
    ends = final(pixel, mix(), 5)
    for row, generator in enumerate(np.random.default_rng(5).spawn(2)):
        _, voltages_v = trace_pixel(pixel, mix(), generator, harmonic=row + 1)
        np.testing.assert_allclose(voltages_v[:, -1], ends[row], atol=3e-6)


def test_forgotten_photons_are_not_drawn() -> None:
    assert pixel_weights(model(100.0, cycles=10_000)).shape == (2, 4000)
    assert pixel_weights(model(100.0)).shape == (2, 1250)


def test_arrivals_come_from_laser_mpi_and_ambient_in_their_shares() -> None:
    phases = draw_phases(mix(asr=0.7, mpi_ratio=0.3), np.random.default_rng(2), count=400_000)
    times = np.mod(phases / (2 * np.pi) * 40.0, 40.0)
    sigma, total = 1.7 / 2.354820045, 2.0
    for centre, photons in ((10.0, 1.0), (17.0, 0.3)):
        near = np.abs(times - centre) < 3 * sigma
        expected = (0.9973002 * photons + 0.7 * 6 * sigma / 40.0) / total
        assert near.mean() == pytest.approx(expected, abs=4 * math.sqrt(expected / 400_000))
    empty = (times > 21.0) & (times < 39.0)
    assert empty.mean() == pytest.approx(0.7 / total * 18.0 / 40.0, abs=0.003)
    laser = times[np.abs(times - 10.0) < 2.0]
    assert laser.mean() == pytest.approx(10.0, abs=0.01)


def test_arrivals_without_ambient_light_and_over_many_paths() -> None:
    many = PhotonMix(
        delays_ns=np.array([4.0, 12.0, 20.0, 28.0]),
        photons=np.array([4.0, 3.0, 2.0, 1.0]),
        ambient=np.array(0.0),
        period_ns=40.0,
        fwhm_ns=0.5,
    )
    times = draw_phases(many, np.random.default_rng(4), count=100_000) / (2 * np.pi) * 40.0
    counts = [float((np.abs(times - centre) < 2.0).mean()) for centre in (4.0, 12.0, 20.0, 28.0)]
    np.testing.assert_allclose(counts, [0.4, 0.3, 0.2, 0.1], atol=0.006)


@pytest.mark.parametrize("asr", [0.0, 1.0])
def test_arrivals_over_a_single_path(asr: float) -> None:
    alone = PhotonMix(
        delays_ns=np.array([12.0]), photons=np.array([1.0]), ambient=np.array(asr), period_ns=40.0, fwhm_ns=1.0
    )
    for harmonic in (1, 2):
        phases = draw_phases(alone, np.random.default_rng(4), count=40_000, harmonic=harmonic)
        times = phases / (2 * np.pi * harmonic) * 40.0
        near = np.abs(times - 12.0) < 2.0
        expected = 1 / (1 + asr) + asr / (1 + asr) * 4.0 / 40.0
        assert near.mean() == pytest.approx(expected, abs=0.01)
        assert times[near].mean() == pytest.approx(12.0, abs=0.02)


@pytest.mark.parametrize("dead_time_ns", [0.0, 0.5, 3.0, 200.0])
def test_dead_time_drops_what_a_photon_by_photon_count_drops(dead_time_ns: float) -> None:
    times = np.sort(np.random.default_rng(8).random(2000) * 2000.0)
    kept, last = [], -math.inf
    for index, time in enumerate(times):
        if time - last >= dead_time_ns:
            kept.append(index)
            last = time
    np.testing.assert_array_equal(detected(times, dead_time_ns=dead_time_ns), kept)


def test_dead_time_favours_the_earlier_path() -> None:
    light = mix(asr=0.0, mpi_ratio=1.0)
    seen = draw_detections(
        light,
        np.random.default_rng(9),
        cycles=20_000,
        photons_per_cycle=2,
        dead_time_ns=20.0,
        jitter_ns=0.1,
    )
    early = (np.abs(np.mod(seen, 40.0) - 10.0) < 3.0).sum()
    late = (np.abs(np.mod(seen, 40.0) - 17.0) < 3.0).sum()
    # Two photons per cycle fall on the paths at random: 3 of 4 cycles have an early photon, 1 of 4 has only late ones.
    assert early == pytest.approx(15_000, rel=0.03)
    assert late == pytest.approx(5_000, rel=0.05)


def test_jitter_of_a_dead_spad_comes_on_top_of_the_pulse() -> None:
    """Detections of a path scatter by √(pulse² + jitter²), whichever photons the dead time drops."""
    light = Condition(asr=0.0, mpi_ratio=0.0, direct_ns=10.0, second_ns=17.0).mix(40.0)
    seen = draw_detections(
        light, np.random.default_rng(9), cycles=20_000, photons_per_cycle=1, dead_time_ns=5.0, jitter_ns=1.5
    )
    times = np.mod(seen, 40.0)
    assert len(times) == 20_000
    assert times.std() == pytest.approx(math.hypot(1.7 / 2.354820045, 1.5), rel=0.03)
    assert times.mean() == pytest.approx(10.0, abs=0.05)
    exact = draw_detections(
        light, np.random.default_rng(9), cycles=20_000, photons_per_cycle=1, dead_time_ns=5.0, jitter_ns=0.0
    )
    assert np.mod(exact, 40.0).std() == pytest.approx(1.7 / 2.354820045, rel=0.03)


def test_jitter_of_a_trace_blurs_its_arrivals() -> None:
    light = Condition(asr=0.0, mpi_ratio=0.0, direct_ns=10.0, second_ns=17.0, fwhm_ns=0.5).mix(40.0)
    times_ns, _ = trace_pixel(model(100.0, cycles=4000, jitter_ns=1.5), light, np.random.default_rng(1), harmonic=1)
    assert times_ns.std() == pytest.approx(math.hypot(0.5 / 2.354820045, 1.5), rel=0.03)


def test_negligible_dead_time_changes_nothing_but_noise() -> None:
    light = mix()
    ends = np.mean([final(model(2000.0, dead_time_ns=0.01), light, seed) for seed in range(40)], axis=0)
    without = np.mean([final(model(2000.0), light, seed) for seed in range(100, 140)], axis=0)
    np.testing.assert_allclose(ends, without, atol=5 * AMPLITUDE_V / math.sqrt(2 * 2 * 2000 * 40) * math.sqrt(2))


def test_gain_and_offset_are_those_of_the_channels() -> None:
    plain, light = model(), mix()
    changed = model(gain_mismatch=0.1, offsets_v=(0.01, -0.02))
    first, second = final(plain, light, 3), final(changed, light, 3)
    np.testing.assert_allclose(second[:, 0], first[:, 0] + 0.01, atol=1e-12)
    np.testing.assert_allclose(second[:, 1], 1.1 * first[:, 1] - 0.02, atol=1e-12)


def test_sample_noise_is_averaged_like_the_samples() -> None:
    light, noise = mix(), 0.05
    differences = [
        final(model(100.0, sample_noise_v=noise), light, seed) - final(model(100.0), light, seed) for seed in range(400)
    ]
    assert np.std(differences) == pytest.approx(noise / math.sqrt(199.0), rel=0.08)


def test_sample_noise_of_a_trace_is_averaged_like_the_samples() -> None:
    noisy, clean = (
        trace_pixel(model(20.0, cycles=4000, sample_noise_v=noise), mix(), np.random.default_rng(1), harmonic=1)[1]
        for noise in (0.05, 0.0)
    )
    assert np.std((noisy - clean)[:, 500:]) == pytest.approx(0.05 / math.sqrt(39.0), rel=0.05)


def test_sums_of_weights_are_those_of_equation_1_or_of_the_cascade() -> None:
    assert weight_sums(model(200.0)) == pytest.approx((1.0, 1.0 / 399.0))
    capacitors = Capacitors(values_ff=(1.0, 39.0, 1.0, 39.0) + (20.0,) * 8)
    stages = Stages(drive="switched", f1_hz=1e7, f2_hz=5e6)
    averaging = Averaging(integration_length=80.0, capacitors=capacitors, stages=stages)
    cascade = PixelModel(averaging=averaging)
    weights = pixel_weights(cascade)[0].astype(np.float64)
    assert weight_sums(cascade) == pytest.approx((weights.sum(), (weights**2).sum()))


@pytest.mark.parametrize(("share", "times"), [(0.0, 1.0), (1.0, 2.0), (0.5, 1.25)])
def test_frames_show_a_length_that_sample_noise_makes_shorter(share: float, times: float) -> None:
    """Ambient light alone has the variance A²/2 over 2·n − 1: as much more as sample noise adds is a shorter length."""
    noise_v = share * AMPLITUDE_V / math.sqrt(2.0)
    assert 2.0 * seen_length(model(200.0, sample_noise_v=noise_v)) - 1.0 == pytest.approx(399.0 / times)


def test_jitter_shrinks_the_confidence_as_a_gaussian_does() -> None:
    light = mix(asr=0.0, mpi_ratio=0.0)
    blurred = np.mean([final(model(1000.0, jitter_ns=2.0), light, seed) for seed in range(30)], axis=0)
    sharp = np.mean([final(model(1000.0), light, seed) for seed in range(30)], axis=0)
    ratio = np.hypot(*blurred[0]) / np.hypot(*sharp[0])
    assert ratio == pytest.approx(math.exp(-((2 * np.pi * 2.0 / 40.0) ** 2) / 2), rel=0.01)


def test_fig_2_phase_error_is_13_degrees() -> None:
    """For paths at 90° and 153°, ratio 0.3, ASR 0.8 and n_av 4000, the phase is 13.24° too large; that is 1.471 ns."""
    light, pixel = mix(asr=0.8, second_ns=17.0), model(4000.0, cycles=10_000)
    phasors = np.array([complex(*final(pixel, light, seed)[0]) for seed in range(60)])
    errors = np.degrees(np.angle(phasors * np.exp(-1j * np.pi / 2)))
    assert errors.mean() == pytest.approx(13.24, abs=0.3)
    assert errors.mean() / 360.0 * 40.0 == pytest.approx(1.471, abs=0.033)


def test_evolution_holds_all_photons_and_settles_on_the_phase() -> None:
    shown = evolution(model(4000.0, cycles=10_000), mix(asr=0.8), np.random.default_rng(0))
    assert shown.counts.sum() == 50_000
    assert shown.photons[-1] == 50_000
    assert shown.settled_phase_deg == pytest.approx(103.24, abs=1.5)
    assert shown.bin_ns[np.argmax(shown.counts)] == pytest.approx(10.0, abs=0.5)


def test_evolution_is_the_trace_in_bins_and_thinned() -> None:
    """The histogram has 128 bins per period. Of 5000 photons, 1000 are shown, the first and the last among them."""
    pixel = model(200.0, cycles=1000)
    shown = evolution(pixel, mix(), np.random.default_rng(3))
    times_ns, voltages_v = trace_pixel(pixel, mix(), np.random.default_rng(3), harmonic=1)
    width = 40.0 / 128
    np.testing.assert_allclose(shown.bin_ns, width * (np.arange(128) + 0.5))
    for index in (0, 31, 33, 127):
        inside = (times_ns >= width * index) & (times_ns < width * (index + 1))
        assert shown.counts[index] == inside.sum()
    assert len(shown.photons) == 1000
    assert (shown.photons[0], shown.photons[-1]) == (1.0, 5000.0)
    rows = shown.photons.astype(int) - 1
    np.testing.assert_array_equal(shown.voltages_v, voltages_v[:, rows])
    phase = np.degrees(np.arctan2(voltages_v[1], voltages_v[0]))[rows]
    np.testing.assert_allclose(shown.phase_deg, np.where(phase < 0, phase + 360.0, phase), atol=1e-9)
    later = voltages_v[:, rows[500:]].mean(axis=1)
    assert shown.settled_phase_deg == pytest.approx(math.degrees(math.atan2(later[1], later[0])))
    late = evolution(pixel, mix(direct_ns=30.0, second_ns=35.0), np.random.default_rng(3))
    assert 260.0 < late.settled_phase_deg < 300.0


def test_the_histogram_shows_the_waveform_and_all_paths() -> None:
    """It showed a sine with triangle waves, and only the first path of the MPI."""
    pixel = model(50.0, cycles=60, modulation=Modulation(waveform="triangle"))
    condition = Condition(asr=1.0, mpi_ratio=0.0, further=((0.3, 25.0), (0.2, 30.0)))
    shown = evolution(pixel, condition.mix(40.0), np.random.default_rng(3))
    axes = Figure().subplots()
    plot_histogram(axes, shown, condition)
    assert [line.get_label() for line in axes.lines] == ["direct, 5 ns", "MPI, 25 ns", "MPI, 30 ns"]
    [wave] = [other for other in axes.figure.axes if other is not axes]
    # a triangle falls from 1 at 0 ns to −1 at 20 ns
    drawn = np.asarray(wave.lines[0].get_ydata(), np.float64)
    np.testing.assert_allclose(drawn[:64], 1.0 - shown.bin_ns[:64] / 10.0, atol=1e-9)


def test_arrivals_of_a_trace_lie_in_the_period_of_the_fundamental() -> None:
    times_ns, _ = trace_pixel(model(50.0, cycles=60), mix(), np.random.default_rng(1), harmonic=2)
    assert times_ns.size == 300
    assert (times_ns >= 0.0).all()
    assert (times_ns < 40.0).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dead_time_ns": 40.0}, "dead time: found 40 ns, expected 0 to less than one cycle of 40 ns"),
        ({"dead_time_ns": -1.0}, "dead time: found -1 ns"),
        ({"photons_per_cycle": 0}, "photons per cycle: found 0, expected 1 or more"),
        ({"cycles": 0}, "cycles: found 0"),
        ({"jitter_ns": math.nan}, "jitter: found nan ns"),
        ({"sample_noise_v": -0.1}, "sample noise: found -0.1 V"),
        ({"gain_mismatch": -2.0}, "gain mismatch: found -2.0"),
        ({"offsets_v": (math.inf, 0.0)}, "offsets: found"),
    ],
)
def test_impossible_pixels_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        model(100.0, **settings)


def test_switched_stages_have_no_trace_and_no_dead_time() -> None:
    capacitors = Capacitors(values_ff=(1.0, 30.0, 1.0, 30.0, *[10.0] * 8))
    switched = Averaging(integration_length=71.0, capacitors=capacitors, stages=Stages(drive="switched"))
    with pytest.raises(SettingsError, match="switched stages, expected --stages dc"):
        PixelModel(averaging=switched, dead_time_ns=1.0)
    with pytest.raises(SettingsError, match="evolution of voltages"):
        trace_pixel(PixelModel(averaging=switched), mix(), np.random.default_rng(0), harmonic=1)


def test_a_trace_with_a_dead_time_is_that_of_the_photons_that_are_seen() -> None:
    """One path, two photons per cycle, a SPAD blind for half a cycle: every second photon is lost, the phase stays."""
    light = Condition(asr=0.0, mpi_ratio=0.0, direct_ns=10.0, second_ns=17.0).mix(40.0)
    pixel = model(50.0, cycles=400, photons_per_cycle=2, dead_time_ns=20.0)
    times_ns, voltages_v = trace_pixel(pixel, light, np.random.default_rng(1), harmonic=1)
    assert times_ns.size == 400
    assert np.abs(times_ns - 10.0).max() < 4.0
    assert voltages_v.shape == (2, 400)
    assert voltages_v[1, -1] == pytest.approx(AMPLITUDE_V, rel=0.05)


@pytest.mark.parametrize("cycles", [300, 1000, 3000])
def test_an_average_that_does_not_settle_has_the_noise_of_a_shorter_length(cycles: int) -> None:
    """The weights are powers of q = 1 − 1/n_av. Over their sum squared, the sum of the squares of the last m is
    (1 − q)/(1 + q)·(1 + q^m)/(1 − q^m), which is 1/(2·n_av − 1) for all photons."""
    model = PixelModel(averaging=Averaging(integration_length=1000.0), cycles=cycles)
    left = (1.0 - 1.0 / 1000.0) ** model.photons
    expected = 0.5 * (1.0 + 1999.0 * (1.0 - left) / (1.0 + left))
    assert noise_length(model, counted=True) == pytest.approx(expected, rel=1e-3)
    assert noise_length(model) == 1000.0


def test_photons_are_drawn_in_chunks_none_of_which_is_empty() -> None:
    for count in (1, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK):
        assert sum(chunks(count)) == count
        assert 0 < min(chunks(count)) <= max(chunks(count)) <= CHUNK
