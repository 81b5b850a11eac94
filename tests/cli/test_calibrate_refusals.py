"""`cadtof calibrate` takes suitable captures, and refuses other captures with a message that names cause and cure."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.run_cadtof import ROOT, cadtof
from tests.support.wrong_targets import CASES, calibrated

SEED = 4

MESSAGES = {
    "lit: wall, offsets ± 20 mV": ("saw light", "cover the lens"),
    "lit: tilted wall, a third of that light, ± 2 mV": (
        "change together; light does that, offsets do not",
        "cover the lens",
    ),
    "lit: card with MPI, offsets ± 20 mV": ("saw light", "correct --zero-counts"),
    "response: corner at 5 distances": ("differs from the others", "plain wall"),
    "response: corner at 1 distance": ("the targets have a shape", "plain wall"),
    "response: box of .3 m before the wall, 1 distance": ("the targets have a shape", "something stands before them"),
    "response: wall that leans by 5°, 1 distance": ("do not face the camera", "Point the camera square"),
    "response: MPI by way of the floor, 1 distance": ("light comes by other ways", "clear the sides"),
    "response: one distance wrong by .1 m of 5": ("differs from the others", "measure the distance"),
    "petzval: corner": ("it is not a flat wall", "Take a plain wall"),
    "petzval: curtain": ("it is not a flat wall", "Take a plain wall"),
}

SUITABLE = (
    "dark: offsets ± 20 mV, 10 frames",
    "dark: columns of their own",
    "dark: pixels, alike in harmonics and channels",
    "response: wall at 1 distance",
    "petzval: wall with a box in view",
)


@pytest.mark.parametrize("title", MESSAGES)
def test_unsuitable_captures_are_refused(title: str, tmp_path: Path) -> None:
    done = calibrated(CASES[title], tmp_path, SEED)
    assert (done.status, done.out) == (2, "")
    for words in MESSAGES[title]:
        assert words in done.err
    assert not (tmp_path / "camera" / f"{CASES[title].step}.toml").exists()


def test_a_copy_of_a_dark_frame_is_refused(tmp_path: Path) -> None:
    """Of copies alone, the measured noise would be 0."""
    frames = [np.rint(np.random.default_rng(seed).normal(8192.0, 7.0, (2, 2, 8, 9))).astype("u2") for seed in (1, 2)]
    folder = tmp_path / "dark"
    folder.mkdir()
    (folder / "capture.toml").write_text("[voltage]\nzero_counts = 8192\nvolts_per_count = 6e-5\n")
    for index, frame in enumerate([*frames, frames[0]]):
        np.save(folder / f"{index}.npy", frame)
    done = cadtof("calibrate", "dark", folder, "-o", tmp_path / "camera")
    assert done.status == 1
    assert f"{folder / '2.npy'}: holds the same values as {folder / '0.npy'} in every pixel" in done.err


@pytest.mark.parametrize("frames", [2, 50])
def test_frames_of_one_pixel_that_agree_by_chance_are_taken(frames: int, tmp_path: Path) -> None:
    """Two frames of one pixel do not tell its noise well enough for a warning."""
    folder = tmp_path / "dark"
    folder.mkdir()
    text = "[pixel]\nintegration_length = 1e5\n[voltage]\nzero_counts = 2048\nvolts_per_count = 2.4e-4\n"
    (folder / "capture.toml").write_text(text)
    noise = np.random.default_rng(0).normal(0.0, 1.8, (frames, 2, 2, 1, 1))
    noise[1] = 3.0 + noise[0] if frames == 2 else noise[0]
    np.save(folder / "stack.npy", np.rint(2048.0 + noise).astype("u2"))
    done = cadtof("calibrate", "dark", folder, "-o", tmp_path / "camera")
    assert done.status == 0
    assert "its frames differ" not in done.err


@pytest.mark.parametrize("title", SUITABLE)
def test_suitable_captures_are_taken(title: str, tmp_path: Path) -> None:
    done = calibrated(CASES[title], tmp_path, SEED)
    assert done.status == 0, done.err
    assert (tmp_path / "camera" / f"{CASES[title].step}.toml").exists()


@pytest.mark.parametrize("name", ["wall", "corner", "card", "inter-reflection", "room"])
def test_every_sample_capture_is_too_bright_to_be_dark(name: str, tmp_path: Path) -> None:
    done = cadtof("calibrate", "dark", ROOT / "sample_data" / name, "-o", tmp_path / "camera")
    assert done.status == 2
    assert "saw light" in done.err
    assert not (tmp_path / "camera").exists()


@pytest.mark.parametrize("name", ["corner", "room"])
def test_a_sample_that_is_no_wall_has_no_field_curvature(name: str, tmp_path: Path) -> None:
    done = cadtof("calibrate", "petzval", ROOT / "sample_data" / name, "-o", tmp_path / "camera")
    assert done.status == 2
    assert "flat wall" in done.err


def _dark(folder: Path, *, seed: int = 1, size: tuple[int, int] = (8, 9)) -> Path:
    folder.mkdir()
    (folder / "capture.toml").write_text("[voltage]\nzero_counts = 8192\nvolts_per_count = 6e-5\n")
    np.save(folder / "0.npy", np.rint(np.random.default_rng(seed).normal(8192.0, 7.0, (2, 2, *size))).astype("u2"))
    return folder


@pytest.mark.parametrize(
    ("step", "size", "options", "told"),
    [
        ("dark", (8, 9), (), "found 2 captures, expected one, recorded with the lens covered"),
        ("response", (8, 7), ("--distance", 1), "other: found 7 × 8 pixels, expected 9 × 8 as in "),
        ("response", (8, 9), ("--distance", 1, "--distance", 2, "--distance", 3), "found 3 distances for 2 captures"),
    ],
)
def test_captures_that_do_not_go_together_are_refused(
    step: str, size: tuple[int, int], options: tuple[object, ...], told: str, tmp_path: Path
) -> None:
    captures = _dark(tmp_path / "one"), _dark(tmp_path / "other", seed=2, size=size)
    done = cadtof("calibrate", step, *captures, "-o", tmp_path / "camera", *options)
    assert done.status == 2
    assert told in done.err
    assert not (tmp_path / "camera").exists()


def test_covered_frames_tell_the_right_zero(tmp_path: Path) -> None:
    """Followed, the message is gone, and the zero is that with which the frames were made."""
    capture, camera = _dark(tmp_path / "one", size=(20, 20)), tmp_path / "camera"
    refused = cadtof("calibrate", "dark", capture, "-o", camera, "--zero-counts", 7500)
    assert "saw light, or zero_counts is wrong" in refused.err
    zero = refused.err.rpartition("their median is ")[2].strip()
    assert abs(float(zero) - 8192.0) < 1.0
    assert cadtof("calibrate", "dark", capture, "-o", camera, "--zero-counts", zero).status == 0


def test_optics_in_another_unit_are_told_once_before_the_walls_are_blamed(tmp_path: Path) -> None:
    walls = [ROOT / "sample_data" / "wall", tmp_path / "other"]
    shutil.copytree(walls[0], walls[1])
    done = cadtof("calibrate", "petzval", *walls, "-o", tmp_path / "camera", "--principal-point-px", "0.5,0.5")
    told = "optics.principal_point_px = 0.5, 0.5 lies in a corner of the frame: is the value a share"
    assert [line.startswith(f"warning: {walls[0]}: ") for line in done.err.splitlines() if told in line] == [True]
