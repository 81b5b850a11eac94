"""Runs and calibrations of 0.1.0: their records lack what later versions write, and no command takes them for something else."""

import json
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.calibration.dark import DarkCalibration
from cadtof_cli.calibration.store import load_calibration, save_part
from cadtof_cli.capture.metadata import CaptureMetadata
from tests.support.calibrations import made_up_calibration
from tests.support.captures import Recorded, record
from tests.support.run_cadtof import cadtof

ADDED_LATER = ("files", "digest", "output_bytes", "output_digest", "diffuse")
"""Keys of `frames.jsonl` that 0.1.0 does not write."""


def _as_of_0_1_0(out: Path) -> None:
    """Take out of the records of a run what 0.1.0 did not write."""
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    for line in lines:
        for key in ADDED_LATER:
            line.pop(key)
    (out / "frames.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    run = json.loads((out / "run.json").read_text()) | {"cadtof": "0.1.0"}
    run.pop("shared_folder")
    for key in ("absolute_inputs", "inputs_from_out"):
        run["arguments"].pop(key)
    if run["calibration"]:
        run["calibration"] = {key: run["calibration"][key] for key in ("folder", "digest")}
    (out / "run.json").write_text(json.dumps(run))


@pytest.fixture
def capture(tmp_path: Path) -> Recorded:
    return record(tmp_path / "capture", frames=3)


def test_no_map_stays_of_a_run_that_is_overwritten(capture: Recorded, tmp_path: Path) -> None:
    """Its lines hold no sizes. Maps that stayed were counted by `evaluate`."""
    out = tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    _as_of_0_1_0(out)
    (out / "frame_2.tif").write_text("mine")
    capture.files[2].unlink()
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--overwrite", "--format", "exr").status == 0
    left = sorted(path.name for path in out.iterdir())
    assert left == ["frame_0.exr", "frame_1.exr", "frame_2.tif", "frames.jsonl", "run.json"]


def test_the_calibration_of_a_run_is_found(capture: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """0.1.0 recorded only the folder as it was typed. The folder of the run was taken in its place."""
    monkeypatch.chdir(tmp_path)
    made_up = made_up_calibration(CaptureMetadata(), (24, 32), ("dark",))
    for part in made_up.parts:
        save_part(Path("camera"), part)
    assert cadtof("resolve", "capture", "-o", "out", "-j", 1, "--calibration", "camera").status == 0
    expected = cadtof("evaluate", "out", "--truth", "out/frame_0.tif", "--json")
    _as_of_0_1_0(Path("out"))
    done = cadtof("evaluate", "out", "--truth", "out/frame_0.tif", "--json")
    assert (done.out, done.err) == (expected.out, "")
    assert json.loads(done.out)["first_phasor"] is not None


@pytest.mark.parametrize("focal_px", [28.0, 35.0])
def test_maps_of_several_captures_have_the_optics_that_all_of_them_have(focal_px: float, tmp_path: Path) -> None:
    """0.1.0 put the maps of all captures into OUT itself. A point cloud of the second had the optics of the first."""
    first, out = record(tmp_path / "a"), tmp_path / "out"
    text = (first.folder / "capture.toml").read_text()
    second = record(tmp_path / "b", seed=1, toml=text.replace("= 28.0", f"= {focal_px}"))
    second.files[0].rename(second.folder / "later.tif")
    assert cadtof("resolve", first.folder, second.folder, "-o", out, "-j", 1, "-q").status == 0
    _as_of_0_1_0(out)
    lines = out / "frames.jsonl"
    lines.write_text(lines.read_text().replace("out/a/", "out/").replace("out/b/", "out/"))
    for file in [*out.glob("*/*.tif")]:
        file.rename(out / file.name)
        file.parent.rmdir()
    done = cadtof("export", out / "later.tif", "-o", tmp_path / "later.ply")
    assert (done.status == 0) == (focal_px == 28.0)
    assert ("focal" in done.err) == (focal_px != 28.0)


def test_a_dark_part_without_noise_is_named(capture: Recorded, tmp_path: Path) -> None:
    """0.1.0 recorded a noise of 0 if there was one dark frame, and sigma left out the noise of that frame."""
    camera = tmp_path / "camera"
    dark = made_up_calibration(CaptureMetadata(), (24, 32), ("dark",)).dark
    assert dark is not None
    figures = dict.fromkeys(dark.quality(), 0.0)
    save_part(camera, DarkCalibration(dark.origin, dark.offset_v, np.zeros_like(dark.noise_v), dark.defects, figures))
    (message,) = load_calibration(camera).stale()
    assert message.startswith("the dark calibration holds no noise")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--calibration", camera)
    assert f"warning: {camera}: {message}\n" in done.err
    assert cadtof("info", camera).err == f"wrong: {message}\n"
