"""`cadtof resolve` with other solvers, more periods, more paths, pooled neighbours and averaged frames."""

import json
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import read_stored
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows import recording
from cadtof_cli.workflows.resolve import ongoing_run
from cadtof_cli.workflows.resolve.split_frames import FramePart
from tests.support.forward import depth_m
from tests.support.mixture_captures import read_maps, write_capture
from tests.support.mixtures import Mixture
from tests.support.run_cadtof import Finished, cadtof

TWO = Mixture((1.0, 0.3), (5.0, 16.0))
THREE = Mixture((1.0, 0.6, 0.4), (5.0, 13.0, 21.0))


def resolve(capture: Path, out: Path, *options: object) -> Finished:
    return cadtof("resolve", capture, "-o", out, "--format", "exr", "--quiet", "--jobs", 1, *options)


def test_light_that_two_paths_do_not_explain_is_told(tmp_path: Path) -> None:
    told = "its paths do not explain the light (median chi_squared above 10), so errors are larger than sigma: was there motion"
    capture = write_capture(tmp_path / "three", THREE, harmonics=(1, 2, 3), n_av=1e6)
    done = cadtof("resolve", capture, "-o", tmp_path / "out", "--jobs", 1)
    assert f"frame_0000.tif: {told}" in done.err
    assert told in json.loads((tmp_path / "out" / "frames.jsonl").read_text())["reason"]
    assert told not in cadtof("resolve", capture, "-o", tmp_path / "one", "--jobs", 1, "--order", 1).err
    sound = write_capture(tmp_path / "two", TWO, harmonics=(1, 2, 3, 4, 5, 6), n_av=1e6)
    assert told[:20] not in cadtof("resolve", sound, "-o", tmp_path / "sound", "--jobs", 1).err


def depth_std_m(light: Mixture, harmonics: tuple[int, ...], n_av: float = 1e5) -> float:
    return float(depth_m(light.bound_ns(harmonics, n_av)[0]))


@pytest.mark.parametrize("harmonics", [(1, 2, 3), (1, 2, 4), (1, 2, 3, 4)])
def test_a_capture_of_any_periods_becomes_maps(tmp_path: Path, harmonics: tuple[int, ...]) -> None:
    capture = write_capture(tmp_path / "capture", TWO, harmonics=harmonics)
    assert resolve(capture, tmp_path / "out") == Finished(0, "", "")
    maps = read_maps(tmp_path / "out" / "frame_0000.exr")
    std = depth_std_m(TWO, harmonics)
    assert maps["direct.depth"].mean() == pytest.approx(depth_m(5.0), abs=0.3 * std)
    assert maps["direct.depth"].std() == pytest.approx(std, rel=0.2)
    assert np.median(maps["direct.sigma"]) == pytest.approx(std, rel=0.05)
    assert maps["mpi.depth"].mean() == pytest.approx(depth_m(16.0), abs=0.02)
    assert maps["chi_squared"].mean() == pytest.approx(2 * (len(harmonics) - 2), rel=0.3)
    assert (maps["status"] == StatusBit.TWO_PATHS).all()


