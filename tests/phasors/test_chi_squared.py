"""Thresholds of a misfit against the χ² distribution of scipy."""

import pytest
from scipy import stats

from cadtof_cli.phasors.noise import chi_squared_threshold


@pytest.mark.parametrize("pairs", [1, 2, 3, 6])
@pytest.mark.parametrize("false_alarm", [0.99, 0.5, 0.1, 0.01, 1e-4, 1e-9])
def test_noise_exceeds_the_threshold_at_the_false_alarm_rate(pairs: int, false_alarm: float) -> None:
    expected = stats.chi2.isf(false_alarm, 2 * pairs)
    assert chi_squared_threshold(false_alarm, pairs=pairs) == pytest.approx(expected, rel=1e-9)
