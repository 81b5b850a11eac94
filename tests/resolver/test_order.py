"""The order test keeps another path only if it moves the direct path by more than the scatter that it adds.

This holds wherever the phases lie on the circle.
"""

import numpy as np
import pytest

from cadtof_cli.resolver.order import worth_another
from cadtof_cli.resolver.paths import Paths


def path(phase_rad: float, sigma_rad: float) -> Paths:
    return Paths(np.array([0.3]), np.array([phase_rad % (2 * np.pi)]), np.array([sigma_rad]))


@pytest.mark.parametrize("middle", [0.0, 1.0, np.pi, 6.28])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("moved", "worth"), [(0.99, False), (1.01, True)])
def test_another_path_is_kept_if_it_moves_the_direct_path_by_more_than_the_root_of_twice_the_added_variance(
    middle: float, side: float, moved: float, worth: bool
) -> None:
    limit = np.sqrt(2 * (0.05**2 - 0.03**2))
    direct, fewer = path(middle + side * moved * limit, 0.05), path(middle, 0.03)
    assert worth_another(direct, fewer)[0] == worth


def test_another_path_that_adds_no_scatter_is_kept() -> None:
    assert worth_another(path(1.0, 0.01), path(1.0, 0.02))[0]
