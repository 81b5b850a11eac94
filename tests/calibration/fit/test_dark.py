"""Offsets, noise and bad pixels from dark frames that are drawn here, so that their truth is known."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from cadtof_cli.calibration.dark import DarkCalibration, Defect
from cadtof_cli.calibration.fit.dark import fit_dark, tells_dead
from cadtof_cli.calibration.parts import Origin
from cadtof_cli.capture.metadata import Voltage
from cadtof_cli.errors import SettingsError
from cadtof_cli.phasors.frame_mean import MeanVolts, mean_volts

SHAPE = (2, 2, 30, 40)
NOISE_V = 0.0004


def offsets_v() -> NDArray[np.float64]:
    return np.random.default_rng(0).uniform(-0.02, 0.02, SHAPE)


def frames_v(count: int, *, seed: int = 1) -> NDArray[np.float64]:
    return offsets_v() + np.random.default_rng(seed).normal(0.0, NOISE_V, (count, *SHAPE))


def mean_of(frames: NDArray[Any], voltage: Voltage | None = None) -> MeanVolts:
    return mean_volts(frames, voltage=voltage or Voltage())


def test_a_single_frame_has_the_noise_that_is_predicted_of_each_harmonic() -> None:
    mean = mean_volts([np.zeros((2, 2, 5, 6))], voltage=Voltage())
    origin = Origin(captures=("dark",), frames=1, pixels=mean.pixels, periods_ns=(40.0, 20.0), waveform="sine")
    found = fit_dark(mean, origin=origin, predicted_noise_v=np.array([1e-3, 3e-3])).noise_v
    np.testing.assert_allclose(found[0], 1e-3, rtol=1e-6)
    np.testing.assert_allclose(found[1], 3e-3, rtol=1e-6)


def fitted(mean: MeanVolts) -> DarkCalibration:
    origin = Origin(
        captures=("dark",), frames=mean.frames, pixels=mean.pixels, periods_ns=(40.0, 20.0), waveform="sine"
    )
    return fit_dark(mean, origin=origin, predicted_noise_v=np.array([2 * NOISE_V, 2 * NOISE_V]))


def dark_of(frames: NDArray[Any], voltage: Voltage | None = None) -> DarkCalibration:
    return fitted(mean_of(frames, voltage))


def test_offsets_scatter_about_the_truth_by_their_standard_error() -> None:
    dark = dark_of(frames_v(20))
    stderr = dark.quality()["offset_stderr_v"]
    assert stderr == pytest.approx(NOISE_V / np.sqrt(20), rel=0.03)
    deviations = np.abs(dark.offset_v - offsets_v()) / stderr
    assert (deviations < 3.0).mean() > 0.994
    assert deviations.max() < 6.0
    assert not dark.hot.any()


def test_one_frame_has_the_predicted_noise_and_standard_error() -> None:
    """It had a noise and a standard error of 0, so sigma left out the noise of the dark frame."""
    dark = dark_of(frames_v(1))
    assert dark.quality()["noise_v"] == pytest.approx(2 * NOISE_V)
    assert dark.offset_stderr_v() == pytest.approx((2 * NOISE_V,) * 2)
    assert not dark.hot.any()


def test_mean_and_variance_are_those_of_numpy_whatever_the_offset() -> None:
    frames = frames_v(7) + 1e3
    mean = mean_of(frames)
    np.testing.assert_allclose(mean.volts, frames.mean(axis=0), rtol=1e-14)
    assert mean.variance is not None
    np.testing.assert_allclose(mean.variance, frames.var(axis=0, ddof=1), rtol=1e-5)


@pytest.mark.parametrize(
    ("fault", "defect"),
    [("offset", Defect.OFFSET), ("noise", Defect.NOISE), ("stuck", Defect.DEAD), ("nan", Defect.NOT_FINITE)],
)
def test_a_bad_pixel_is_found_and_no_other(fault: str, defect: Defect) -> None:
    frames = frames_v(20)
    spot = (..., 12, 34)
    if fault == "offset":
        frames[:, 1, 0, 12, 34] += 0.2
    elif fault == "noise":
        frames[:, 0, 1, 12, 34] += np.random.default_rng(3).normal(0.0, 10 * NOISE_V, 20)
    elif fault == "stuck":
        frames[spot] = offsets_v()[spot]
    else:
        frames[5, 0, 0, 12, 34] = np.nan
    dark = dark_of(frames)
    assert dark.defects[12, 34] & defect
    assert dark.hot.sum() == 1


@pytest.mark.parametrize(("deviations", "hot"), [(0.0, 0), (7.0, 0), (-7.0, 0), (9.0, 1), (-9.0, 1)])
def test_an_offset_is_an_outlier_beyond_eight_standard_deviations_of_the_array(deviations: float, hot: int) -> None:
    """Gaussian offsets of 4 × 1200 pixels reach about 4 standard deviations; none of these is hot."""
    offsets = np.random.default_rng(5).normal(0.01, 0.002, SHAPE)
    offsets[1, 0, 12, 34] = np.median(offsets[1, 0]) + deviations * 0.002
    noise = np.random.default_rng(6).normal(0.0, NOISE_V, (20, *SHAPE))
    dark = dark_of(offsets + noise)
    assert dark.hot.sum() == hot
    assert dark.defects[12, 34] == (Defect.OFFSET if hot else 0)
    assert dark.defect_counts() == {"offset": hot, "noise": 0, "dead": 0, "not_finite": 0}


@pytest.mark.parametrize(("ratio", "defect"), [(1.7, 0), (2.6, Defect.NOISE), (0.6, 0), (0.35, Defect.DEAD)])
def test_noise_is_an_outlier_beyond_twice_or_below_half_that_of_the_array(ratio: float, defect: int) -> None:
    """From 400 frames a standard deviation is known to 1/30, so that the ratio decides and not chance."""
    frames = np.random.default_rng(7).normal(0.0, NOISE_V, (400, 2, 2, 6, 8))
    frames[:, 1, 1, 2, 3] *= ratio
    dark = dark_of(frames)
    assert dark.defects[2, 3] == defect
    assert dark.hot.sum() == (defect != 0)
    assert dark.noise_v[0, 0].mean() == pytest.approx(NOISE_V, rel=0.02)


@pytest.mark.parametrize(("ratio", "defect"), [(20.5, 0), (21.0, Defect.NOISE), (1.1e-9, 0), (0.9e-9, Defect.DEAD)])
def test_a_variance_from_three_frames_is_an_outlier_only_if_its_probability_is_below_1e_9(
    ratio: float, defect: int
) -> None:
    """The variance from three frames has an exponential distribution whose median is ln 2 times its mean.

    It exceeds −ln 1e-9 = 20.7 times its mean with the probability 1e-9, and is below 1e-9 of its mean with the same.
    """
    variance = np.full((2, 2, 6, 8), np.log(2.0) * NOISE_V**2)
    variance[1, 0, 2, 3] = ratio * NOISE_V**2
    mean = MeanVolts(np.zeros(variance.shape), variance, 3)
    assert fitted(mean).defects[2, 3] == defect


def test_few_frames_make_no_outliers_by_chance() -> None:
    """From three frames, one pixel in ten has a ninth of the true variance or less by chance: these are no outliers."""
    frames = np.random.default_rng(8).normal(0.0, NOISE_V, (3, 2, 2, 100, 100))
    assert not dark_of(frames).hot.any()


def test_quality_figures_are_those_of_the_sound_pixels() -> None:
    frames = frames_v(16)
    frames[:, 1, 0, 12, 34] += 0.5
    dark = dark_of(frames)
    quality = dark.quality()
    sound = np.ones(SHAPE[2:], np.bool_)
    sound[12, 34] = False
    mean = frames.mean(axis=0)[:, :, sound]
    assert quality["offset_mean_v"] == pytest.approx(mean.mean(), rel=1e-4)
    assert quality["offset_std_v"] == pytest.approx(mean.std(), rel=1e-4)
    assert quality["noise_v"] == pytest.approx(NOISE_V, rel=0.04)
    assert quality["offset_stderr_v"] == pytest.approx(quality["noise_v"] / 4.0)


@pytest.mark.parametrize("frames", [2, 3, 5, 20])
def test_the_noise_of_a_frame_is_unbiased_from_any_number_of_frames(frames: int) -> None:
    """The median of the standard deviations from two frames is .67 of the true one, and must be corrected."""
    dark = dark_of(frames_v(frames, seed=frames))
    assert dark.quality()["noise_v"] == pytest.approx(NOISE_V, rel=0.04)


def test_a_saturated_dark_frame_marks_its_pixel() -> None:
    frames = frames_v(3)
    frames[1, 0, 0, 4, 5] = 0.5
    dark = dark_of(frames, Voltage(saturated_counts=(-0.4, 0.4)))
    assert np.argwhere(dark.hot).tolist() == [[4, 5]]
    assert dark.defects[4, 5] & Defect.NOT_FINITE


def test_whole_numbers_need_volts_per_count() -> None:
    with pytest.raises(SettingsError, match="set volts_per_count and zero_counts under"):
        mean_volts([np.zeros(SHAPE, np.uint16)], voltage=Voltage())


@pytest.mark.parametrize(
    ("centre_v", "off_v", "outlier"),
    [(0.0, 0.9e-12, False), (0.0, 1.1e-12, True), (0.5, 4e-7, False), (0.5, 6e-7, True)],
)
def test_without_noise_rounding_makes_no_outlier(centre_v: float, off_v: float, outlier: bool) -> None:
    """Without noise, a pixel may differ by 10⁻¹² V, or by 10⁻⁶ of the common offset: eight steps of a float32."""
    frames = np.full((3, *SHAPE), centre_v)
    frames[:, 0, 0, 4, 5] += off_v
    assert dark_of(frames).hot.sum() == outlier


def test_an_infinite_value_marks_its_pixel_and_no_other() -> None:
    frames = frames_v(5)
    frames[2, 1, 0, 12, 34] = np.inf
    dark = dark_of(frames)
    assert np.argwhere(dark.hot).tolist() == [[12, 34]]
    assert dark.defects[12, 34] == Defect.NOT_FINITE


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_frames_without_a_sound_pixel_are_refused(value: float) -> None:
    with pytest.raises(SettingsError, match="no pixel"):
        dark_of(np.full((3, *SHAPE), value))


def counts_of(frames: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return voltages as counts; NOISE_V is nine counts."""
    return np.rint(8192.0 + frames / (NOISE_V / 9.0)).astype(np.uint16)


