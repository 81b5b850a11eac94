import numpy as np
import pytest

from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean


def frames(*values: float, dtype: str = "uint16") -> list[np.ndarray]:
    """Frames (2, 2, 1, 3) of one value each."""
    return [np.full((2, 2, 1, 3), value, dtype) for value in values]


def test_the_mean_is_that_of_what_was_stored() -> None:
    mean = frame_mean(frames(100, 101, 105), saturated_counts=None)
    np.testing.assert_array_equal(mean.stored, 102.0)
    np.testing.assert_array_equal(mean.samples, 3.0)
    assert mean.dtype == np.uint16


def test_a_saturated_frame_counts_in_no_plane_of_that_pixel_and_in_all_others() -> None:
    given = frames(100, 200)
    given[0][1, 0, 0, 2] = 16383
    mean = frame_mean(given, saturated_counts=(0, 16383))
    np.testing.assert_array_equal(mean.stored[0, 0, 0], [150.0, 150.0, 200.0])
    np.testing.assert_array_equal(mean.samples, [[2.0, 2.0, 1.0]])


def test_a_pixel_saturated_in_every_frame_stays_saturated() -> None:
    """The mean of the two limits would lie between them."""
    given = frames(0, 16383)
    mean = frame_mean(given, saturated_counts=(0, 16383))
    np.testing.assert_array_equal(mean.stored, 0.0)
    np.testing.assert_array_equal(mean.samples, 1.0)


def test_not_a_number_counts_for_nothing() -> None:
    given = frames(1.0, 3.0, dtype="float32")
    given[1][0, 0, 0, 0] = np.nan
    mean = frame_mean(given, saturated_counts=None)
    np.testing.assert_array_equal(mean.stored[1, 1, 0], [1.0, 2.0, 2.0])
    assert np.isfinite(mean.stored).all()


def test_the_mean_of_no_frames_is_refused() -> None:
    with pytest.raises(ValueError, match="no frames"):
        frame_mean([], saturated_counts=None)


def test_one_frame_stands_for_itself() -> None:
    (given,) = frames(7)
    one = FrameMean.of_one(given)
    assert one.stored is given
    assert one.samples is None
