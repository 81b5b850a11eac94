"""`cadtof calibrate` and `resolve --calibration`: the measured values, and the messages if something does not fit."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli import read_maps
from cadtof_cli.calibration.store import load_calibration, save_part
from cadtof_cli.phasors.response import HarmonicResponse
from tests.support.calibrations import made_up_calibration
from tests.support.campaign import ALL_DEFECTS, Campaign, calibrate, camera, card, covered, record_campaign, wall, write
from tests.support.captures import record
from tests.support.defects import Defects
from tests.support.run_cadtof import ROOT, cadtof


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return record_campaign(tmp_path_factory.mktemp("campaign"), camera(ALL_DEFECTS))


@pytest.fixture(scope="module")
def calibrated(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calibration") / "camera"
    calibrate(campaign, out)
    return out


def test_petzval_toml_holds_what_the_design_promises(calibrated: Path) -> None:
    document = tomllib.loads((calibrated / "petzval.toml").read_text())
    assert {"k2_m", "k4_m", "k2_stderr_m", "k4_stderr_m"} <= document["coefficients"].keys()
    assert {"rms_before_m", "rms_after_m"} <= document["residual"].keys()
    assert document["residual"]["rms_after_m"] < 0.2 * document["residual"]["rms_before_m"]


@pytest.mark.parametrize("dark_frames", [0, 1])
def test_petzval_without_a_dark_part_or_with_one_of_a_single_frame(tmp_path: Path, dark_frames: int) -> None:
    """Without a dark part only the frames' own noise counts; with that of one frame, the predicted noise of that frame too."""
    seen = camera(Defects(petzval_m=(0.06, -0.02)))
    walls = [
        write(tmp_path / f"wall_{d:g}", seen, wall(seen, d, count=5, seed=index)) for index, d in enumerate((1.0, 3.0))
    ]
    out = tmp_path / "camera"
    if dark_frames:
        dark = write(tmp_path / "dark", seen, covered(seen, count=dark_frames))
        assert cadtof("calibrate", "dark", dark, "-o", out).status == 0
    done = cadtof("calibrate", "petzval", *walls, "-o", out)
    assert done.status == 0, done.err
    assert "Warning" not in done.err
    found = tomllib.loads((out / "petzval.toml").read_text())
    errors = found["coefficients"]
    assert abs(errors["k2_m"] - 0.06) < 3 * errors["k2_stderr_m"] < 0.02
    assert abs(errors["k4_m"] + 0.02) < 3 * errors["k4_stderr_m"] < 0.02
    if not dark_frames:
        assert found["residual"]["rms_after_m"] == pytest.approx(found["residual"]["noise_rms_m"], rel=0.05)


@pytest.mark.parametrize("frames", [1, 2])
def test_sigma_contains_the_noise_of_few_dark_frames(tmp_path: Path, frames: int) -> None:
    """The offsets of one dark frame are as noisy as the frame that they are taken from. Sigma then left this noise out."""
    seen = camera(Defects(offset_v=0.02))
    dark = write(tmp_path / "dark", seen, covered(seen, count=frames))
    lit = write(tmp_path / "wall", seen, wall(seen, 2.0, count=1, seed=5))
    done = cadtof("calibrate", "dark", dark, "-o", tmp_path / "camera")
    assert done.status == 0, done.err
    assert ("not measured but predicted from the integration length (1" in done.out) == (frames == 1)
    options = ("--mpi-model", "discrete", "--order", "1", "--calibration", tmp_path / "camera")
    assert cadtof("resolve", lit, "-o", tmp_path / "maps", *options).status == 0
    maps = read_maps(tmp_path / "maps")
    off = (maps["direct.depth"] - seen.wall_range_m(2.0)) / maps["direct.sigma"]
    assert 0.65 < np.nanmean(np.abs(off) < 1.0) < 0.72


@pytest.mark.parametrize(("frames", "left"), [(1, 0.91), (2, 0.91), (4, 1.0)])
def test_the_residual_of_a_response_is_the_noise_of_the_mean_frames(tmp_path: Path, frames: int, left: float) -> None:
    """The residual is in units of the noise of the mean frames: 1 if this noise is measured, as with four frames.

    With one or two frames, the noise is predicted for ambient light alone. At ASR 2 this is a tenth too much.
    """
    seen = camera(Defects())
    targets = [
        write(tmp_path / f"target_{index}", seen, wall(seen, d, count=frames, seed=index), distance_m=d)
        for index, d in enumerate((0.5, 1.7, 3.0))
    ]
    done = cadtof("calibrate", "response", *targets, "-o", tmp_path / "camera")
    assert done.status == 0, done.err
    quality = tomllib.loads((tmp_path / "camera" / "response.toml").read_text())["quality"]
    assert quality["residual"] == pytest.approx(left, abs=0.04)


