"""Frames that may be recordings but likely have a fault: values cut off, a dark plane, height and width swapped."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli import read_frames
from cadtof_cli.calibration.store import Calibration
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Voltage
from cadtof_cli.doubts.camera import cut_off
from cadtof_cli.doubts.frame import doubt_of_planes, doubts, doubts_before_run
from cadtof_cli.doubts.pixels import FEWEST
from cadtof_cli.doubts.planes import sheared, wrong_planes
from cadtof_cli.pipeline.plan import CalibrationUse, FramePlan

ZERO, STEP = 8192.0, 6e-5
COUNTS = Voltage(zero_counts=ZERO, volts_per_count=STEP)


def counts() -> NDArray[np.uint16]:
    """Return counts, (2, 2, 4000), of phasors with an amplitude of .11 V and random phases."""
    phase = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (2, 4000))
    return np.rint(0.11 * np.stack([np.cos(phase), np.sin(phase)], axis=1) / STEP + ZERO).astype(np.uint16)


def doubt_of_cutting(stored: NDArray[np.generic], voltage: Voltage = COUNTS) -> str | None:
    frame = stored.reshape(*stored.shape[:2], -1, 50)
    return cut_off(frame, CaptureMetadata(voltage=voltage))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("spread", [0.0, 0.3, 3.0, 300.0])
def test_values_that_are_not_cut_off_are_not_doubted(dtype: type, spread: float) -> None:
    """The noise spreads over few steps of the counts or over many; the light has one phase or all phases."""
    noise = np.random.default_rng(1).normal(0.0, spread, (2, 2, 4000))
    scale = 1 / 64 if dtype == np.uint8 else 1.0
    for light in (np.full((2, 2, 4000), 9000.0), counts().astype(np.float64)):
        assert doubt_of_cutting(np.rint((light + noise) * scale).astype(dtype)) is None


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_values_that_are_cut_off_are_doubted(dtype: type) -> None:
    stored: NDArray[np.generic] = (counts() + np.random.default_rng(1).normal(0.0, 7.0, (2, 2, 4000))).astype(dtype)
    high, low = np.minimum(stored, dtype(9500)), np.maximum(stored, dtype(7000))
    assert str(doubt_of_cutting(high)).endswith(
        "saturated_counts under [voltage] in capture.toml, or --saturated-counts LOW,9500"
    )
    share = (high == 9500).any(axis=(0, 1)).mean()
    assert str(doubt_of_cutting(high)).startswith(f"{share:.1%} of the pixels hold 9500, the largest stored value; ")
    assert " of the pixels hold 7000, the smallest stored value; " in str(doubt_of_cutting(low))
    assert str(doubt_of_cutting(low)).endswith("--saturated-counts 7000,HIGH")
    known = Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=(0.0, 9500.0))
    assert doubt_of_cutting(high, known) is None
    assert doubt_of_cutting(low, known) is not None


def test_a_few_pixels_at_the_largest_value_are_not_doubted() -> None:
    stored = (counts() + np.random.default_rng(1).normal(0.0, 7.0, (2, 2, 4000))).astype(np.uint16)
    stored[0, 0, : FEWEST - 1] = 12000
    assert doubt_of_cutting(stored) is None
    stored[1, 1, FEWEST - 1] = 12000
    assert "hold 12000, the largest" in str(doubt_of_cutting(stored))
    stored[:, :, FEWEST - 2 :] = 65535
    assert (
        doubt_of_cutting(stored, Voltage(zero_counts=ZERO, volts_per_count=STEP, saturated_counts=(0.0, 65535.0)))
        is None
    )


def slanted_wall(noise_counts: float, *, nearest: float = 0.4, farthest: float = 2.1) -> NDArray[np.uint16]:
    """Return a frame, (2, 2, 40, 60), of a wall whose fundamental phase grows from `nearest` to `farthest`, in rad."""
    phases = np.linspace(nearest, farthest, 60) * np.array([[[1.0]], [[2.0]]]) * np.ones((40, 1))
    volts = 0.15 * np.stack([np.cos(phases), np.sin(phases)], axis=1)
    noise = np.random.default_rng(4).normal(0.0, noise_counts, volts.shape)
    return np.rint(volts / STEP + ZERO + noise).astype(np.uint16)


@pytest.mark.parametrize("noise_counts", [0.0, 7.0, 100.0])
@pytest.mark.parametrize(
    ("planes", "named"), [([(1, 1)], "H2.SC2"), ([(0, 0)], "H1.SC1"), ([(1, 0), (1, 1)], "H2.SC1, H2.SC2")]
)
def test_planes_that_hold_only_noise_are_doubted(
    planes: list[tuple[int, int]], named: str, noise_counts: float
) -> None:
    stored = slanted_wall(noise_counts)
    assert wrong_planes(stored, CaptureMetadata(voltage=COUNTS)) is None
    for place in planes:
        stored[place] = np.random.default_rng(5).normal(ZERO + 30.0, max(noise_counts, 1.0), stored.shape[2:])
    doubt = wrong_planes(stored, CaptureMetadata(voltage=COUNTS))
    assert (
        doubt
        == f"{named}: found only noise, but other planes show a scene; was the modulation on when this was recorded?"
    )


def test_bad_pixels_do_not_hide_a_plane_that_holds_only_noise() -> None:
    stored = slanted_wall(7.0).astype(np.float32)
    stored[1, 1] = np.random.default_rng(5).normal(ZERO, 7.0, (40, 60))
    stored[0, 0, ::7, ::5] = np.nan
    assert str(wrong_planes(stored, CaptureMetadata(voltage=COUNTS))).startswith("H2.SC2: found only noise")


@pytest.mark.parametrize("frames", [2, 3, 4, 9])
def test_planes_of_a_stack_that_holds_all_frames_of_one_plane_first_are_doubted(frames: int) -> None:
    """Its first four planes are read as a frame: they are H1.SC1 of all frames, then perhaps H1.SC2, H2.SC1 …"""
    scene, noise = slanted_wall(7.0), np.random.default_rng(6)
    recorded = [scene + noise.integers(-9, 10, scene.shape).astype(np.uint16) for _ in range(frames)]
    first = np.stack(recorded, axis=2).reshape(4 * frames, *scene.shape[2:])[:4].reshape(scene.shape)
    metadata = CaptureMetadata(voltage=COUNTS)
    assert wrong_planes(scene, metadata) is None
    (doubt,) = doubts(first, metadata)
    assert doubt.startswith("H1.SC2 shows the same as H1.SC1, apart from noise: are both recordings of one plane")


def test_a_harmonic_that_was_recorded_at_the_period_of_another_is_doubted() -> None:
    scene = slanted_wall(7.0)
    noise = np.random.default_rng(6).integers(-9, 10, scene.shape).astype(np.uint16)
    assert str(wrong_planes(scene[:1] + noise, CaptureMetadata(voltage=COUNTS))).startswith(
        "H2.SC1 shows the same as H1.SC1"
    )


def test_a_checkerboard_at_any_distance_is_not_doubted() -> None:
    """Its planes differ in amplitude over the frame and hardly in phase. At some phases two of them are the same, or one is 0."""
    y, x = np.mgrid[:96, :128]
    amplitude = 0.05 + 0.05 * ((x // 16 + y // 16) % 2)
    noise = np.random.default_rng(8).normal(0.0, 0.004, (2, 2, 96, 128))
    for degrees in range(1, 360):
        phase = np.full(y.shape, np.radians(degrees)) + 0.0005 * x
        volts = amplitude * np.stack([[np.cos(h * phase), np.sin(h * phase)] for h in (1, 2)])
        assert doubts(volts + noise, CaptureMetadata()) == ()


@pytest.mark.parametrize("scene", ["card", "corner", "inter-reflection", "room", "wall"])
def test_planes_of_a_scene_differ_by_more_than_noise(scene: str) -> None:
    (frame,) = read_frames(Path(__file__).parents[2] / "sample_data" / scene)
    assert doubts(frame.stored, frame.metadata) == ()


def test_a_dark_plane_is_not_doubted_in_a_frame_of_noise_few_pixels_or_bad_pixels() -> None:
    noise = np.random.default_rng(5).normal(ZERO, 7.0, (2, 2, 40, 60)).astype(np.uint16)
    assert wrong_planes(noise, CaptureMetadata(voltage=COUNTS)) is None
    stored = slanted_wall(7.0).astype(np.float32)
    stored[1, 1] = noise[1, 1]
    assert wrong_planes(stored[:, :, :1, : FEWEST - 8], CaptureMetadata(voltage=COUNTS)) is None
    stored[0, 0, 1:] = np.nan
    assert wrong_planes(stored, CaptureMetadata(voltage=COUNTS)) is None


@pytest.mark.parametrize("middle", [0.0, np.pi / 2.0, np.pi, 3.0 * np.pi / 2.0])
def test_channels_that_hardly_change_over_a_scene_of_few_depths_are_not_doubted(middle: float) -> None:
    stored = slanted_wall(30.0, nearest=middle - 0.15, farthest=middle + 0.15)
    assert wrong_planes(stored, CaptureMetadata(voltage=COUNTS)) is None


def hill(height: int, width: int, *, noise_counts: float = 7.0) -> NDArray[np.uint16]:
    """Return a frame, (2, 2, Y, X), of a hill on a slanted floor."""
    y, x = np.mgrid[:height, :width] / max(height, width)
    phase = 0.6 + 1.2 * y + 0.8 * np.exp(-30.0 * ((x - 0.5) ** 2 + (y - 0.3) ** 2))
    volts = 0.1 * np.stack([[np.cos(h * phase), np.sin(h * phase)] for h in (1, 2)])
    return np.rint(volts / STEP + ZERO + np.random.default_rng(6).normal(0.0, noise_counts, volts.shape)).astype(
        np.uint16
    )


def doubt_of_lines(stored: NDArray[np.generic]) -> str | None:
    return sheared(stored, CaptureMetadata(voltage=replace(COUNTS, saturated_counts=(0.0, 16383.0))))


@pytest.mark.parametrize("noise_counts", [0.0, 7.0, 50.0])
@pytest.mark.parametrize(("height", "width"), [(60, 80), (80, 60), (45, 90)])
def test_swapped_height_and_width_are_doubted(height: int, width: int, noise_counts: float) -> None:
    stored = hill(height, width, noise_counts=noise_counts)
    assert doubt_of_lines(stored) is None
    doubt = str(doubt_of_lines(stored.reshape(2, 2, width, height)))
    assert f"if each row had {width} pixels instead of {height}: are height and width swapped" in doubt


def test_lines_of_squares_noise_slender_frames_and_bad_pixels_are_not_doubted() -> None:
    square, noise, slender = hill(60, 60), np.random.default_rng(7).integers(8000, 8400, (2, 2, 60, 80)), hill(30, 90)
    assert doubt_of_lines(square) is doubt_of_lines(noise) is None
    assert doubt_of_lines(slender) is doubt_of_lines(slender.reshape(2, 2, 90, 30)) is None
    # a floor that slants only along lines, without noise
    floor = np.broadcast_to(np.arange(60.0)[:, np.newaxis], (2, 2, 60, 120))
    assert doubt_of_lines(floor) is doubt_of_lines(floor.swapaxes(2, 3).copy()) is None
    swapped = hill(60, 80).reshape(2, 2, 80, 60)
    swapped[0, 0, 1:] = 16383
    assert doubt_of_lines(swapped) is None


def test_doubts_lists_all_faults_and_without_light_only_those_that_need_no_light() -> None:
    swapped = hill(60, 80).reshape(2, 2, 80, 60)
    swapped = np.minimum(swapped, np.uint16(np.quantile(swapped, 0.9)))
    metadata = CaptureMetadata(voltage=COUNTS)
    lines, cut = doubts(swapped, metadata)
    assert "are height and width" in lines
    assert doubts(swapped, metadata, has_light=False) == (cut,) == (cut_off(swapped, metadata),)
    dark = hill(60, 80)
    dark[1, 1] = np.random.default_rng(8).normal(ZERO, 7.0, dark.shape[2:])
    assert doubts(dark, metadata) == (wrong_planes(dark, metadata),)


def test_faults_are_doubted_in_a_frame_as_large_as_cameras_record() -> None:
    """Only some of its pixels are looked at; they must be enough to tell."""
    stored, metadata = hill(480, 640), CaptureMetadata(voltage=COUNTS)
    assert doubts(stored, metadata) == ()
    dark = stored.copy()
    dark[1, 1] = np.random.default_rng(8).normal(ZERO, 7.0, dark.shape[2:])
    faults = {
        "are height and width swapped": stored.reshape(2, 2, 640, 480),
        "H2.SC2: found only noise": dark,
        "with SC1 and SC2 swapped": stored[:, ::-1],
        "the largest stored value": np.minimum(stored, np.uint16(np.quantile(stored, 0.9))),
    }
    for words, frame in faults.items():
        assert words in doubts(frame, metadata)[0]


@pytest.mark.parametrize("noise_counts", [0.3, 0.6])
def test_planes_of_noise_are_doubted_where_rounding_hides_most_of_it(noise_counts: float) -> None:
    """Most neighbours then hold the same count. As volts, they differ by nothing, and the rest is no noise."""
    stored = slanted_wall(0.0)
    stored[1, 1] = np.rint(np.random.default_rng(5).normal(ZERO, noise_counts, (40, 60)))
    assert str(wrong_planes(stored, CaptureMetadata(voltage=COUNTS))).startswith("H2.SC2: found only noise")
    volts = (stored - ZERO) * STEP
    assert (wrong_planes(volts, CaptureMetadata()) is None) == (noise_counts < 0.5)


@pytest.mark.parametrize(("times", "is_same"), [(1.24, True), (1.36, False)])
def test_recordings_of_one_plane_may_differ_by_a_little_more_than_noise(times: float, is_same: bool) -> None:
    """An offset drifted between them: the difference is `times` as large as noise alone makes it."""
    size = (120, 160)
    rng, phases = np.random.default_rng(7), np.linspace(0.4, 2.1, 160) * np.ones((120, 1))
    shown = 0.2 * np.stack([np.cos(phases), np.sin(phases)])
    volts = np.stack([shown, shown]) + rng.normal(0.0, 1e-2, (2, 2, *size))
    volts[1] += math.sqrt(2.0 * (times**2 - 1.0)) * 1e-2
    assert (wrong_planes(volts, CaptureMetadata()) is not None) == is_same


def test_an_order_is_not_doubted_before_a_run_with_a_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its phases were measured with these planes."""
    swapped = hill(60, 80)[:, ::-1]
    metadata = CaptureMetadata(voltage=COUNTS)
    (told,) = doubts_before_run(swapped, FramePlan(metadata=metadata))
    assert "with SC1 and SC2 swapped" in told
    monkeypatch.setattr(FramePlan, "read_calibration", lambda _: Calibration())
    use = CalibrationUse(Path("is not read"), "", sine=False)
    assert doubts_before_run(swapped, FramePlan(metadata=metadata, calibration=use)) == ()


