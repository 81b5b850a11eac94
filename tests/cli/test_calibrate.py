"""`cadtof calibrate` and `resolve --calibration`: what a user sees when something does not fit."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.support.campaign import ALL_DEFECTS, Campaign, camera, card, record_campaign, write
from tests.support.run_cadtof import ROOT, cadtof


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return record_campaign(tmp_path_factory.mktemp("campaign"), camera(ALL_DEFECTS))


@pytest.fixture(scope="module")
def calibrated(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calibration") / "camera"
    for step in (("dark", campaign.dark), ("response", *campaign.targets), ("petzval", *campaign.walls)):
        done = cadtof("calibrate", *step, "-o", out)
        assert done.status == 0, done.err
    return out


def test_petzval_toml_holds_what_the_design_promises(calibrated: Path) -> None:
    document = tomllib.loads((calibrated / "petzval.toml").read_text())
    assert {"k2_m", "k4_m", "k2_stderr_m", "k4_stderr_m"} <= document["coefficients"].keys()
    assert {"rms_before_m", "rms_after_m"} <= document["residual"].keys()
    found = document["coefficients"]
    assert abs(found["k2_m"] - 0.06) < 3 * found["k2_stderr_m"]
    assert abs(found["k4_m"] + 0.02) < 3 * found["k4_stderr_m"]
    assert document["residual"]["rms_after_m"] < 0.2 * document["residual"]["rms_before_m"]


def test_petzval_of_a_camera_without_other_defects(tmp_path: Path) -> None:
    """Without dark and response parts there is no noise of theirs, and nothing is divided by it."""
    done = cadtof("calibrate", "petzval", ROOT / "sample_data" / "wall", "-o", tmp_path / "camera", "--quiet")
    assert (done.status, done.err) == (0, "")
    assert "used" not in tomllib.loads((tmp_path / "camera" / "petzval.toml").read_text())


def test_a_part_is_not_replaced_unasked(campaign: Campaign, calibrated: Path) -> None:
    before = (calibrated / "dark.toml").read_bytes()
    done = cadtof("calibrate", "dark", campaign.dark, "-o", calibrated)
    assert done.status == 2
    assert "dark" in done.err
    assert "--overwrite" in done.err
    assert (calibrated / "dark.toml").read_bytes() == before


def test_resolve_applies_says_and_records_the_calibration(campaign: Campaign, calibrated: Path, tmp_path: Path) -> None:
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=2, seed=3))
    done = cadtof("resolve", frames, "-o", tmp_path / "maps", "--calibration", calibrated)
    assert done.status == 0, done.err
    assert "applied dark" in done.err
    assert "petzval (k2 = " in done.err
    record = json.loads((tmp_path / "maps" / "run.json").read_text())["calibration"]
    assert set(record["applied"]) == {"dark", "response", "petzval"}
    assert record["digest"]


def test_a_calibration_of_another_array_is_refused(calibrated: Path, tmp_path: Path) -> None:
    other = camera(pixels=(24, 32))
    frames = write(tmp_path / "other", other, card(other, count=1, seed=3))
    done = cadtof("resolve", frames, "-o", tmp_path / "maps", "--calibration", calibrated)
    assert done.status == 2
    assert "does not belong" in done.err
    assert "32 × 24 pixels" in done.err
    assert "80 × 60 pixels" in done.err
    assert not (tmp_path / "maps" / "run.json").exists()


def test_a_calibration_of_another_waveform_is_refused(campaign: Campaign, calibrated: Path, tmp_path: Path) -> None:
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=1, seed=3))
    done = cadtof("resolve", frames, "-o", tmp_path / "m", "--calibration", calibrated, "--waveform", "triangle")
    assert done.status == 2
    assert "waveform" in done.err


@pytest.mark.parametrize(("part", "damage"), [("dark.toml", "[what"), ("petzval.toml", "k2_m = 'much'")])
def test_a_damaged_folder_is_named(
    campaign: Campaign, calibrated: Path, tmp_path: Path, part: str, damage: str
) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    for path in calibrated.iterdir():
        (broken / path.name).write_bytes(path.read_bytes())
    (broken / part).write_text(damage)
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=1, seed=3))
    done = cadtof("resolve", frames, "-o", tmp_path / "m", "--calibration", broken)
    assert done.status == 2
    assert part in done.err
    assert "Traceback" not in done.err


def test_no_folder_and_no_part_are_said(campaign: Campaign, tmp_path: Path) -> None:
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=1, seed=3))
    (tmp_path / "empty").mkdir()
    for folder in ("nowhere", "empty"):
        done = cadtof("resolve", frames, "-o", tmp_path / "m", "--calibration", tmp_path / folder)
        assert done.status == 2
        assert folder in done.err


def test_a_response_needs_to_know_the_distance(campaign: Campaign, tmp_path: Path) -> None:
    unknown = write(tmp_path / "target", campaign.seen, [np.full((2, 2, 60, 80), 9000, np.uint16)])
    done = cadtof("calibrate", "response", unknown, "-o", tmp_path / "camera")
    assert done.status == 2
    assert "distance" in done.err
    assert not (tmp_path / "camera" / "response.toml").exists()
