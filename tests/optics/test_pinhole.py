"""Where pixels look: rays of a pinhole camera have known angles."""

import numpy as np
import pytest

from cadtof_cli.capture.metadata import Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.optics import planar_per_range, ray_slopes

FOCAL = Optics(focal_length_px=3.0)


def test_a_ray_of_three_and_four_is_five_long() -> None:
    factor = planar_per_range(Optics(focal_length_px=3.0, principal_point_px=(1.0, 2.0)), (3, 6))
    assert factor.shape == (3, 6)
    assert factor[2, 1] == 1.0
    assert factor[2, 5] == pytest.approx(3.0 / 5.0)
    assert factor[0, 4] == pytest.approx(3.0 / np.sqrt(9.0 + 9.0 + 4.0))


@pytest.mark.parametrize(("height", "width"), [(5, 7), (4, 6)])
def test_without_a_principal_point_the_middle_of_the_array_looks_straight_ahead(height: int, width: int) -> None:
    factor = planar_per_range(FOCAL, (height, width))
    np.testing.assert_allclose(factor, factor[::-1, ::-1], rtol=1e-15)
    x, y = ray_slopes(FOCAL, (height, width))
    np.testing.assert_allclose([x.sum(), y.sum()], 0.0, atol=1e-15)
    assert x[0, -1] == pytest.approx((width - 1) / 2 / 3.0)
    assert y[-1, 0] == pytest.approx((height - 1) / 2 / 3.0)


def test_without_a_focal_length_there_are_no_rays() -> None:
    with pytest.raises(SettingsError, match=r"set focal_length_px under \[optics\] in capture.toml"):
        ray_slopes(Optics(), (4, 6))


def test_a_principal_point_that_is_not_given_is_the_middle_as_column_and_row() -> None:
    assert Optics().principal_point((6, 9)) == (4.0, 2.5)
    assert Optics(principal_point_px=(1.0, 2.0)).principal_point((6, 9)) == (1.0, 2.0)