def test_a_wrong_zero_is_told_before_another_order() -> None:
    """It turns phases, and another order may then fit better. Neither is looked for if a calibration is applied."""
    stored = hill(60, 80)
    off = CaptureMetadata(voltage=replace(COUNTS, zero_counts=ZERO - 900.0))
    (told,) = doubts(stored, off)
    assert "all stored values seem to be +8" in told
    assert "0 V is probably 81" in told
    assert doubts(stored, off, of_order=False) == ()
    assert doubt_of_planes(stored, FramePlan(metadata=off)) == told
    assert doubt_of_planes(stored, FramePlan(metadata=CaptureMetadata(voltage=COUNTS))) is None
    use = CalibrationUse(Path("is not read"), "", sine=True)
    assert doubt_of_planes(stored, FramePlan(metadata=off, calibration=use)) is None


def test_what_makes_a_frame_useless_is_told_alone() -> None:
    """Planes of noise, or a stuck bit, make other orders and other zeros fit better, too."""
    metadata = CaptureMetadata(voltage=COUNTS)
    stuck = hill(60, 80) | np.uint16(256)
    (told,) = doubts(stuck, metadata)
    assert told.startswith("bit 8 (256) of all planes is 1")
    dark = hill(60, 80)
    dark[1] = np.random.default_rng(8).normal(ZERO, 7.0, dark.shape[1:])
    (told,) = doubts(dark[:, ::-1], metadata)
    assert "found only noise" in told
    assert doubt_of_planes(dark, FramePlan(metadata=metadata)) == wrong_planes(dark, metadata)


