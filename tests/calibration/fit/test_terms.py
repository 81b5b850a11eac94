"""Which terms a waveform has after changes to it."""

import numpy as np
import pytest

from cadtof_cli.calibration.fit.pixels import series
from cadtof_cli.calibration.fit.terms import composed

TRIANGLE = {-3: 1 / 9 + 0.01j, 5: 1 / 25 + 0j}


def test_an_imbalance_mirrors_all_of_the_waveform() -> None:
    """v + c·conj(v), for any waveform v: what is at k comes back at −k."""
    c = 0.03 - 0.02j
    theta = np.linspace(-3.0, 3.0, 50)
    wave = np.exp(1j * theta) * series(TRIANGLE, theta)
    found = np.exp(1j * theta) * series(composed(TRIANGLE, {-1: c}), theta)
    np.testing.assert_allclose(found, wave + c * wave.conj(), atol=1e-15)


@pytest.mark.parametrize("k", [0, -3, 3, 5])
def test_a_change_of_another_order_changes_that_order_alone(k: int) -> None:
    found = composed(TRIANGLE, {k: 0.02j})
    assert found == TRIANGLE | {k: TRIANGLE.get(k, 0j) + 0.02j}
    assert composed(TRIANGLE, {}) == TRIANGLE
