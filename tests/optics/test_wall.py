"""Rays meet a wall where geometry by hand says."""

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Optics
from cadtof_cli.optics import wall_range_m


def test_a_wall_is_as_far_as_its_plane() -> None:
    ranges = wall_range_m(
        Optics(focal_length_px=4.0, principal_point_px=(1.0, 1.0)), (2, 5), distance_m=2.0, slopes=(0.5, -0.25)
    )
    assert ranges[1, 1] == 2.0
    assert ranges[1, 4] == pytest.approx(2.0 * 1.25 / (1 + 0.5 * 0.75))
    assert ranges[0, 1] == pytest.approx(2.0 * np.sqrt(1 + 1 / 16) / (1 + 0.25 / 4))
