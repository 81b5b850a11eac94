"""The field curvature is that computed by hand."""

import pytest

from cadtof_cli.optics import curvature_m


def test_curvature_is_counted_from_the_point_over_half_the_diagonal() -> None:
    found = curvature_m((6, 8), (4.0, 3.0), (0.06, -0.02))
    assert found[3, 4] == 0.0
    assert found[0, 0] == pytest.approx(0.06 - 0.02)
    assert found[3, 0] == pytest.approx(0.06 * 0.64 - 0.02 * 0.64**2)
