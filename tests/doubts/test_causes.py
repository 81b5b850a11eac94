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
