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


@pytest.mark.parametrize(
    ("optics", "beginning"),
    [
        (Optics(), None),
        (Optics(focal_length_px=280.0, principal_point_px=(159.5, 119.5)), None),
        (Optics(focal_length_px=59.0), None),
        (
            Optics(focal_length_px=4.2),
            "optics.focal_length_px = 4.2 means a view of 177°: is the value in mm instead of pixels?",
        ),
        (
            Optics(principal_point_px=(0.5, 0.5)),
            "optics.principal_point_px = 0.5, 0.5 lies in a corner of the frame: ",
        ),
        (Optics(principal_point_px=(-20.0, 119.5)), None),
    ],
)
def test_optics_that_are_hardly_in_pixels_raise_a_doubt(optics: Optics, beginning: str | None) -> None:
    """With a focal length of 59 pixels, a width of 320 pixels is a view of 2·atan(160/59) = 139.5°."""
    found = optics.doubt((240, 320))
    assert found is None if beginning is None else str(found).startswith(beginning)


def test_the_middle_of_a_tiny_frame_may_be_near_its_first_pixel() -> None:
    assert Optics(principal_point_px=(0.5, 0.5)).doubt((2, 2)) is None


def test_a_lamp_farther_than_a_metre_from_the_camera_raises_a_doubt() -> None:
    assert Optics(lamp_offset_m=(0.3, 0.0, 0.1)).doubt((2, 2)) is None
    assert str(Optics(lamp_offset_m=(3.0, 0.0, 0.0)).doubt((2, 2))).endswith("is the value in cm instead of m?")
