"""Stored values become volts and phasors by one affine map; saturated pixels are found."""

import numpy as np
import pytest
from scipy import integrate

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pulse, Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.response import pulse_response
from cadtof_cli.phasors.voltages import (
    ideal_phasor_map,
    phasors_from_stored,
    saturated_pixels,
    sound_pixels,
    spread_over,
    volts_from_stored,
)


@pytest.mark.parametrize("harmonic", [1, 2, 4])
def test_the_pulse_response_is_the_fourier_integral_of_the_pulse(harmonic: int) -> None:
    s = 1.7 / (2 * np.sqrt(2 * np.log(2)))
    gaussian = integrate.quad(
        lambda t: np.exp(-((t / s) ** 2) / 2) / (s * np.sqrt(2 * np.pi)) * np.cos(harmonic * 2 * np.pi * t / 40),
        -10,
        10,
    )[0]
    assert pulse_response(harmonic, fwhm_ns=1.7, period_ns=40.0) == pytest.approx(gaussian, rel=1e-9)


def test_the_pulse_of_the_paper_weakens_the_second_harmonic_more() -> None:
    r1, r2 = (pulse_response(h, fwhm_ns=1.7, period_ns=40.0) for h in (1, 2))
    assert (round(r1, 3), round(r2, 3)) == (0.994, 0.975)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float16, np.float32, np.float64])
def test_stored_values_of_any_type_become_normalised_phasors(dtype: type) -> None:
    metadata = CaptureMetadata(
        voltage=Voltage(zero_counts=100.0, volts_per_count=1e-3),
        modulation=Modulation(amplitude_v=0.25),
        pulse=Pulse(fwhm_ns=0.0),
    )
    stored: Stored = np.array([[[110, 90], [100, 125]], [[100, 200], [50, 100]]]).astype(dtype)
    before = stored.copy()
    phasors = phasors_from_stored(stored, ideal_phasor_map(metadata, stored.dtype))
    expected = [[0.04 + 0j, -0.04 + 0.1j], [-0.2j, 0.4 + 0j]]
    np.testing.assert_allclose(phasors, expected, atol=1e-15)
    assert phasors.dtype == np.complex128
    np.testing.assert_array_equal(stored, before)


def test_each_harmonic_is_divided_by_its_own_pulse_response() -> None:
    ideal = ideal_phasor_map(CaptureMetadata(), np.dtype(np.float32))
    phasors = phasors_from_stored(np.full((2, 2, 1), 0.2746 / np.sqrt(2)), ideal)
    np.testing.assert_allclose(np.abs(phasors[:, 0]), [1 / 0.993591, 1 / 0.974609], rtol=1e-5)


def test_values_at_or_beyond_the_limits_are_saturated_and_nan_is_not() -> None:
    metadata = CaptureMetadata(voltage=Voltage(volts_per_count=1.0))
    stored = np.full((2, 2, 6), 100.0)
    stored[0, 0, 1], stored[1, 1, 2], stored[0, 1, 3], stored[1, 0, 4] = 255, 0, -3, np.nan
    phasors = phasors_from_stored(stored, ideal_phasor_map(metadata, stored.dtype))
    assert np.isnan(phasors).any(axis=0).tolist() == [False] * 4 + [True, False]
    assert saturated_pixels(stored, (0.0, 255.0)).tolist() == [False, True, True, True, False, False]
    assert sound_pixels(stored, (0.0, 255.0)).tolist() == [True, False, False, False, False, True]
    assert not saturated_pixels(stored, None).any()
    assert sound_pixels(stored, None).tolist() == [True] * 4 + [False, True]


def test_whole_numbers_without_a_scale_are_refused_and_floats_are_volts() -> None:
    with pytest.raises(
        SettingsError, match=r"whole numbers \(uint16\).*volts_per_count and zero_counts under \[voltage\]"
    ):
        ideal_phasor_map(CaptureMetadata(), np.dtype(np.uint16))
    ideal = ideal_phasor_map(CaptureMetadata(), np.dtype(np.float16))
    np.testing.assert_allclose(ideal.own[0], 1 / 0.2746 / 0.993591, rtol=1e-5)
    np.testing.assert_array_equal(volts_from_stored(np.array([-0.5, 0.25], np.float16), Voltage()), [-0.5, 0.25])


def test_a_part_of_a_map_for_all_pixels_is_the_same_map() -> None:
    metadata = CaptureMetadata(voltage=Voltage(zero_counts=3.0, volts_per_count=0.5))
    stored = np.arange(20.0).reshape(2, 2, 5)
    ideal = ideal_phasor_map(metadata, stored.dtype)
    whole = phasors_from_stored(stored, ideal)
    np.testing.assert_array_equal(phasors_from_stored(stored[..., 2:4], ideal[2:4]), whole[:, 2:4])


def test_unsigned_counts_need_the_stored_value_of_0_v() -> None:
    known = Voltage(zero_counts=100.0, volts_per_count=1e-3)
    assert volts_from_stored(np.array([110], np.uint16), known) == pytest.approx(0.01)
    with pytest.raises(SettingsError, match=r"unsigned numbers \(uint16\), and the stored value of 0 V is unknown"):
        volts_from_stored(np.array([110], np.uint16), Voltage(volts_per_count=1e-3))
    with pytest.raises(SettingsError, match="set volts_per_count under"):
        volts_from_stored(np.array([110], np.int16), Voltage())
    assert volts_from_stored(np.array([110], np.int16), Voltage(volts_per_count=1e-3)) == pytest.approx(0.11)
    assert volts_from_stored(np.array([0.25], np.float32), Voltage()) == pytest.approx(0.25)


@pytest.mark.parametrize("harmonics", [1, 2, 3, 5])
def test_there_are_as_many_phasors_as_harmonics(harmonics: int) -> None:
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=tuple(40.0 / h for h in range(1, harmonics + 1))))
    stored = np.random.default_rng(1).normal(scale=0.05, size=(harmonics, 2, 7))
    phasors = phasors_from_stored(stored, ideal_phasor_map(metadata, stored.dtype))
    pulse = [pulse_response(h, fwhm_ns=1.7, period_ns=40.0) for h in range(1, harmonics + 1)]
    expected = (stored[:, 0] + 1j * stored[:, 1]) / 0.2746 / np.array(pulse)[:, np.newaxis]
    np.testing.assert_allclose(phasors, expected, rtol=1e-9)


@pytest.mark.parametrize(("pixels", "found"), [(1, 1), (9, 9), (10, 10), (19, 19), (20, 10), (29, 15), (305, 11)])
def test_pixels_spread_over_a_frame_are_as_many_as_asked_or_up_to_twice_as_many(pixels: int, found: int) -> None:
    stored = np.arange(4.0 * pixels).reshape(2, 2, 1, pixels)
    some = spread_over(stored, 10)
    assert some.shape == (2, 2, found)
    assert np.ptp(np.diff(some, axis=2)) == 0.0 if found > 1 else True
    np.testing.assert_array_equal(some[:, :, 0], stored[:, :, 0, 0])
