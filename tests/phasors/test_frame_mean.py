"""Means of frames: of stored values, and of volts together with their scatter."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.frame_mean import MeanVolts, frame_mean, mean_volts, median_variance_ratio, variance_ratio

SHAPE = (2, 2, 40, 50)


def frames(*values: float, dtype: str = "uint16") -> list[np.ndarray]:
    """Return frames, (2, 2, 1, 3), that hold one value each."""
    return [np.full((2, 2, 1, 3), value, dtype) for value in values]


def test_the_mean_is_that_of_the_stored_values() -> None:
    mean = frame_mean(frames(100, 101, 105), saturated_counts=None)
    np.testing.assert_array_equal(mean.stored, 102.0)
    np.testing.assert_array_equal(mean.samples, 3.0)
    assert mean.dtype == np.uint16


def test_a_frame_in_which_a_pixel_is_saturated_counts_for_the_other_pixels_only() -> None:
    given = frames(100, 200)
    given[0][1, 0, 0, 2] = 16383
    mean = frame_mean(given, saturated_counts=(0, 16383))
    np.testing.assert_array_equal(mean.stored[0, 0, 0], [150.0, 150.0, 200.0])
    np.testing.assert_array_equal(mean.samples, [[2.0, 2.0, 1.0]])


def test_a_pixel_saturated_in_every_frame_stays_saturated() -> None:
    """One frame is at the lower limit, the other at the upper. Their mean would look like a valid value."""
    given = frames(0, 16383)
    mean = frame_mean(given, saturated_counts=(0, 16383))
    np.testing.assert_array_equal(mean.stored, 0.0)
    np.testing.assert_array_equal(mean.samples, 1.0)


def test_a_frame_in_which_a_pixel_is_nan_does_not_count_for_this_pixel() -> None:
    given = frames(1.0, 3.0, dtype="float32")
    given[1][0, 0, 0, 0] = np.nan
    mean = frame_mean(given, saturated_counts=None)
    np.testing.assert_array_equal(mean.stored[1, 1, 0], [1.0, 2.0, 2.0])
    assert np.isfinite(mean.stored).all()


def mean_of(given: np.ndarray, voltage: Voltage | None = None) -> MeanVolts:
    return mean_volts(given, voltage=voltage or Voltage())


@pytest.mark.parametrize("count", [2, 3, 20])
def test_the_noise_of_one_frame_is_estimated_from_the_scatter(count: int) -> None:
    """Each harmonic has its own noise. Sample variances have a χ² distribution, whose median is below its mean.

    So the median over the pixels must be corrected.
    """
    sigma = np.array([3e-4, 5e-4])
    drawn = np.random.default_rng(1).normal(size=(count, *SHAPE)) * sigma[:, np.newaxis, np.newaxis, np.newaxis]
    mean = mean_of(drawn)
    np.testing.assert_allclose(mean.frame_noise(), sigma, rtol=0.06)
    assert mean.frames == count
    assert mean.pixels == (40, 50)


def test_one_frame_has_no_scatter_and_an_estimated_noise_of_0() -> None:
    mean = mean_of(np.ones((1, 3, *SHAPE[1:])))
    np.testing.assert_array_equal(mean.frame_noise(), [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(mean.variance, 0.0)
    assert mean.frames == 1


@pytest.mark.parametrize("count", [2, 3, 20])
def test_the_median_of_sample_variances_has_the_expected_ratio_to_the_true_variance(count: int) -> None:
    drawn = stats.chi2(count - 1).rvs(200_000, random_state=1) / (count - 1)
    assert median_variance_ratio(count) == pytest.approx(np.median(drawn), rel=0.02)


def test_counts_become_volts_before_the_mean_is_taken() -> None:
    counts = np.random.default_rng(2).integers(1000, 9000, (5, *SHAPE)).astype(np.uint16)
    mean = mean_of(counts, Voltage(zero_counts=8192.0, volts_per_count=6e-5))
    volts = (counts.astype(np.float64) - 8192.0) * 6e-5
    np.testing.assert_allclose(mean.volts, volts.mean(axis=0), rtol=1e-12)
    assert mean.variance is not None
    np.testing.assert_allclose(mean.variance, volts.var(axis=0, ddof=1), rtol=1e-9)
    assert mean.sound.all()


@pytest.mark.parametrize(
    ("value", "sound"), [(0, False), (1, True), (16382, True), (16383, False), (20000, False), (8192, True)]
)
def test_a_saturated_value_in_any_frame_invalidates_only_its_own_pixel(value: int, sound: bool) -> None:
    counts = np.full((3, *SHAPE), 8000, np.uint16)
    counts[1, 1, 0, 3, 4] = value
    voltage = Voltage(zero_counts=8192.0, volts_per_count=6e-5, saturated_counts=(0.0, 16383.0))
    mean = mean_of(counts, voltage)
    assert mean.sound[3, 4] == sound
    assert mean.sound.sum() == 40 * 50 - (not sound)
    assert np.isfinite(mean.volts[:, :, 3, 4]).all() == sound
    assert np.isfinite(mean.volts[:, :, 3, 5]).all()


def test_frames_of_different_sizes_have_no_mean() -> None:
    given = [np.zeros((2, 2, 1, 3)), np.zeros((2, 2, 1, 4))]
    with pytest.raises(SettingsError, match=r"found a frame of shape \(2, 2, 1, 4\) .*expected \(2, 2, 1, 3\)"):
        mean_volts(given, voltage=Voltage())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 1.0])
def test_the_noise_of_a_mean_of_counts_includes_rounding_that_is_the_same_in_all_frames(share: float) -> None:
    """The noise is this share of a count. It was 0 if most pixels hold one count in all frames, and `calibrate response`
    ended with a division by it."""
    rng = np.random.default_rng(3)
    levels = rng.uniform(40.0, 90.0, (1, 2, 60, 80))
    counts = np.rint(levels + share * rng.normal(size=(12, *levels.shape))).astype(np.uint8)
    mean = mean_volts(counts, voltage=Voltage(volts_per_count=1.0, zero_counts=0.0))
    off = float((mean.volts - levels).std())
    # counts show little of the noise if it is small, so the error may be thought to be larger than it is
    assert 0.9 * off < float(mean.mean_noise()[0]) < 1.6 * off
    assert float(mean.frame_noise()[0]) >= 0.999 / np.sqrt(12.0)


@pytest.mark.parametrize("frames", [2, 3, 8, 100, 5000])
def test_quantiles_of_the_sample_variance_are_those_of_chi2(frames: int) -> None:
    shares = (1e-6, 0.5, 1.0 - 1e-6)
    from_scipy = stats.chi2.ppf(shares, frames - 1) / (frames - 1)
    assert [variance_ratio(frames, share) for share in shares] == pytest.approx(from_scipy, rel=1e-12)


SHORT_OF_MEMORY = """
import resource, sys
from cadtof_cli.phasors.frame_mean import median_variance_ratio
used = 1024 * next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmSize"))
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[1]),) * 2)
try:
    median_variance_ratio(8)
except MemoryError:
    print("told")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit the memory of a process")
@pytest.mark.parametrize("left_mib", [20, 40, 60, 80, 100])
def test_too_little_memory_for_scipy_is_told_and_not_waited_for(left_mib: int) -> None:
    """The linear algebra of scipy would ask for memory without end, and no signal but SIGKILL would end it."""
    command = [sys.executable, "-c", SHORT_OF_MEMORY, str(left_mib * 2**20)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "told\n"), done.stderr
