"""Frames of known light, stored correctly or changed by a program; values that cannot be voltages get a likely cause."""

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Voltage
from cadtof_cli.doubts.causes import range_of
from cadtof_cli.doubts.pixels import FEWEST
from cadtof_cli.doubts.plausible import Copies, implausible

AMPLITUDE_V = 0.2746
ZERO, STEP = 8192.0, 6e-5
COUNTS = Voltage(zero_counts=ZERO, volts_per_count=STEP)


def volts(share: float = 0.4, *, pixels: int = 4000, seed: int = 1) -> NDArray[np.float64]:
    """Return voltages, (2, 2, n), of phasors with `share` of the modulation amplitude and random phases."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (2, pixels))
    return share * AMPLITUDE_V * np.stack([np.cos(phase), np.sin(phase)], axis=1)


def counts(share: float = 0.4) -> NDArray[np.uint16]:
    return np.rint(volts(share) / STEP + ZERO).astype(np.uint16)


def refusal(stored: NDArray[np.generic], voltage: Voltage | None = None, n_av: float | None = None) -> str | None:
    modulation = Modulation(amplitude_v=AMPLITUDE_V)
    return implausible(
        stored,
        CaptureMetadata(modulation=modulation, voltage=voltage or Voltage(), pixel=Pixel(integration_length=n_av)),
    )


def refused(stored: NDArray[np.generic], voltage: Voltage | None = None, n_av: float | None = None) -> str:
    message = refusal(stored, voltage, n_av)
    assert message is not None
    return message


@pytest.mark.parametrize("share", [0.01, 0.4, 1.0, 1.3])
def test_phasors_up_to_the_modulation_amplitude_and_offsets_are_accepted(share: float) -> None:
    assert refusal(volts(share)) is None
    assert refusal(counts(share), COUNTS) is None


@pytest.mark.parametrize(("n_av", "share"), [(None, 1.4), (1e5, 1.4), (50.0, 1.75)])
def test_phasors_longer_than_offsets_and_noise_allow_are_refused(n_av: float | None, share: float) -> None:
    message = refused(volts(share), n_av=n_av)
    assert f"beyond modulation.amplitude_v = {AMPLITUDE_V:g} V" in message


def test_the_message_tells_the_voltages_without_a_few_outliers() -> None:
    stored = volts(3.0)
    stored[0, 0, :10] = 1e3
    assert "which would be voltages up to 0.8237 V, beyond modulation.amplitude_v = 0.2746 V" in refused(stored)


def test_short_averages_are_noisier_and_may_exceed_the_amplitude_by_more() -> None:
    """At n_av 50 the standard deviation of a channel is .07 of the modulation amplitude."""
    assert refusal(volts(1.65), n_av=50.0) is None
    assert refusal(volts(1.65), n_av=1e5) is not None


@pytest.mark.parametrize(("bad", "refused"), [(0.2, False), (0.3, True)])
@pytest.mark.parametrize("harmonic", [0, 1])
def test_a_quarter_of_the_pixels_may_be_broken(harmonic: int, bad: float, refused: bool) -> None:
    stored = volts()
    stored[harmonic, :, : int(bad * stored.shape[2])] = 1.0
    assert (refusal(stored) is not None) == refused


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_counts_scaled_to_one_do_not_pass_for_volts(dtype: type[np.floating]) -> None:
    """14 bits in a file of 16 are then .12 at 0 V, less than the modulation amplitude: depths would be a metre off."""
    scaled = (counts() / 65535.0).astype(dtype)
    scaled[0, 0, :9] = np.nan
    message = refusal(scaled)
    assert message is not None
    assert "look scaled to 0 … 1, as ImageMagick writes floats" in message
    # the settings that the message names help, also if the values are volts; so do values that are no such multiples
    assert refusal(scaled, Voltage(zero_counts=ZERO / 65535.0, volts_per_count=STEP * 65535.0)) is None
    assert refusal(scaled, Voltage(volts_per_count=1.0)) is None
    assert refusal(np.abs(volts()).astype(dtype)) is None


@pytest.mark.parametrize(("bits", "full"), [(10, 1023), (10, 4095), (12, 4095), (12, 16383), (8, 1023), (8, 255)])
def test_counts_scaled_by_the_largest_value_of_other_bits_do_not_pass_for_volts(bits: int, full: int) -> None:
    zero, step = 2.0 ** (bits - 1), 0.98 / 2**bits
    scaled = (np.rint(volts() / step + zero) / full).astype(np.float32)
    assert f"multiples of 1/{full if full != 255 else 65535}: they look scaled to 0 … 1" in refused(scaled)
    if full == 2**bits - 1:
        # advice for other values would lead to a frame of nearly 0 V
        assert "they look scaled to 0 … 1" in refused(scaled, Voltage(zero_counts=zero, volts_per_count=step))


@pytest.mark.parametrize("full_v", [1.0, 1.024, 1.2, 1.8, 2.0, 2.5, 3.3])
@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_volts_of_a_converter_are_not_taken_for_scaled_counts(bits: int, full_v: float) -> None:
    """Near and bright, all voltages of a frame may be positive. Steps are a part of 2ⁿ, not of 2ⁿ - 1."""
    step = full_v / 2**bits
    for largest in (12.0 * step, AMPLITUDE_V / 1.5):
        stored = np.rint(np.random.default_rng(bits).uniform(0.0, largest, (2, 2, 4000)) / step) * step
        assert refusal(stored.astype(np.float32)) is None


def test_saturated_and_nan_pixels_are_left_out() -> None:
    stored = counts().astype(np.float64)
    stored[0, 0, :2000] = 16383.0
    stored[1, 1, 2000:2500] = np.nan
    limits = (0.0, 16383.0)
    assert refusal(stored, Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=limits)) is None
    assert refusal(stored, COUNTS) is not None


@pytest.mark.parametrize(
    ("stored", "voltage", "cause"),
    [
        (counts().astype(np.float32), Voltage(), "they look like counts: give --volts-per-count and --zero-counts"),
        (1000.0 * volts(), Voltage(), "they look like millivolts: give --volts-per-count 0.001"),
        (10.0 * volts(), Voltage(), "give --volts-per-count (the volts of a stored step of 1) and --zero-counts"),
        (1e6 * volts() + 0.5, Voltage(), "give --volts-per-count (the volts of a stored step of 1)"),
        (counts(), Voltage(zero_counts=0.0, volts_per_count=STEP), "zero_counts is 0 or not given"),
        (
            counts(),
            Voltage(zero_counts=ZERO, volts_per_count=0.01),
            "correct --volts-per-count, --zero-counts or --amplitude-v",
        ),
        (
            # the volts per count are in µV; and the middle of a scene is not 0 V
            counts(),
            Voltage(zero_counts=ZERO + 700.0, volts_per_count=60.0),
            "correct --volts-per-count, --zero-counts or --amplitude-v",
        ),
        (volts().astype(np.float32), COUNTS, "look like volts already: leave out zero_counts"),
        ((counts() / 65535.0).astype(np.float32), COUNTS, "; or scaled to 0 … 1, as ImageMagick writes floats"),
        (
            (counts(1.0) / 16383.0 * 255).astype(np.uint8),
            Voltage(zero_counts=32896.0, volts_per_count=STEP),
            "scaled to 8 bits",
        ),
        # each picture stretched by itself over the whole range, as MATLAB's mat2gray does
        (
            np.rint(np.interp(counts(), (counts().min(), counts().max()), (0, 255))).astype(np.uint8),
            COUNTS,
            "scaled to 8 bits",
        ),
        (
            np.rint((counts() - counts().min()) / 10).astype(np.uint16),
            COUNTS,
            "zero_counts = 8192 is far from these values: give --zero-counts",
        ),
        (
            (counts() - ZERO).astype(np.int16),
            COUNTS,
            "like counts from which the zero was subtracted: give --zero-counts 0",
        ),
        (
            (counts() + 20000).astype(np.uint16),
            COUNTS,
            "zero_counts = 8192 is far from these values: give --zero-counts (probably 32768, half of 16 bits; their middle, 28",
        ),
        (
            np.rint(counts()).astype(np.uint16) * np.uint16(4),
            COUNTS,
            "shifted by 2 bits: multiply zero_counts and saturated_counts by 4, and divide volts_per_count by 4",
        ),
        (
            counts() * 20000.0,
            Voltage(),
            "look like counts: give --volts-per-count and --zero-counts (0 V is somewhere around",
        ),
    ],
)
def test_the_message_tells_the_likely_cause(stored: NDArray[np.generic], voltage: Voltage, cause: str) -> None:
    message = refused(stored, voltage)
    assert cause in message


def test_volts_with_negative_values_are_not_called_scaled_to_1() -> None:
    message = refused(volts().astype(np.float32), COUNTS)
    assert "ImageMagick" not in message


def test_floats_from_0_to_1_that_are_too_large_for_volts_are_called_scaled() -> None:
    """Counts around 32768 of 65535 become values around .5, which are beyond 1.35 × .2746 V."""
    middle = Voltage(zero_counts=32768.0, volts_per_count=STEP)
    scaled = (np.rint(volts() / STEP + 32768.0) / 65535.0).astype(np.float32)
    with_zero = scaled.copy()
    with_zero.ravel()[::40] = 0.0
    for stored in (scaled, with_zero):
        message = refused(stored, middle)
        assert "they look scaled to 0 … 1, as ImageMagick writes floats" in message
        assert "volts already" not in message


def test_a_frame_that_is_saturated_everywhere_is_refused_with_the_cause() -> None:
    limits = Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=(4000.0, 12000.0))
    message = refusal(np.full((2, 2, 50), 12000, np.uint16), limits)
    assert message == (
        "every pixel is saturated: stored values (uint16) lie between 12000 and 12000, "
        "expected values inside saturated_counts = [4000, 12000]"
    )
    volts_of_counts = refused(volts().astype(np.float32), limits)
    assert volts_of_counts.startswith("every pixel is saturated")
    assert "look like volts already" in volts_of_counts


def test_the_range_in_the_message_leaves_out_the_outermost_percent() -> None:
    values = np.linspace(1.0, 3.0, 2001)
    message = refused(np.stack([np.roll(values, shift) for shift in range(4)]).reshape(2, 2, -1))
    assert "stored values (float64) lie between 1.02 and 2.98" in message


def test_volts_about_an_offset_with_negative_values_are_not_called_scaled_to_1() -> None:
    stored = (0.125 + 0.13 / 0.11 * volts()).astype(np.float32)
    assert stored.min() < 0.0
    message = refused(stored, COUNTS)
    assert "look like volts already" in message
    assert "ImageMagick" not in message


def test_voltages_may_fall_with_the_counts() -> None:
    falling = Voltage(zero_counts=ZERO, volts_per_count=-STEP)
    assert refusal(counts(), falling) is None
    message = refused((counts() + 20000).astype(np.uint16), falling)
    assert "zero_counts = 8192 is far from these values" in message


def test_values_of_one_sign_are_judged_by_their_magnitude() -> None:
    """The values are in mV and only positive, or only negative: a thousand times too large for volts."""
    for sign in (1.0, -1.0):
        message = refused(sign * np.abs(volts()) * 1000.0)
        assert "they look like millivolts: give --volts-per-count 0.001" in message


@pytest.mark.parametrize("pixels", [8192, 12285])
def test_large_frames_are_judged_by_some_of_their_pixels(pixels: int) -> None:
    """At least 4096 pixels, evenly spread, are looked at. Pixels between these are not."""
    stored = volts(pixels=pixels)
    stored[:, :, 1::2] = 1.0
    assert refusal(stored) is None
    stored[:, :, ::4] = 1.0
    assert refusal(stored) is not None


def equal_pixels(pixels: int) -> NDArray[np.float64]:
    return np.asarray(np.ones((2, 2, pixels)) * np.array([0.1, -0.05])[:, np.newaxis])


def test_a_large_frame_is_not_judged_by_a_few_columns() -> None:
    """As with dead columns between the banks of converters of a wide sensor."""
    frame = np.random.default_rng(1).integers(6000, 10000, (2, 2, 512, 1024), np.uint16)
    frame[1, 0, :, ::128] = 8192
    assert refusal(frame, COUNTS, 1e5) is None


def test_bytes_with_saturated_pixels_are_called_scaled_to_8_bits_too() -> None:
    """One pixel in twenty is saturated, and holds 255."""
    stored = (counts(1.0) / 16383.0 * 255).astype(np.uint8)
    stored[:, :, ::20] = 255
    message = refused(stored, Voltage(zero_counts=32896.0, volts_per_count=STEP))
    assert "scaled to 8 bits" in message


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.arange(51, dtype=np.int16), "int16) lie between 0 and 50"),
        (np.arange(51.0) / 4, "float64) lie between 0.125 and 12.375"),
    ],
)
def test_the_range_of_whole_numbers_is_printed_without_decimals(values: NDArray[np.generic], message: str) -> None:
    assert str(range_of(values)).endswith(message)


@pytest.mark.parametrize("n_av", [None, 1e5])
def test_a_frame_of_one_value_is_refused_unless_whole_numbers_may_hide_its_noise(n_av: float | None) -> None:
    assert "all pixels hold the same values" in refused(equal_pixels(100), n_av=n_av)
    stored = np.full((2, 2, 100), 8192, np.uint16)
    assert refusal(stored, Voltage(zero_counts=ZERO, volts_per_count=1e-3), n_av) is None
    assert (refusal(stored, COUNTS, n_av) is None) is (n_av is None)
    # saturated pixels do hold one value
    saturated = Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=(0.0, 8192.0))
    assert refused(stored, saturated, n_av).startswith("every pixel is saturated")


def test_frames_with_the_same_values_are_copies_of_the_first_unless_they_may_agree_by_chance() -> None:
    copies, large, small = Copies(), np.zeros((2, 2, 4, 4)), np.zeros((2, 2, 1, 3))
    assert large.size == FEWEST
    found = [
        copies.original_of(large, digest, name) for digest, name in (("x", "a"), ("y", "b"), ("x", "c"), ("x", "d"))
    ]
    assert found == [None, None, "a", "a"]
    assert [copies.original_of(small, "z", name) for name in ("e", "f")] == [None, None]


@pytest.mark.parametrize(("pixels", "is_refused"), [(64, True), (63, False)])
def test_few_pixels_may_hold_the_same_values(pixels: int, is_refused: bool) -> None:
    assert (refusal(equal_pixels(pixels)) is not None) == is_refused


@pytest.mark.parametrize("value", [4000, 12000])
def test_a_frame_at_either_limit_is_refused_though_its_phasors_are_short(value: int) -> None:
    limits = Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=(4000.0, 12000.0))
    stored = np.full((2, 2, 100), value, np.uint16)
    assert refused(stored, limits).startswith("every pixel is saturated")
    stored[:, :, :50] = counts(0.3)[:, :, :50]
    assert refusal(stored, limits) is None


def test_scaled_counts_may_hold_0() -> None:
    """As of a dead pixel, or of a picture that was stretched over the whole range."""
    scaled = (counts() / 65535.0).astype(np.float32)
    scaled[0, 0, 0] = 0.0
    assert "look scaled to 0 … 1" in refused(scaled)