VOLTAGE = Voltage(volts_per_count=NOISE_V / 9.0, zero_counts=8192.0)


@pytest.mark.parametrize("count", [2, 3, 4, 20])
def test_pixels_that_hold_one_count_in_few_frames_by_chance_are_not_dead(count: int) -> None:
    mean = mean_of(counts_of(frames_v(count)), VOLTAGE)
    assert mean.variance is not None
    assert (mean.variance == 0.0).any() == (count < 4)
    assert not fitted(mean).hot.any()


@pytest.mark.usefixtures("no_memory_for_scipy")
def test_too_little_memory_to_tell_dead_pixels_is_told_and_not_waited_for() -> None:
    with pytest.raises(MemoryError):
        tells_dead(mean_of(counts_of(frames_v(1)), VOLTAGE))


@pytest.mark.parametrize(("count", "is_dead"), [(4, False), (5, True)])
def test_a_pixel_of_one_count_is_dead_if_there_are_too_many_frames_for_chance(count: int, is_dead: bool) -> None:
    """With a noise of nine counts, n frames agree by chance with a probability of (1/(9·√(2π)))^(n − 1)/√n.

    Of 4800 channels, .2 are expected to agree in 4 frames, and .008 in 5.
    """
    frames = frames_v(count)
    frames[:, 1, 0, 12, 34] = frames[0, 1, 0, 12, 34]
    mean = mean_of(counts_of(frames), VOLTAGE)
    assert fitted(mean).hot.sum() == is_dead
    assert tells_dead(mean) == is_dead


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.3, 0.43])
def test_pixels_are_sound_and_offsets_known_to_half_a_count_if_counts_are_coarser_than_the_noise(share: float) -> None:
    """With a noise of a fifth of a count, 85 % of sound pixels were called dead or noisy. With a tenth, all offsets were
    said to be exact, though they are off by up to half a count."""
    step = NOISE_V / share
    dark = dark_of(
        np.rint(frames_v(20) / step + 128.0).astype(np.uint8), Voltage(volts_per_count=step, zero_counts=128.0)
    )
    assert not dark.hot.any()
    off = float((dark.offset_v - offsets_v()).std())
    # an array of few different counts shows little noise, so the error may be thought to be larger than it is
    assert 0.9 * off < dark.quality()["offset_stderr_v"] < 2.5 * off
    assert np.all(np.array(dark.offset_stderr_v()) > 0.5 * off)