def test_a_channel_of_noise_is_told_of_one_harmonic_too() -> None:
    stored = slanted_wall(7.0)[:1]
    metadata = CaptureMetadata(modulation=Modulation(periods_ns=(40.0,)), voltage=COUNTS)
    assert wrong_planes(stored, metadata) is None
    stored[0, 1] = np.random.default_rng(5).normal(ZERO, 7.0, (40, 60))
    assert str(wrong_planes(stored, metadata)).startswith("H1.SC2: found only noise")


@pytest.mark.parametrize("degrees", [90.0, 180.0, 270.0])
@pytest.mark.parametrize("bad", [False, True])
def test_channels_that_are_0_at_the_one_distance_of_a_wall_are_recorded(degrees: float, bad: bool) -> None:
    """Light of one phase has the same amplitude at both harmonics, and may have none in one channel of each. Half of the wall
    is black; a twentieth of the pixels may be bad."""
    x = np.arange(128) * np.ones((96, 1), int)
    amplitude = 0.02 + 0.16 * (x >= 64)
    volts = np.random.default_rng(8).normal(0.0, 2e-3, (2, 2, 96, 128))
    phases = np.radians(degrees) * np.array([1.0, 2.0])
    volts += np.stack([np.cos(phases), np.sin(phases)], axis=1)[..., np.newaxis, np.newaxis] * amplitude
    if bad:
        volts[1, :, :5] = 0.0
    assert wrong_planes(volts, CaptureMetadata()) is None
    volts[0] = np.random.default_rng(9).normal(0.0, 2e-3, (2, 96, 128))
    assert str(wrong_planes(volts, CaptureMetadata())).startswith("H1.SC1, H1.SC2")