def test_petzval_of_a_camera_without_other_defects(tmp_path: Path) -> None:
    """Without dark and response parts, no earlier part is used, and nothing is divided by the noise of one."""
    done = cadtof("calibrate", "petzval", ROOT / "sample_data" / "wall", "-o", tmp_path / "camera", "--quiet")
    assert (done.status, done.err) == (0, "")
    assert "used" not in tomllib.loads((tmp_path / "camera" / "petzval.toml").read_text())


@pytest.mark.parametrize("harmonics", [(1,), (1, 3)])
def test_harmonics_that_cannot_tell_two_paths(tmp_path: Path, harmonics: tuple[int, ...]) -> None:
    """They are calibrated for `resolve --solver one-path`, and named by their numbers, not by their places."""
    periods = ",".join(f"{40.0 / h:.6f}" for h in harmonics)
    seen = ("--periods-ns", periods, "--petzval", "0.06,-0.02", "--width", 80, "--height", 60, "--frames", 5)
    assert cadtof("simulate", "--scene", "wall", *seen, "-o", tmp_path / "wall", "--quiet").status == 0
    done = cadtof("calibrate", "petzval", tmp_path / "wall", "-o", tmp_path / "lens")
    assert done.status == 0, done.err
    found = tomllib.loads((tmp_path / "lens" / "petzval.toml").read_text())["coefficients"]
    assert abs(found["k2_m"] - 0.06) < 3 * found["k2_stderr_m"] < 0.02
    assert abs(found["k4_m"] + 0.02) < 3 * found["k4_stderr_m"] < 0.02
    done = cadtof("calibrate", "response", tmp_path / "wall", "-o", tmp_path / "camera")
    named = [line.split(":")[0] for line in map(str.strip, done.out.splitlines()) if line.startswith("harmonic ")]
    assert named == [f"harmonic {h}" for h in harmonics]


def test_a_part_is_replaced_only_with_overwrite(campaign: Campaign, calibrated: Path) -> None:
    before = (calibrated / "dark.toml").read_bytes()
    done = cadtof("calibrate", "dark", campaign.dark, "-o", calibrated)
    assert done.status == 2
    assert done.err.startswith(f"Error: {calibrated / 'dark.toml'}: already exists; add --overwrite to replace it")
    assert (calibrated / "dark.toml").read_bytes() == before


@pytest.mark.parametrize(("step", "taken"), [("dark", "dark"), ("response", "targets"), ("petzval", "walls")])
def test_a_calibration_among_recorded_frames_is_refused(campaign: Campaign, step: str, taken: str) -> None:
    """Afterwards, the files of the calibration would be taken for frames of that capture."""
    found = getattr(campaign, taken)
    captures = [found] if isinstance(found, Path) else list(found)
    before = [sorted(capture.iterdir()) for capture in captures]
    for out in (captures[-1], captures[-1] / ".." / captures[-1].name):
        done = cadtof("calibrate", step, *captures, "-o", out)
        message = f"Error: {out}: the calibration would be written among recorded frames; choose another folder with -o"
        assert (done.status, done.err.splitlines()[-1]) == (2, message)
    assert [sorted(capture.iterdir()) for capture in captures] == before


def test_a_damaged_part_is_replaced_by_repeating_its_step(campaign: Campaign, calibrated: Path, tmp_path: Path) -> None:
    out = tmp_path / "camera"
    shutil.copytree(calibrated, out)
    (out / "response.toml").write_text((out / "response.toml").read_text().replace("frames = ", "frames = 1"))
    repeated = cadtof("calibrate", "response", *map(str, campaign.targets), "-o", str(out), "--overwrite")
    assert (repeated.status, "response: from" in repeated.out) == (0, True)
    assert load_calibration(out).response is not None


