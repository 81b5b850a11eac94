"""Values in another unit than they should be are doubted, if no camera has such values."""

import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics
from cadtof_cli.doubts.mistaken_units import mistaken_unit


def test_periods_that_are_hardly_in_ns_raise_a_doubt() -> None:
    long, in_ps = (CaptureMetadata(modulation=Modulation(periods_ns=(one, one / 2))) for one in (1e4, 40e3))
    assert mistaken_unit(long, (240, 320)) is None
    doubt = "modulation.periods_ns = 40000, … means depths up to 5996 m: is it in ps instead of ns?"
    assert mistaken_unit(in_ps, (240, 320)) == doubt


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
        # the optical axis of a cropped sensor may lie beyond it
        (Optics(principal_point_px=(-40.5, -30.5)), None),
    ],
)
def test_optics_that_are_hardly_in_pixels_raise_a_doubt(optics: Optics, beginning: str | None) -> None:
    """With a focal length of 59 pixels, a width of 320 pixels is a view of 2·atan(160/59) = 139.5°."""
    found = mistaken_unit(CaptureMetadata(optics=optics), (240, 320))
    assert found is None if beginning is None else str(found).startswith(beginning)


def test_the_middle_of_a_tiny_frame_may_be_near_its_first_pixel() -> None:
    assert mistaken_unit(CaptureMetadata(optics=Optics(principal_point_px=(0.5, 0.5))), (2, 2)) is None


def test_a_lamp_farther_than_a_metre_from_the_camera_raises_a_doubt() -> None:
    near, far = (CaptureMetadata(optics=Optics(lamp_offset_m=place)) for place in ((0.3, 0.0, 0.1), (3.0, 0.0, 0.0)))
    assert mistaken_unit(near, (2, 2)) is None
    assert str(mistaken_unit(far, (2, 2))).endswith("is the value in cm instead of m?")