@pytest.mark.parametrize(("noise_counts", "is_told"), [(400.0, True), (1000.0, False)])
def test_a_plane_of_noise_is_told_if_others_show_more_than_noise(noise_counts: float, is_told: bool) -> None:
    """The wall changes by 1700 counts."""
    stored = slanted_wall(noise_counts)
    assert wrong_planes(stored, CaptureMetadata(voltage=COUNTS)) is None
    stored[1, 1] = np.random.default_rng(5).normal(ZERO, noise_counts, (40, 60))
    told = wrong_planes(stored, CaptureMetadata(voltage=COUNTS))
    assert (told is not None) == is_told
    assert told is None or told.startswith("H2.SC2: found only noise")


@pytest.mark.parametrize(("noise_counts", "is_told"), [(1.0, True), (0.2, False)])
def test_values_are_cut_off_if_noise_spreads_them_over_two_counts(noise_counts: float, is_told: bool) -> None:
    """With less noise, most pixels of a wall hold one count anyway."""
    stored = np.random.default_rng(1).normal(8000.0, noise_counts, (2, 2, 4000))
    stored[0, 0] = np.minimum(stored[0, 0] + 1000.0, 8999.0)
    assert (doubt_of_cutting(np.rint(stored).astype(np.uint16)) is not None) == is_told