def test_three_paths_get_layers_of_their_own(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", THREE, harmonics=(1, 2, 3), n_av=1e6)
    assert resolve(capture, tmp_path / "out", "--paths", 3) == Finished(0, "", "")
    maps = read_maps(tmp_path / "out" / "frame_0000.exr")
    for name, delay in (("direct", 5.0), ("mpi", 13.0), ("path3", 21.0)):
        assert np.median(maps[f"{name}.depth"]) == pytest.approx(depth_m(delay), abs=0.02)
        assert (maps[f"{name}.sigma"] > 0).all()
    assert np.median(maps["path3.amplitude"]) == pytest.approx(0.2746 * THREE.shares[2], rel=0.05)
    assert (maps["status"] == StatusBit.MORE_PATHS).all()
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["layers"]["path3.depth"] == "m"
    line = json.loads((tmp_path / "out" / "frames.jsonl").read_text())
    assert (line["more_paths"], line["two_paths"], line["invalid"]) == (192, 0, 0)


def test_the_papers_solver_gives_the_closed_form_s_maps(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", TWO)
    assert resolve(capture, tmp_path / "closed").status == 0
    assert resolve(capture, tmp_path / "lm", "--solver", "lm", "--order", 2).status == 0
    closed, lm = (read_maps(tmp_path / name / "frame_0000.exr") for name in ("closed", "lm"))
    for name in ("direct.depth", "mpi.depth", "direct.amplitude", "mpi.amplitude"):
        np.testing.assert_allclose(lm[name], closed[name], rtol=1e-5)
    np.testing.assert_allclose(lm["direct.sigma"], closed["direct.sigma"], rtol=0.01)


def test_pooling_and_averaging_lower_the_noise_and_say_by_how_much(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", TWO, frames=5)
    single = depth_std_m(TWO, (1, 2))
    for options, names, pixels in (
        (("--average", 2), ["frame_0000", "frame_0002", "frame_0004"], [2.0, 2.0, 1.0]),
        (("--pool", 3), [f"frame_{index:04}" for index in range(5)], [7.3] * 5),
        (("--average", 5, "--pool", 3), ["frame_0000"], [36.7]),
    ):
        out = tmp_path / "-".join(map(str, options))
        assert resolve(capture, out, *options) == Finished(0, "", "")
        assert [path.stem for path in sorted(out.glob("*.exr"))] == names
        for name, expected in zip(names, pixels, strict=True):
            maps = read_maps(out / f"{name}.exr")
            effective = maps["effective_pixels"]
            assert effective.mean() == pytest.approx(expected, rel=0.05)
            assert np.median(maps["direct.sigma"]) == pytest.approx(single / np.median(effective) ** 0.5, rel=0.1)
            assert maps["direct.depth"].std() < 1.5 * single / expected**0.5
            pooled = (maps["status"].astype(int) & StatusBit.POOLED) > 0
            np.testing.assert_array_equal(pooled, effective > 1.0)


def test_a_copy_of_a_frame_is_left_out_of_the_mean(tmp_path: Path) -> None:
    """It makes no noise smaller: the mean of two frames and a copy is that of the two."""
    capture = write_capture(tmp_path / "capture", TWO, frames=3)
    (capture / "frame_0001.tif").write_bytes((capture / "frame_0000.tif").read_bytes())
    out = tmp_path / "out"
    done = cadtof("resolve", capture, "-o", out, "--format", "exr", "--jobs", 1, "--average", 3)
    assert done.status == 0
    why = f"1 of 3 frames left out of the mean: {capture / 'frame_0001.tif'}: holds the same values as another"
    assert why in done.err
    assert read_maps(out / "frame_0000.exr")["effective_pixels"].max() == 2.0


def test_frames_of_four_pixels_that_agree_by_chance_are_all_in_the_mean(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", TWO, frames=3, size=(2, 2))
    (capture / "frame_0001.tif").write_bytes((capture / "frame_0000.tif").read_bytes())
    options = ("--format", "exr", "--jobs", 1, "--average", 3)
    assert cadtof("resolve", capture, "-o", tmp_path / "out", *options).status == 0
    assert read_maps(tmp_path / "out" / "frame_0000.exr")["effective_pixels"].max() == 3.0


def test_a_frame_that_cannot_be_read_is_left_out_of_its_mean(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", TWO, frames=3)
    (capture / "frame_0001.tif").write_bytes(b"II*\0 and no more")
    done = cadtof("resolve", capture, "-o", tmp_path / "out", "--format", "exr", "--jobs", 1, "--average", 3)
    assert done.status == 0
    line = json.loads((tmp_path / "out" / "frames.jsonl").read_text())
    assert line["status"] == "ok"
    why = f"1 of 3 frames left out of the mean: {capture / 'frame_0001.tif'}: damaged"
    assert line["reason"].startswith(why)
    assert f"{tmp_path / 'out' / 'frame_0000.exr'}: {why}" in done.err
    assert (read_maps(tmp_path / "out" / "frame_0000.exr")["effective_pixels"] == 2.0).all()


def test_a_mean_of_frames_that_cannot_be_read_fails_with_the_first_reason(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", TWO, frames=4)
    for name in ("frame_0000.tif", "frame_0001.tif"):
        (capture / name).write_bytes(b"II*\0 and no more")
    done = cadtof("resolve", capture, "-o", tmp_path / "out", "--jobs", 1, "--average", 2, "--json")
    failed, good = map(json.loads, done.out.splitlines())
    assert (done.status, failed["status"], good["status"]) == (1, "failed", "ok")
    assert failed["reason"].startswith(f"{capture / 'frame_0000.tif'}: damaged")


@pytest.mark.parametrize("options", [("--solver", "lm"), ("--paths", 3), ("--pool", 3)])
def test_a_lone_frame_over_processes_is_the_same_to_the_bit(
    tmp_path: Path, options: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = write_capture(tmp_path / "capture", TWO, harmonics=(1, 2, 3), n_av=3e3, size=(13, 17))
    assert resolve(capture, tmp_path / "one", *options).status == 0
    monkeypatch.setattr(ongoing_run, "WORTH_SPLITTING_S", 0.0)
    assert resolve(capture, tmp_path / "three", *options, "--jobs", 3).status == 0
    one, three = ((tmp_path / name / "frame_0000.exr").read_bytes() for name in ("one", "three"))
    assert one == three
    lines = [json.loads((tmp_path / name / "frames.jsonl").read_text()) for name in ("one", "three")]
    assert {**lines[0], "output": None, "seconds": 0} == {**lines[1], "output": None, "seconds": 0}


def test_a_lone_frame_over_processes_is_kept_if_it_has_not_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, out = write_capture(tmp_path / "capture", TWO, size=(6, 8)), tmp_path / "out"
    monkeypatch.setattr(ongoing_run, "WORTH_SPLITTING_S", 0.0)
    assert resolve(capture, out, "--jobs", 3).status == 0
    written_ns = (out / "frame_0000.exr").stat().st_mtime_ns
    done = resolve(capture, out, "--jobs", 3, "--resume", "--json")
    assert (done.status, json.loads(done.out)["status"]) == (0, "skipped")
    assert (out / "frame_0000.exr").stat().st_mtime_ns == written_ns


def test_a_worker_gets_its_part_of_a_frame_and_not_the_whole_frame() -> None:
    whole: Any = np.zeros(10_000)
    part = FramePart("task", "pixels", whole)  # type: ignore[arg-type]
    sent = pickle.dumps(part)
    assert len(sent) < 1000
    assert pickle.loads(sent) == FramePart("task", "pixels", None)  # type: ignore[arg-type]


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_time_of_a_frame_includes_its_reading(tmp_path: Path, jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def slowly(*arguments: Any, **named: Any) -> Stored:
        time.sleep(0.2)
        return read_stored(*arguments, **named)

    capture = write_capture(tmp_path / "capture", TWO)
    monkeypatch.setattr(recording, "read_stored", slowly)
    monkeypatch.setattr(ongoing_run, "WORTH_SPLITTING_S", 0.0)
    assert resolve(capture, tmp_path / "out", "--jobs", jobs).status == 0
    assert json.loads((tmp_path / "out" / "frames.jsonl").read_text())["seconds"] > 0.2


def test_a_lone_frame_that_cannot_be_read_fails_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = write_capture(tmp_path / "capture", TWO)
    (capture / "frame_0000.tif").write_bytes(b"II*\0 and no more")
    monkeypatch.setattr(ongoing_run, "WORTH_SPLITTING_S", -1.0)
    assert resolve(capture, tmp_path / "out", "--jobs", 2).status == 1
    assert json.loads((tmp_path / "out" / "frames.jsonl").read_text())["status"] == "failed"


@pytest.mark.parametrize(
    ("harmonics", "options", "words"),
    [
        ((1, 2), ("--pool", 4), "--pool: found 4, expected an odd number of pixels such as 3 or 5"),
        ((1, 2), ("--pool", -1), "--pool: found -1"),
        ((1, 2), ("--average", 0), "--average: found 0, expected 1 to 1000000 frames"),
        ((1, 2), ("--paths", 3), "3 paths need at least 3 periods: lower --paths or --order, or use --solver one-path"),
        ((1, 2), ("--paths", 0), "--paths: found 0, expected 1 to 100"),
        ((1, 2), ("--starts", 0), "--starts: found 0, expected 1 to 1000000000"),
        ((1, 2), ("--seed", -1), "--seed: found -1, expected 0 or more"),
        ((1, 2, 3), ("--solver", "lm", "--paths", 3), "--solver lm finds two paths, not --paths 3"),
        (
            (1, 2, 3),
            ("--order", 3),
            "--order: found '3', expected one of auto, 1, 2 with --solver two-path and --paths 2",
        ),
        ((1, 2), ("--order", "many"), "--order: found 'many'"),
        ((1, 3), (), "record another period, lower --paths or --order, or use --solver one-path"),
        ((1,), (), "2 paths need at least 2 periods"),
    ],
)
def test_impossible_settings_are_refused_before_anything_is_written(
    tmp_path: Path, harmonics: tuple[int, ...], options: tuple[object, ...], words: str
) -> None:
    capture = write_capture(tmp_path / "capture", TWO, harmonics=harmonics, size=(2, 2))
    done = resolve(capture, tmp_path / "out", *options)
    assert done.status == 2
    assert words in done.err
    assert not (tmp_path / "out" / "run.json").exists()


def test_the_random_starts_follow_from_the_seed(tmp_path: Path) -> None:
    capture = write_capture(tmp_path / "capture", Mixture((1.0,), (5.0,)), n_av=1e4)
    options = ("--solver", "lm", "--order", 2, "--starts", 1)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert resolve(capture, tmp_path / name, *options, "--seed", seed).status == 0
    a, b, c = ((tmp_path / name / "frame_0000.exr").read_bytes() for name in "abc")
    assert a == b
    assert a != c
