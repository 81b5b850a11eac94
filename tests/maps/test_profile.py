"""Distances of the pixels of a cross-section along its line."""

import numpy as np
import pytest

from cadtof_cli.maps.profile import Profile


@pytest.mark.parametrize(
    ("rows", "columns", "along"),
    [([7, 7, 7], [3, 4, 5], [0, 1, 2]), ([9, 8, 7], [3, 3, 3], [0, 1, 2]), ([1, 4, 9], [2, 6, 8], [0, 5, 10])],
)
def test_distances_are_measured_from_the_first_pixel_in_any_direction_of_the_line(
    rows: list[int], columns: list[int], along: list[float]
) -> None:
    line = Profile("direct.depth", "m", "", "along the line", np.array(rows), np.array(columns), "", (), None)
    np.testing.assert_allclose(line.along, along)
