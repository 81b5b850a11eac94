"""The noise of phasors: known from the integration length and the waveform, or estimated from a frame."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Voltage, Waveform
from cadtof_cli.phasors.noise import (
    MAD_PER_SIGMA,
    _recorded,
    ambient_noise_v,
    estimated_integration_length,
    is_without_noise,
    median_of_steps,
    noise_model,
    with_repeated_rounding,
)
from tests.support.forward import AMPLITUDE_V, Light, phasors_of, step_frame

AMBIENT = np.mean([abs(Light(0.0, direct_ns=0.0).moment(h)) ** -2.0 for h in (1, 2)])
"""Noise of harmonics 1 and 2 by ambient light alone, times 2·n_av − 1: both channels together, mean of the harmonics."""


@pytest.mark.parametrize("asr", [0.2, 1.0, 5.0])
def test_the_variances_of_one_path_are_those_of_the_pixel(asr: float) -> None:
    light, n_av = Light(asr, direct_ns=4.0), 1e4
    model = noise_model(CaptureMetadata(), integration_length=n_av, quantised=False)
    for h, harmonic in zip((1, 2), model.each, strict=True):
        r = light.moment(h) * (1 + asr)
        turn = np.exp(-2j * np.pi * h * 4.0 / 40.0)
        basis = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        covariance = basis @ light.covariance(h, n_av) @ basis.T / abs(r) ** 2
        along, across = harmonic.one_path_variances(np.array([1 / (1 + asr)]))
        np.testing.assert_allclose([along[0], across[0]], np.diag(covariance), rtol=1e-9)
        assert abs(covariance[0, 1]) < 1e-12 * covariance[0, 0]


def test_ambient_light_alone_gives_one_over_two_root_n_av() -> None:
    model = noise_model(CaptureMetadata(), integration_length=1e6, quantised=False)
    for harmonic in model.each:
        assert math.sqrt(harmonic.dark_variance) * harmonic.pulse == pytest.approx(1 / (2 * math.sqrt(1e6)), rel=1e-6)


@pytest.mark.parametrize(
    ("waveform", "wave"),
    [
        ("sine", np.sin(2.0 * np.pi * np.arange(1000) / 1000)),
        ("triangle", 4.0 * np.abs(np.arange(1000) / 1000 - 0.5) - 1.0),
    ],
)
def test_the_noise_of_a_channel_in_ambient_light_is_that_of_its_waveform(waveform: Waveform, wave: np.ndarray) -> None:
    """By Eq. (1) its variance is that of one sample at a random time, divided by 2 n_av − 1."""
    metadata = CaptureMetadata(modulation=Modulation(waveform=waveform, amplitude_v=0.3))
    found = ambient_noise_v(metadata, integration_length=50.0)
    assert found == pytest.approx(0.3 * wave.std() / math.sqrt(99.0), rel=1e-5)


def test_counting_adds_a_twelfth_of_a_count_squared() -> None:
    metadata = CaptureMetadata(voltage=Voltage(volts_per_count=0.01), pixel=Pixel(integration_length=1e9))
    coarse = noise_model(metadata, integration_length=1e9, quantised=True).each[0]
    expected = (0.01 / 0.2746) ** 2 / 12
    assert coarse.dark_variance * coarse.pulse**2 == pytest.approx(expected, rel=1e-3)
    assert noise_model(metadata, integration_length=1e9, quantised=False).each[0].floor == 0.0


@pytest.mark.parametrize("direct_ns", [0.0, 4.0, 13.0, 31.0])
def test_the_covariance_of_any_light_is_that_of_the_pixel_plus_that_of_counting(direct_ns: float) -> None:
    """The covariance of light of two paths and ambient light follows from its phasors at h and 2h.

    Counts of 2 mV add rounding with a standard deviation of 2 mV·√(1/12) in each channel. A thousandth of the variance
    in ambient light alone comes on top, so that no variance is as small as the rounding of floating point.
    """
    light, n_av = Light(0.8, mpi=0.4, direct_ns=direct_ns), 1e5
    metadata = CaptureMetadata(voltage=Voltage(volts_per_count=2e-3), pixel=Pixel(integration_length=n_av))
    model = noise_model(metadata, integration_length=n_av, quantised=True)
    pulse = {k: abs(Light(0.0, direct_ns=0.0).moment(k)) for k in (1, 2, 4)}
    for h, harmonic in zip((1, 2), model.each, strict=True):
        single, double = light.moment(h) / pulse[h], light.moment(2 * h) / pulse[2 * h]
        rotors = [(np.array([z.real]), np.array([z.imag])) for z in (single, double)]
        xx, xy, yy = (float(part[0]) for part in harmonic.covariance(*rotors))
        least = 1e-3 * 0.5 / (2 * n_av - 1)
        counting = (2e-3 / 0.2746) ** 2 / 12
        expected = (light.covariance(h, n_av) + (least + counting) * np.eye(2)) / pulse[h] ** 2
        np.testing.assert_allclose([[xx, xy], [xy, yy]], expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("n_av", [1e3, 1e5])
def test_the_integration_length_is_found_in_a_frame_with_an_edge_and_outliers(n_av: float) -> None:
    rng = np.random.default_rng(8)
    volts = step_frame(rng, height=120, width=160, n_av=n_av) / 0.2746
    p = phasors_of(volts.reshape(2, 2, -1)).reshape(2, 120, 160)
    assert estimated_integration_length(p, CaptureMetadata(), quantised=False) == pytest.approx(n_av, rel=0.06)
    p[:, rng.random((120, 160)) < 0.05] = np.nan
    p[:, rng.random((120, 160)) < 0.01] = 40.0
    assert estimated_integration_length(p, CaptureMetadata(), quantised=False) == pytest.approx(n_av, rel=0.12)


@pytest.mark.parametrize("step", [0.01, 0.3, 0.7, 1.0])
def test_the_median_of_steps_tells_the_scatter_before_rounding(step: float) -> None:
    """Rounding adds step²/12 to the variance, and so does spreading each size over its step. The usual median is a
    multiple of the step: with steps of 1, it says 1.48."""
    sizes = np.abs(np.random.default_rng(7).normal(size=100_000))
    rounded = np.abs(np.rint(sizes / step) * step)
    variance = (median_of_steps(rounded, step) / MAD_PER_SIGMA) ** 2 - step**2 / 6.0
    assert variance == pytest.approx(1.0, rel=0.1)
    assert median_of_steps(sizes, 0.0) == np.median(sizes)


def test_sizes_within_the_first_step_have_a_median_in_the_middle_of_it() -> None:
    assert median_of_steps(np.zeros(20), 1.0) == 0.25


def test_a_slope_is_not_noise() -> None:
    rng = np.random.default_rng(9)
    y, x = np.mgrid[:60, :80]
    phase = 0.02 * x + 0.03 * y
    noise = [(rng.normal(size=(60, 80)) + 1j * rng.normal(size=(60, 80))) * 1e-3 for _ in range(2)]
    p = np.stack([0.2 * np.exp(1j * h * phase) + noise[h - 1] for h in (1, 2)])
    expected = 0.5 * (1 + (AMBIENT - 0.04) / 2e-6)
    assert estimated_integration_length(p, CaptureMetadata(), quantised=False) == pytest.approx(expected, rel=0.1)


def test_without_noise_the_integration_length_is_infinite_and_without_pixels_nan() -> None:
    assert estimated_integration_length(np.full((2, 8, 8), 0.3 + 0.1j), CaptureMetadata(), quantised=False) == math.inf
    assert math.isnan(estimated_integration_length(np.full((2, 8, 8), np.nan + 0j), CaptureMetadata(), quantised=False))


@pytest.mark.parametrize(("broken", "known"), [(0, True), (1, False)])
def test_noise_is_estimated_from_sixteen_differences_or_more(broken: int, known: bool) -> None:
    """5 × 5 pixels have 16 second differences, 15 without a corner."""
    rng = np.random.default_rng(1)
    frame = np.asarray(0.1 + 1e-3 * (rng.normal(size=(2, 5, 5)) + 1j * rng.normal(size=(2, 5, 5))), np.complex128)
    frame[1, 0, :broken] = np.nan
    assert np.isfinite(estimated_integration_length(frame, CaptureMetadata(), quantised=False)) == known


@pytest.mark.parametrize(("signal", "share"), [(0.5, AMBIENT - 0.25), (0.99, AMBIENT - 0.99**2), (1.2, 1e-3 * AMBIENT)])
def test_the_noise_is_compared_with_that_of_as_much_signal_and_never_with_none(signal: float, share: float) -> None:
    rng = np.random.default_rng(3)
    noise = 1e-3 * (rng.normal(size=(2, 200, 200)) + 1j * rng.normal(size=(2, 200, 200)))
    expected = 0.5 * (1.0 + share / 2e-6)
    assert estimated_integration_length(
        np.asarray(signal + noise, np.complex128), CaptureMetadata(), quantised=False
    ) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.2, 0.3, 0.8])
def test_a_mean_of_recordings_keeps_the_rounding_that_noise_does_not_change(share: float) -> None:
    """Noise of `share` counts is added to levels anywhere between two counts, which are recorded 25 times."""
    rng = np.random.default_rng(11)
    levels = rng.uniform(-0.5, 0.5, 20_000)
    recorded = np.rint(levels + share * rng.normal(size=(25, levels.size)))
    scatter = float((recorded.mean(axis=0) - levels).std())
    metadata = CaptureMetadata(voltage=Voltage(zero_counts=0.0, volts_per_count=1e-3))
    # in units of the amplitude, ambient light has the variance 1/(2·(2 n_av − 1))
    n_av = 0.5 * (1.0 + 0.5 / max(share * 1e-3 / 0.2746, 1e-9) ** 2)
    noise = noise_model(metadata, integration_length=n_av, quantised=True)
    for one in with_repeated_rounding(noise, 25.0).each:
        assert math.sqrt(one.dark_variance / 25.0) * one.pulse * 274.6 == pytest.approx(scatter, rel=0.03)
    exact = noise_model(metadata, integration_length=n_av, quantised=False)
    assert with_repeated_rounding(exact, 25.0) is exact


def test_counting_adds_the_same_variance_along_and_across_a_path() -> None:
    metadata = CaptureMetadata(voltage=Voltage(volts_per_count=2e-3), pixel=Pixel(integration_length=1e5))
    fine, coarse = (noise_model(metadata, integration_length=1e5, quantised=quantised) for quantised in (False, True))
    amplitude = np.array([0.0, 0.3, 0.7])
    for one, other in zip(fine.each, coarse.each, strict=True):
        for before, after in zip(one.one_path_variances(amplitude), other.one_path_variances(amplitude), strict=True):
            np.testing.assert_allclose(after - before, (2e-3 / 0.2746) ** 2 / 12 / one.pulse**2, rtol=1e-6)


def test_the_noise_of_a_triangle_follows_from_its_mean_square_and_its_second_harmonics() -> None:
    """The expected numbers come from the values w1, w2 of the wave in both channels.

    They are the mean square, the fundamental, and the second harmonics of w1² and w1·w2, which are 1/2 for a sine.
    """
    theta = 2.0 * np.pi * (np.arange(4096) + 0.5) / 4096
    first, second = (np.arcsin(np.cos(theta - shift)) * 2.0 / np.pi for shift in (0.0, np.pi / 2))
    square, main = np.mean(first**2), 2.0 * np.mean(first * np.cos(theta))
    twice = [2.0 * np.mean(first**2 * np.cos(2 * theta)), 2.0 * np.mean(first * second * np.sin(2 * theta))]
    sine, triangle = (
        noise_model(CaptureMetadata(modulation=Modulation(waveform=waveform)), integration_length=1e5, quantised=False)
        for waveform in ("sine", "triangle")
    )
    for one, other in zip(sine.each, triangle.each, strict=True):
        assert other.dark_variance / one.dark_variance == pytest.approx(square / main**2 / 0.5, rel=1e-5)
        assert other.pulse_double / one.pulse_double == pytest.approx(np.mean(twice) / square, rel=1e-5)


def test_a_very_short_integration_length_is_estimated_correctly() -> None:
    """The frame is noise alone, so large that n_av = (1 + 1/averaging)/2 is only 2.9."""
    rng = np.random.default_rng(4)
    frame = np.asarray(0.3 * (rng.normal(size=(2, 250, 250)) + 1j * rng.normal(size=(2, 250, 250))), np.complex128)
    share = AMBIENT - 2.0 * 0.3**2 * np.log(2.0)
    assert estimated_integration_length(frame, CaptureMetadata(), quantised=False) == pytest.approx(
        0.5 * (1.0 + share / (2 * 0.3**2)), rel=0.05
    )


def test_columns_of_one_harmonic_are_not_noise() -> None:
    """A single harmonic is no sensor of one row."""
    rng = np.random.default_rng(3)
    noise = 1e-3 * (rng.normal(size=(1, 120, 160)) + 1j * rng.normal(size=(1, 120, 160)))
    seen = estimated_integration_length(
        np.asarray(0.2 + rng.normal(0.0, 0.01, 160) + noise, np.complex128),
        CaptureMetadata(modulation=Modulation(periods_ns=(40.0,))),
        quantised=False,
    )
    assert seen == pytest.approx(0.5 * (1.0 + (AMBIENT - 0.04) / 2e-6), rel=0.1)


@pytest.mark.parametrize("shape", [(1, 4000), (4000, 1)])
def test_a_sensor_of_one_row_or_column_shows_its_noise_along_itself(shape: tuple[int, int]) -> None:
    """Before, its noise could not be estimated. The light is that of a slanted wall with edges."""
    n_av, size = 1e4, shape[0] * shape[1]
    phase = np.linspace(0.5, 1.5, size) + 0.4 * (np.arange(size) // 100 % 2)
    volts = Light(5.0, direct_ns=0.0).voltages(np.random.default_rng(3), n_av, size)
    p = phasors_of(volts) * np.exp(1j * np.array([[1.0], [2.0]]) * phase)
    assert estimated_integration_length(p.reshape(2, *shape), CaptureMetadata(), quantised=False) == pytest.approx(
        n_av, rel=0.1
    )
    assert math.isnan(estimated_integration_length(p[:, np.newaxis, :17], CaptureMetadata(), quantised=False))


@pytest.mark.parametrize("shape", [(120, 160), (1, 19200)])
def test_pixels_that_are_means_of_other_numbers_of_recordings_count_with_their_own_noise(
    shape: tuple[int, int],
) -> None:
    """Every other pixel, and every other row, is a mean of ten times fewer."""
    n_av, size = 1e4, shape[0] * shape[1]
    y, x = np.indices(shape)
    variances = np.where((x + y // 2) % 2 == 0, 10.0, 1.0) * np.where(y % 2 == 0, 10.0, 1.0)
    p = phasors_of(Light(5.0, direct_ns=0.0).voltages(np.random.default_rng(3), n_av, size)).reshape(2, *shape)
    mean = p.mean(axis=(1, 2), keepdims=True)
    p = mean + (p - mean) * np.sqrt(variances)
    estimate = estimated_integration_length(p, CaptureMetadata(), quantised=False, variances=variances)
    assert estimate == pytest.approx(n_av, rel=0.1)


@pytest.mark.parametrize("shape", [(60, 80), (1, 4800)])
@pytest.mark.parametrize("share", [0.2, 0.45, 0.7, 0.95])
@pytest.mark.parametrize("value", [0.0, 0.2 + 0.1j])
def test_pixels_that_a_camera_sets_to_one_value_do_not_hide_the_noise(
    shape: tuple[int, int], share: float, value: complex
) -> None:
    """As the sky without light, or the corners beyond the picture of a fisheye lens. Before, sigma was far too small."""
    n_av = 1e4
    volts = Light(2.0, direct_ns=5.0).voltages(np.random.default_rng(3), n_av, 4800)
    p = phasors_of(volts)
    p[:, : int(share * 4800)] = value
    known = 0.15 if share < 0.9 else 0.4
    assert estimated_integration_length(p.reshape(2, *shape), CaptureMetadata(), quantised=False) == pytest.approx(
        n_av, rel=known
    )


def test_a_frame_of_hardly_any_noise_has_the_noise_of_all_its_pixels() -> None:
    p = np.zeros((2, 20, 20), np.complex128)
    p[:, :3, :3] = np.random.default_rng(1).normal(size=(2, 3, 3))
    assert estimated_integration_length(p, CaptureMetadata(), quantised=False) == math.inf


@pytest.mark.parametrize(("sigma", "same"), [(0.2, True), (0.4, True), (1.0, False), (5.0, False)])
def test_neighbours_of_coarse_counts_are_recorded_though_they_hold_the_same_values(sigma: float, same: bool) -> None:
    """A fifth of the frame holds one value. With noise of a few counts, that is no recording; with less, it may be one."""
    counts = np.rint(np.random.default_rng(4).normal(40.2, sigma, (2, 2, 60, 80)))
    counts[:, :, :12] = 0.0
    p = (counts[:, 0] + 1j * counts[:, 1]) / 400.0
    assert (_recorded(p, 2, 2) is p) == same


def equal_pixels(pixels: int) -> NDArray[np.float64]:
    return np.asarray(np.ones((2, 2, pixels)) * np.array([0.1, -0.05])[:, np.newaxis])


def without_noise(stored: NDArray[np.float64], *, step_v: float = 0.0) -> bool:
    n_av = 1e5
    metadata = CaptureMetadata(
        voltage=Voltage(volts_per_count=step_v or None),
        pixel=Pixel(integration_length=n_av),
    )
    return is_without_noise(stored, noise_model(metadata, integration_length=n_av, quantised=step_v > 0.0))


def test_sixteen_equal_pixels_are_without_noise_but_fewer_may_be_equal_by_chance() -> None:
    assert without_noise(equal_pixels(16))
    assert not without_noise(equal_pixels(15))
    assert without_noise(equal_pixels(500))


@pytest.mark.parametrize("place", [(0, 0, 0), (1, 1, 15), (0, 1, 16), (1, 0, 499)])
def test_one_value_that_differs_is_noise(place: tuple[int, int, int]) -> None:
    stored = equal_pixels(500)
    stored[place] += 1e-9
    assert not without_noise(stored)


@pytest.mark.parametrize(("steps", "impossible"), [(0.55, True), (0.45, False)])
def test_noise_below_half_a_step_may_leave_all_values_equal(steps: float, impossible: bool) -> None:
    """The noise of a channel is 1/(2·√n_av) of the modulation amplitude, here `steps` steps of the stored values."""
    sigma_v = AMPLITUDE_V / (2.0 * np.sqrt(1e5))
    assert without_noise(equal_pixels(100), step_v=sigma_v / steps) is impossible
