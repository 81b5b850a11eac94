"""The likely cause of stored values that cannot be voltages, by their range alone."""

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.doubts.causes import likely_cause, range_of

VOLTAGE = Voltage(zero_counts=8192.0, volts_per_count=6.0e-5)

ZERO_OF_8_BITS = 8192.0 * 255.0 / 65535.0
"""What `zero_counts` becomes if a program scales 16 bits to 8."""


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_values_of_8_bits_about_the_scaled_zero_were_scaled_to_8_bits(dtype: type[np.generic]) -> None:
    values = np.rint(ZERO_OF_8_BITS + np.linspace(-4.0, 4.0, 50)).astype(dtype)
    assert "scaled to 8 bits" in likely_cause(range_of(values), VOLTAGE, 0.2746)


@pytest.mark.parametrize(("low", "high", "is_of_8_bits"), [(240.0, 254.0, True), (258.0, 268.0, False)])
def test_larger_values_than_255_were_not_scaled_to_8_bits(low: float, high: float, is_of_8_bits: bool) -> None:
    """65000 counts become 253 of 255. Both ranges lie within the modulation amplitude, 18 of 255, of it."""
    voltage = Voltage(zero_counts=65000.0, volts_per_count=6.0e-5)
    cause = likely_cause(range_of(np.linspace(low, high, 50).astype(np.uint16)), voltage, 0.2746)
    assert ("scaled to 8 bits" in cause) == is_of_8_bits


@pytest.mark.parametrize(("middle", "is_scaled"), [(0.5, True), (1.5, False)])
def test_only_floats_up_to_1_were_scaled_to_1(middle: float, is_scaled: bool) -> None:
    """Both are as far beyond the modulation amplitude, and 255 times as large lie about the zero."""
    voltage = Voltage(zero_counts=255.0 * middle, volts_per_count=1e-3 / middle)
    cause = likely_cause(range_of(np.linspace(0.8 * middle, 1.2 * middle, 50)), voltage, 0.1)
    assert ("scaled to 0 … 1" in cause) == is_scaled


@pytest.mark.parametrize(("largest", "is_mv"), [(12.0, False), (16.0, True), (350.0, True), (450.0, False)])
def test_values_within_the_amplitude_in_millivolts_look_like_millivolts(largest: float, is_mv: bool) -> None:
    """The modulation amplitude is 275 mV; light and offsets are a twentieth of it to one and a half of it."""
    values = np.linspace(-largest, largest, 2001) + 1e-3
    assert ("look like millivolts" in likely_cause(range_of(values), Voltage(), 0.2746)) == is_mv


@pytest.mark.parametrize(("largest", "is_volts"), [(0.36, True), (0.39, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_floats_as_large_as_the_amplitude_look_like_volts_already(largest: float, is_volts: bool, sign: float) -> None:
    values = sign * np.linspace(0.1, largest, 2001)
    assert ("like volts already" in likely_cause(range_of(values), VOLTAGE, 0.2746)) == is_volts


@pytest.mark.parametrize(("largest", "is_shifted"), [(6000, True), (6500, False)])
@pytest.mark.parametrize("dtype", [np.int16, np.float32])
def test_counts_about_0_look_like_counts_without_their_zero(
    largest: int, is_shifted: bool, dtype: type[np.generic]
) -> None:
    values = np.linspace(-largest, largest, 2001).astype(dtype)
    cause = likely_cause(range_of(values), VOLTAGE, 0.2746)
    assert ("the zero was subtracted" in cause) == is_shifted


def test_floats_up_to_1_were_not_scaled_to_1_if_no_scale_brings_them_to_the_zero() -> None:
    """Of 16 bits, .5 is 32767; of 14 bits, 8191; of 12, 10 and 8 bits, less."""
    voltage = Voltage(zero_counts=20000.0, volts_per_count=6.0e-5)
    assert "scaled to 0 … 1" not in likely_cause(range_of(np.linspace(0.4, 0.6, 50)), voltage, 0.2746)
