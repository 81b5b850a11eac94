"""Planes in another order cause one warning per capture. Planes that were not recorded fail their frame alone."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli import read_frames
from tests.support.captures import Recorded, record, write_pages
from tests.support.run_cadtof import cadtof
from tests.support.wrong_targets import CASES, calibrated


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return record(tmp_path / "capture", frames=3)


def test_swapped_channels_are_reported_once(
    recorded: Recorded, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sound = cadtof("resolve", recorded.folder, "-o", tmp_path / "sound", "--jobs", "1")
    assert "the phases of the harmonics" not in sound.err
    assert cadtof("info", recorded.folder, "--jobs", "1").status == 0
    for file in recorded.files:
        write_pages(file, tifffile.imread(file)[[1, 0, 3, 2]])
    done = cadtof("resolve", recorded.folder, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 0
    (warning,) = (line for line in done.err.splitlines() if "the phases of the harmonics" in line)
    assert warning.startswith(f"warning: {recorded.folder}: the phases of the harmonics fit each other in only ")
    assert "; with SC1 and SC2 swapped, they would in " in warning
    assert warning.endswith(": are the planes in the order H1.SC1, H1.SC2, H2.SC1, H2.SC2, and are their signs right?")
    info = cadtof("info", recorded.folder, "--jobs", "1")
    assert info.status == 1
    assert "with SC1 and SC2 swapped, they would" in info.err
    assert "(and 2 more frames)" in info.err
    # the maps are counted, not named again
    assert f"{tmp_path / 'maps'}: 3 more maps: are the planes in the order H1.SC1, " in done.err
    with caplog.at_level(logging.WARNING, "cadtof_cli"):
        list(read_frames(recorded.folder))
    assert "with SC1 and SC2 swapped, they would" in caplog.text


def test_planes_that_are_swapped_in_later_frames_are_told(tmp_path: Path) -> None:
    """The warning of a run is of one frame, the first. Maps of swapped channels were metres off in later frames, in silence."""
    recorded, words = record(tmp_path / "capture", frames=7), "with SC1 and SC2 swapped, they would in "
    for file in recorded.files[2:]:
        write_pages(file, tifffile.imread(file)[[1, 0, 3, 2]])
    out = tmp_path / "maps"
    done = cadtof("resolve", recorded.folder, "-o", out, "--jobs", "1")
    assert done.status == 0
    assert "warning: " not in done.err
    told = [line for line in done.err.splitlines() if words in line]
    assert [line.partition(": ")[0] for line in told] == [str(out / f"frame_{place}.tif") for place in (2, 3, 4)]
    assert f"{out}: 2 more maps: are the planes in the order H1.SC1, " in done.err
    reasons = [json.loads(line)["reason"] or "" for line in (out / "frames.jsonl").read_text().splitlines()]
    assert [words in reason for reason in reasons] == [False] * 2 + [True] * 5
    assert words not in cadtof("resolve", recorded.folder, "-o", tmp_path / "one", "--jobs", "1", "--order", "1").err


def test_a_warning_about_one_capture_does_not_hide_frames_of_another(tmp_path: Path) -> None:
    """Frames of the capture that the warning names are only counted. Later frames of the other one are named."""
    first, other = (record(tmp_path / name, frames=3) for name in ("first", "other"))
    for file in (*first.files, *other.files[1:]):
        write_pages(file, tifffile.imread(file)[[1, 0, 3, 2]])
    done = cadtof("resolve", first.folder, other.folder, "-o", tmp_path / "maps", "--jobs", "1")
    told = [line.partition(": ")[0] for line in done.err.splitlines() if "with SC1 and SC2 swapped, they would" in line]
    assert told == ["warning", *(str(tmp_path / f"maps/other/frame_{place}.tif") for place in (1, 2))]
    assert f"{tmp_path / 'maps'}: 3 more maps: are the planes in the order" in done.err


def test_noise_that_the_settings_do_not_explain_is_reported_where_noise_may_look_like_paths(
    recorded: Recorded, tmp_path: Path
) -> None:
    def told(*options: object) -> list[str]:
        done = cadtof("resolve", recorded.folder, "-o", tmp_path / "maps", "--overwrite", "--jobs", "1", *options)
        assert done.status == 0
        return [line for line in done.err.splitlines() if "neighbouring pixels scatter as with" in line]

    (warning,) = told("--integration-length", "1e7")
    assert warning.startswith(f"warning: {recorded.folder}: ")
    assert told() == []
    assert told("--integration-length", "1e7", "--order", "1") == []


def test_a_harmonic_that_was_stored_twice_fails_its_frame_alone(recorded: Recorded, tmp_path: Path) -> None:
    broken = recorded.files[1]
    write_pages(broken, tifffile.imread(broken)[[0, 1, 0, 1]])
    done = cadtof("resolve", recorded.folder, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert f"failed: {broken}: H2.SC1 holds the same values as H1.SC1 in every pixel" in done.err
    assert sorted(path.name for path in (tmp_path / "maps").glob("*.tif")) == ["frame_0.tif", "frame_2.tif"]


def test_a_harmonic_that_was_not_recorded_fails_its_frame(tmp_path: Path) -> None:
    recorded = record(tmp_path / "capture")
    pages = tifffile.imread(recorded.files[0])
    pages[2:] = 8192
    write_pages(recorded.files[0], pages)
    done = cadtof("resolve", recorded.folder, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert (
        "frame_0.tif: H2.SC1 holds 8192 in every pixel, but the values of other planes differ: this plane was not recorded"
        in done.err
    )


def test_a_response_of_swapped_channels_is_doubted(tmp_path: Path) -> None:
    """With one distance, phases of the camera explain swapped channels; its field would then curve the other way."""
    case = CASES["response: wall at 1 distance"]
    sound = calibrated(case, tmp_path, 4)
    assert (sound.status, "the phases of the harmonics" in sound.err) == (0, False)
    (folder,) = {file.parent for file in tmp_path.glob("*/*.tif") if "dark" not in file.parent.name}
    for file in folder.glob("*.tif"):
        write_pages(file, tifffile.imread(file).reshape(4, *tifffile.imread(file).shape[-2:])[[1, 0, 3, 2]])
    done = cadtof("calibrate", "response", folder, "-o", tmp_path / "camera", "--overwrite")
    (warning,) = (line for line in done.err.splitlines() if "the phases of the harmonics" in line)
    assert warning.startswith(f"warning: {folder}: the phases of the harmonics fit each other in only ")
    assert "with SC1 and SC2 swapped" in warning


def test_a_frame_of_one_value_is_wrong_for_info_as_for_resolve(recorded: Recorded, tmp_path: Path) -> None:
    shape = tifffile.imread(recorded.files[0]).shape
    write_pages(recorded.files[0], np.full(shape, 9000, np.uint16))
    looked = cadtof("info", recorded.folder, "--jobs", "1")
    assert looked.status == 1
    assert looked.err == (
        f"wrong: {recorded.files[0]}: all pixels hold the same values, but noise makes pixels differ: the frame was not "
        "recorded\n"
    )
    done = cadtof("resolve", recorded.folder, "-o", tmp_path / "maps", "--jobs", "1")
    assert done.status == 1
    assert f"failed: {recorded.files[0]}: all pixels hold the same values, but noise makes pixels differ" in done.err
    # a mean leaves it out: a frame that the camera dropped would lower all amplitudes and offsets
    done = cadtof("resolve", recorded.folder, "-o", tmp_path / "mean", "--jobs", "1", "--average", 2)
    assert f"1 of 2 frames left out of the mean: {recorded.files[0]}: all pixels hold the same values" in done.err
    done = cadtof("calibrate", "dark", recorded.folder, "-o", tmp_path / "camera")
    assert (done.status, f"{recorded.files[0]}: all pixels hold the same values" in done.err) == (1, True)
