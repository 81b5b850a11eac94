"""Means of many frames and what one frame's noise is, whatever the number of frames."""

import numpy as np
import pytest
from scipy import stats

from cadtof_cli.calibration.averaging import FrameAverage, MeanFrame, median_variance_ratio
from cadtof_cli.capture.metadata import CaptureMetadata, Voltage
from cadtof_cli.errors import SettingsError

SHAPE = (2, 2, 40, 50)


def averaged(frames: np.ndarray, voltage: Voltage | None = None) -> MeanFrame:
    average = FrameAverage(CaptureMetadata(voltage=voltage or Voltage()))
    for frame in frames:
        average.add(frame)
    return average.result()


@pytest.mark.parametrize("frames", [2, 3, 20])
def test_the_typical_noise_is_that_of_one_frame(frames: int) -> None:
    """Each harmonic's own; the median over pixels of sample variances, which are χ², lies below their mean."""
    sigma = np.array([3e-4, 5e-4])
    drawn = np.random.default_rng(1).normal(size=(frames, *SHAPE)) * sigma[:, np.newaxis, np.newaxis, np.newaxis]
    mean = averaged(drawn)
    np.testing.assert_allclose(mean.noise_v(), sigma, rtol=0.06)
    assert mean.frames == frames
    assert mean.pixels == (40, 50)


def test_one_frame_has_no_noise_to_tell() -> None:
    mean = averaged(np.ones((1, *SHAPE)))
    np.testing.assert_array_equal(mean.noise_v(), [0.0, 0.0])
    np.testing.assert_array_equal(mean.variance_v2, 0.0)


@pytest.mark.parametrize("frames", [2, 3, 20])
def test_the_median_of_a_sample_variance_over_the_true_one(frames: int) -> None:
    drawn = stats.chi2(frames - 1).rvs(200_000, random_state=1) / (frames - 1)
    assert median_variance_ratio(frames) == pytest.approx(np.median(drawn), rel=0.02)


def test_counts_become_volts_before_they_are_averaged() -> None:
    counts = np.random.default_rng(2).integers(1000, 9000, (5, *SHAPE)).astype(np.uint16)
    mean = averaged(counts, Voltage(zero_counts=8192.0, volts_per_count=6e-5))
    volts = (counts.astype(np.float64) - 8192.0) * 6e-5
    np.testing.assert_allclose(mean.mean_v, volts.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(mean.variance_v2, volts.var(axis=0, ddof=1), rtol=1e-9)
    assert mean.sound.all()


@pytest.mark.parametrize(
    ("value", "sound"), [(0, False), (1, True), (16382, True), (16383, False), (20000, False), (8192, True)]
)
def test_a_value_at_or_beyond_the_limits_in_any_frame_spoils_its_pixel_alone(value: int, sound: bool) -> None:
    counts = np.full((3, *SHAPE), 8000, np.uint16)
    counts[1, 1, 0, 3, 4] = value
    voltage = Voltage(zero_counts=8192.0, volts_per_count=6e-5, saturated_counts=(0.0, 16383.0))
    mean = averaged(counts, voltage)
    assert mean.sound[3, 4] == sound
    assert mean.sound.sum() == 40 * 50 - (not sound)
    assert np.isfinite(mean.mean_v[:, :, 3, 4]).all() == sound
    assert np.isfinite(mean.mean_v[:, :, 3, 5]).all()


def test_what_comes_later_does_not_change_a_result() -> None:
    average = FrameAverage(CaptureMetadata()).add(np.zeros(SHAPE))
    before = average.result()
    average.add(np.full(SHAPE, np.nan))
    assert before.sound.all()
    assert not average.result().sound.any()
    with pytest.raises(
        SettingsError, match=r"found a frame of shape \(2, 2, 40, 51\) \(H C Y X\), expected \(2, 2, 40, 50\)"
    ):
        average.add(np.zeros((2, 2, 40, 51)))