def test_resolve_applies_reports_and_records_the_calibration(
    campaign: Campaign, calibrated: Path, tmp_path: Path
) -> None:
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=2, seed=3))
    done = cadtof("resolve", frames, "-o", tmp_path / "maps", "--calibration", calibrated)
    assert done.status == 0, done.err
    assert "applied dark" in done.err
    assert "petzval (k2 = " in done.err
    record = json.loads((tmp_path / "maps" / "run.json").read_text())["calibration"]
    assert set(record["applied"]) == {"dark", "response", "petzval"}
    assert record["digest"]


def test_a_calibration_that_does_not_fit_is_refused_before_anything_is_written(
    campaign: Campaign, calibrated: Path, tmp_path: Path
) -> None:
    frames = write(tmp_path / "card", campaign.seen, card(campaign.seen, count=1, seed=3))
    other = camera(pixels=(24, 32))
    small = write(tmp_path / "other", other, card(other, count=1, seed=3))
    (tmp_path / "empty").mkdir()
    for part, damage in (("dark.toml", "[what"), ("petzval.toml", "k2_m = 'much'")):
        shutil.copytree(calibrated, tmp_path / part)
        (tmp_path / part / part).write_text(damage)
    for folder, capture, message in (
        (
            calibrated,
            (small,),
            f"{small}: the dark calibration does not belong to this capture: size is 32 × 24 pixels in the capture and 80",
        ),
        (
            calibrated,
            (frames, "--waveform", "triangle"),
            "waveform is triangle in the capture and sine in the calibration",
        ),
        (tmp_path / "dark.toml", (frames,), "dark.toml: not valid TOML"),
        (tmp_path / "petzval.toml", (frames,), "petzval.toml: not a petzval calibration"),
        (tmp_path / "nowhere", (frames,), "nowhere: no such folder"),
        (calibrated / "dark.toml", (frames,), f"a file, expected the folder of a calibration, such as {calibrated}"),
        (tmp_path / "empty", (frames,), "empty: no calibration in it"),
    ):
        done = cadtof("resolve", *capture, "-o", tmp_path / "maps", "--calibration", folder)
        assert (done.status, done.out) == (2, "")
        assert message in done.err
    assert not (tmp_path / "maps").exists()


def test_a_response_with_which_the_solver_cannot_resolve_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """Every frame failed on its own, with status 1, and `--dry-run` found nothing wrong."""
    seen = camera()
    frames = write(tmp_path / "card", seen, card(seen, count=2, seed=3))
    made = made_up_calibration(seen.metadata, seen.pixels, {"response"}).response
    assert made is not None
    bent = tuple(HarmonicResponse(one.harmonic, (*one.terms, (-3, 0.01 + 0j))) for one in made.responses)
    save_part(tmp_path / "camera", replace(made, responses=bent))
    for more in ((), ("--dry-run",)):
        options = ("--solver", "lm", "--calibration", tmp_path / "camera", *more)
        done = cadtof("resolve", frames, "-o", tmp_path / "maps", *options)
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith(f"Error: {frames}: --solver lm: Eq. (9) is that of a sine")
    assert not (tmp_path / "maps").exists()


def test_frames_that_differ_by_more_than_noise_are_warned_of(campaign: Campaign, tmp_path: Path) -> None:
    """One lit frame among the dark ones makes all offsets wrong; so does an offset that drifts."""
    rng = np.random.default_rng(0)
    steady = rng.normal(8192.0, 30.0, (2, 2, 60, 80))
    still = [np.rint(steady + rng.normal(0.0, 7.0, steady.shape)).astype(np.uint16) for _ in range(10)]
    drifting = [frame + np.uint16(5 * number) for number, frame in enumerate(still)]
    lit = [*still[:9], np.rint(still[9] + rng.normal(0.0, 500.0, steady.shape)).astype(np.uint16)]
    said = "times what integration_length = 100000 explains"
    for name, frames, warned in (("still", still, False), ("drifting", drifting, True), ("lit", lit, True)):
        folder = write(tmp_path / name, campaign.seen, frames)
        done = cadtof("calibrate", "dark", folder, "-o", tmp_path / f"camera_{name}")
        assert (done.status, said in done.err) == (0, warned), done.err