def test_dark_frames_of_coarse_counts_with_one_frame_are_known_to_their_rounding() -> None:
    step = 30.0 * NOISE_V
    counts = np.rint(frames_v(1) / step + 128.0).astype(np.uint8)
    dark = dark_of(counts, Voltage(volts_per_count=step, zero_counts=128.0))
    assert dark.quality()["noise_v"] == pytest.approx(step / np.sqrt(12.0))


def test_dead_pixels_are_told_if_volts_fall_with_counts() -> None:
    step = -NOISE_V / 9.0
    counts = np.rint(frames_v(20) / step + 8192.0)
    counts[:, 1, 0, 12, 34] = counts[0, 1, 0, 12, 34]
    dark = dark_of(counts.astype(np.uint16), Voltage(volts_per_count=step, zero_counts=8192.0))
    assert dark.defects[12, 34] & Defect.DEAD
    assert dark.hot.sum() == 1


@pytest.mark.parametrize("frames", [2, 3, 5])
def test_dead_pixels_are_told_if_at_most_a_tenth_of_a_channel_holds_one_count_by_chance(frames: int) -> None:
    """With a noise of σ counts, far above 1, n frames agree by chance with a probability of (1/(σ·√(2π)))^(n − 1)/√n."""
    channels = {2: 4, 3: 120, 5: 90_000}[frames]
    limit = (channels / 0.1 / np.sqrt(frames)) ** (1.0 / (frames - 1)) / np.sqrt(2.0 * np.pi)
    assert limit > 6.0
    for noise, told in ((0.98 * limit, False), (1.02 * limit, True)):
        # half of all sample variances lie below this one; rounding adds a twelfth
        variance = stats.chi2.median(frames - 1) / (frames - 1) * (noise**2 + 1.0 / 12.0)
        volts = np.zeros((1, 2, 1, channels // 2))
        assert tells_dead(MeanVolts(volts, np.full_like(volts, variance), frames, step=1.0)) is told