def test_frames_of_another_camera_than_the_dark_frames_are_warned_of(tmp_path: Path) -> None:
    one, other = (camera(Defects(offset_v=0.005, seed=seed)) for seed in (1, 2))
    dark, out = write(tmp_path / "dark", one, covered(one, count=10)), tmp_path / "camera"
    assert cadtof("calibrate", "dark", dark, "-o", out).status == 0
    told = "its pixels do not have the offsets of the calibration, which makes depths worse"
    for name, seen in (("own", one), ("foreign", other)):
        target = write(tmp_path / name, seen, wall(seen, 1.0, count=3, seed=4), distance_m=1.0)
        for done in (
            cadtof("calibrate", "response", target, "-o", out, "--overwrite"),
            cadtof("calibrate", "petzval", target, "-o", out, "--overwrite"),
            cadtof("resolve", target, "-o", tmp_path / f"{name}_maps", "--calibration", out, "-j", 1, "--overwrite"),
        ):
            assert (f"warning: {target}: {told}" in done.err) == (name == "foreign"), done.err


@pytest.mark.parametrize("swapped", [False, True])
def test_dark_offsets_are_no_other_order_of_the_planes(tmp_path: Path, swapped: bool) -> None:
    """Each plane of this camera has an offset of up to 24 mV. Before a wall, these look like another order of the planes."""
    seen, out = camera(Defects(seed=1)), tmp_path / "camera"
    offsets = np.array([400, 284, -346, -281]).reshape(2, 2, 1, 1)

    def shifted(frames: list[NDArray[np.uint16]]) -> list[NDArray[np.uint16]]:
        return [(frame + offsets).astype(np.uint16)[:, :: -1 if swapped else 1] for frame in frames]

    dark = write(tmp_path / "dark", seen, shifted(covered(seen, count=10)))
    targets = [
        write(tmp_path / f"target_{d:g}", seen, shifted(wall(seen, d, count=2, seed=index)), distance_m=d)
        for index, d in enumerate((0.4, 1.6, 4.3))
    ]
    assert cadtof("calibrate", "dark", dark, "-o", out).status == 0
    done = cadtof("calibrate", "response", *targets, "-o", out)
    assert done.err.count("with SC1 and SC2 swapped, they would in") == (3 if swapped else 0)
    assert swapped or "are the planes in the order" not in done.err


def test_a_response_needs_to_know_the_distance(campaign: Campaign, tmp_path: Path) -> None:
    noisy = np.random.default_rng(0).normal(9000.0, 7.0, (2, 2, 60, 80)).astype(np.uint16)
    unknown = write(tmp_path / "target", campaign.seen, [noisy])
    done = cadtof("calibrate", "response", unknown, "-o", tmp_path / "camera")
    assert done.status == 2
    assert "the target's distance is not known: set distance_m under [target] in capture.toml" in done.err
    assert not (tmp_path / "camera" / "response.toml").exists()


def test_captures_of_different_settings_are_refused_by_the_key_that_differs(tmp_path: Path) -> None:
    first, other = (record(tmp_path / name).folder for name in "ab")
    settings = (other / "capture.toml").read_text()
    for key, found, expected, change in (
        ("modulation.periods_ns", "[50.0, 25.0]", "[40.0, 20.0]", ("[40.0, 20.0]", "[50.0, 25.0]")),
        (
            "optics.lamp_offset_m",
            "[0.1, 0.0, 0.0]",
            "not given",
            ("[optics]\n", "[optics]\nlamp_offset_m = [0.1, 0, 0]\n"),
        ),
    ):
        assert change[0] in settings
        (other / "capture.toml").write_text(settings.replace(*change))
        done = cadtof("calibrate", "response", first, other, "--distance", 1, "-o", tmp_path / "camera")
        assert (done.status, done.out) == (2, "")
        assert done.err.startswith(f"Error: {other}: {key} is {found}, expected {expected} as in {first}: all captures")


def test_field_curvature_is_reported_as_one_json_object_and_drawn(
    campaign: Campaign, calibrated: Path, tmp_path: Path
) -> None:
    camera, plot = Path(shutil.copytree(calibrated, tmp_path / "camera")), tmp_path / "walls.png"
    words = ("calibrate", "petzval", *campaign.walls, "-o", camera, "--plot", plot, "--overwrite", "--json", "-q")
    done = cadtof(*words)
    assert (done.status, done.err) == (0, "")
    report = json.loads(done.out)
    assert report["written"] == [str(camera / "petzval.toml"), str(plot)]
    assert (report["part"], len(report["figures"]["walls"])) == ("petzval", len(campaign.walls))
    assert plot.read_bytes().startswith(b"\x89PNG")
