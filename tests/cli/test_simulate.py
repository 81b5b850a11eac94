"""`cadtof simulate`: what it prints, what it writes, and what it refuses."""

import csv
import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from cadtof_cli.commands.scene_options import not_of_scene
from cadtof_cli.commands.simulate import simulate
from cadtof_cli.simulation.scene.scenes import SCENES
from tests.support.captures import layers_of
from tests.support.run_cadtof import cadtof

PATH_KEYS = {"true_ns", "mean_ns", "bias_ns", "std_ns", "bound_ns", "within_1ns"}


def test_the_table_agrees_with_table_1_of_the_paper() -> None:
    done = cadtof("simulate", "--asr", 5, "--mpi", 0.3, "--jobs", 1)
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0].startswith("laser : MPI : ambient = 1 : 0.3 : 5, n_av 100000")
    assert lines[1].split("ns")[0].split() == ["path", "true"]
    direct, second = lines[2].split(), lines[3].split()
    assert (direct[0], second[0]) == ("direct", "second")
    assert float(direct[4]) == pytest.approx(0.05, rel=0.15)
    assert float(second[4]) == pytest.approx(0.16, rel=0.15)
    assert "analytical model 43.2" in lines[4]


def test_json_has_the_keys_of_the_contract_and_nothing_else_on_stdout() -> None:
    done = cadtof("simulate", "--runs", 50, "--json", "--jobs", 1)
    report = json.loads(done.out)
    assert set(report) == {
        *("settings", "direct", "second", "confidence_v", "confidence_model_v", "impossible", "steps_per_start", "runs")
    }
    assert set(report["direct"]) == set(report["second"]) == PATH_KEYS
    assert report["runs"] == 50
    assert report["settings"]["asr"] == 5.0
    assert (report["settings"]["photons_per_cycle"], report["settings"]["cycles"]) == (5, 250_000)
    given = ("--photons", "--photons-per-cycle", 3, "--cycles", 70, "--runs", 2)
    settings = json.loads(cadtof("simulate", *given, "--json", "--jobs", 1).out)["settings"]
    assert (settings["photons_per_cycle"], settings["cycles"]) == (3, 70)
    assert report["confidence_v"] == pytest.approx(report["confidence_model_v"], rel=0.01)


def test_a_path_that_is_not_there_is_null() -> None:
    report = json.loads(cadtof("simulate", "--mpi", 0, "--runs", 50, "--json", "--jobs", 1).out)
    assert set(report["second"].values()) == {None}
    assert report["direct"]["std_ns"] == pytest.approx(report["direct"]["bound_ns"], rel=0.5)
    # later than the second path would be
    assert "–" in cadtof("simulate", "--mpi", 0, "--direct", 20, "--runs", 50, "--jobs", 1).out


@pytest.mark.parametrize("way", [(), ("--photons", "--integration-length", "300")])
def test_same_seed_same_bytes_for_any_number_of_processes(way: tuple[str, ...]) -> None:
    one, two, other = (
        cadtof("simulate", "--runs", 1003 if not way else 33, "--json", "--jobs", jobs, "--seed", seed, *way).out
        for jobs, seed in ((1, 4), (2, 4), (1, 5))
    )
    assert one == two
    assert one != other


def test_out_gets_pictures_and_tables_of_one_recording(tmp_path: Path) -> None:
    settings = ("--asr", 0.8, "--direct", 10, "--second", 17, "--integration-length", 4000, "--cycles", 10000)
    done = cadtof("simulate", *settings, "--runs", 20, "-o", tmp_path / "out", "--jobs", 1)
    assert done.status == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == sorted(
        ["histogram.csv", "histogram.png", "phase.csv", "phase.png", "voltages.csv", "voltages.png", "summary.json"]
    )
    for name in ("histogram.png", "phase.png", "voltages.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "out" / "phase.csv").open() as file:
        rows = list(csv.DictReader(file))
    # 10,000 cycles of 5 photons
    assert float(rows[-1]["photons"]) == 50_000
    later = [float(row["phase_deg"]) for row in rows[len(rows) // 2 :]]
    # 10 ns are 90°, and MPI of 0.3 at 17 ns, 153°, turns the sum by 13.24°
    assert np.mean(later) == pytest.approx(103.24, abs=1.5)
    with (tmp_path / "out" / "histogram.csv").open() as file:
        assert sum(float(row["photons"]) for row in csv.DictReader(file)) == 50_000


@pytest.mark.parametrize("scene", SCENES)
def test_the_page_about_simulation_lists_the_options_of_each_scene(scene: str) -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| `{scene}` \|.*\|(.*)\|$", page, re.MULTILINE)
    assert row, f"docs/simulation.md, A scene, has no row for {scene}"
    taken = {"mpi", *(field.name for field in fields(SCENES[scene]))} - {"asr", "seed", *not_of_scene(scene)}
    own = {one.opts[-1] for one in simulate.params if one.name in taken}
    assert set(re.findall("`(--.*?)`", row[1])) == own, f"docs/simulation.md: the options of {scene}"


ROOMS = ("room", "cornell")


@pytest.mark.parametrize("scene", [name for name in SCENES if name not in ROOMS])
@pytest.mark.parametrize("frame_format", ["tif", "exr"])
def test_scenes_are_captures_that_resolve_reads(tmp_path: Path, scene: str, frame_format: str) -> None:
    done = cadtof(
        *("simulate", "--scene", scene, "--frames", 2, "-o", tmp_path / "c", "--width", 40, "--height", 24),
        *("--format", frame_format, "--jobs", 1),
    )
    assert done.status == 0
    assert done.out == ""
    assert f"2 frames of {scene}" in done.err
    assert cadtof("resolve", tmp_path / "c", "-o", tmp_path / "maps", "--format", "exr", "--jobs", 1).status == 0
    truth = layers_of(tmp_path / "c" / "truth.exr")["direct.depth"]
    for index in (0, 1):
        depth = layers_of(tmp_path / "maps" / f"frame_{index:04d}.exr")["direct.depth"]
        assert np.nanmedian(np.abs(depth - truth)) < (0.04 if scene == "corner" else 0.006)


@pytest.mark.parametrize("scene", ROOMS)
def test_rooms_are_captures_that_resolve_reads(tmp_path: Path, scene: str) -> None:
    done = cadtof(
        *("simulate", "--scene", scene, "--light-paths", 16, "-o", tmp_path / "c", "--width", 40, "--height", 24),
        *("--periods", "40,20,13.333333333333334", "--jobs", 1),
    )
    assert (done.status, done.out) == (0, "")
    assert f"1 frame of {scene}" in done.err
    assert cadtof("resolve", tmp_path / "c", "-o", tmp_path / "maps", "--format", "exr", "--jobs", 1).status == 0
    depth, truth = (layers_of(tmp_path / file)["direct.depth"] for file in ("maps/frame_0000.exr", "c/truth.exr"))
    assert np.nanmedian(np.abs(depth - truth)) < 0.3


def test_the_seed_and_the_options_make_the_room(tmp_path: Path) -> None:
    same = ("--light-paths", 4, "--width", 16, "--height", 12, "--jobs", 1, "--asr", 1)
    ways: dict[str, tuple[str | float, ...]] = {
        "a": ("--seed", 5),
        "b": ("--seed", 5),
        "c": ("--seed", 6),
        "d": ("--seed", 5, "--furniture", 3),
        "e": ("--seed", 5, "--albedo", 0.3, "--lamp-offset", "0.05,0,0", "--lamp-beam", 80),
    }
    files = {}
    for name, options in ways.items():
        assert cadtof("simulate", "--scene", "room", *options, *same, "-o", tmp_path / name).status == 0
        files[name] = (tmp_path / name / "frame_0000.tif").read_bytes()
    assert files["a"] == files["b"]
    assert len(set(files.values())) == 4
    text = (tmp_path / "e" / "capture.toml").read_text()
    assert "albedo=0.3, lamp_offset_m=(0.05, 0.0, 0.0), beam_deg=80.0" in text


def test_capacitors_and_switched_stages_are_simulated() -> None:
    capacitors = ("--capacitors", "1,20,1,25,10,9,8,9,12,8,9,8")
    report = json.loads(cadtof("simulate", *capacitors, "--runs", 20, "--json", "--jobs", 1, "--temperature", 300).out)
    # (C1 + C2 + C5 + C6 + C9 + C10) / C1, and √(kT/C1)
    assert report["settings"]["integration_length"] == pytest.approx(60.0)
    assert report["settings"]["sample_noise_v"] == pytest.approx(2.035e-3, rel=1e-3)
    switched = (*capacitors, "--stages", "switched", "--f1", "1e8", "--f2", "1e7", "--cycles", "2000")
    report = json.loads(cadtof("simulate", *switched, "--runs", 20, "--json", "--jobs", 1, "--photons").out)
    assert report["settings"]["stages"] == "switched"
    assert report["settings"]["capacitors_ff"] == [1, 20, 1, 25, 10, 9, 8, 9, 12, 8, 9, 8]
    assert (report["settings"]["f1_hz"], report["settings"]["f2_hz"]) == (1e8, 1e7)


def test_pictures_that_cannot_be_drawn_are_refused_before_the_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("the runs began")

    monkeypatch.setattr("cadtof_cli.commands.simulate.simulate_trials", never)
    switched = ("--capacitors", "1,20,1,25,10,9,8,9,12,8,9,8", "--stages", "switched")
    for options, message in (
        (switched, "stages: found switched stages, expected --stages dc for the evolution of voltages"),
        (("--integration-length", "1e9"), "photons: found 12500000000 in a harmonic, expected 1000000000 or less"),
    ):
        done = cadtof("simulate", *options, "-o", tmp_path / "out", "--jobs", 1)
        assert done.status == 2
        assert message in done.err


BAD_INPUT = [
    (("--asr", "-1"), "ASR: found -1, expected a ratio from 0 to 1e+12"),
    (("--mpi", "-0.3"), "MPI ratio: found -0.3, expected a ratio from 0 to 1e+12"),
    (("--photons", "--dead-time", "41"), "dead time: found 41 ns, expected 0 to less than one cycle of 40 ns"),
    (("--dead-time", "10"), "dead time: found without --photons"),
    (("--second", "45"), "second: found 45 ns, a separation of 40 ns, expected a time after the direct 5 ns"),
    (("--second", "4"), "second: found 4 ns, a separation of -1 ns"),
    (("--second", "nan", "--mpi", "0"), "second: found nan ns"),
    (("--integration-length", "1"), "integration length: found 1, expected a number above 1"),
    (("--runs", "0"), "runs: found 0, expected 2 to 1000000000"),
    (("--jobs", "0"), "--jobs: found 0, expected 1 or more"),
    (("--periods", "40,13"), "modulation.periods_ns: found [40.0, 13.0]"),
    (("--amplitude", "0"), "modulation.amplitude_v: found 0.0"),
    (("--capacitors", "1,2,3"), "capacitors: found 3 values, expected 12"),
    (("--capacitors", "1,2,3", "--integration-length", "5"), "--integration-length: found with --capacitors"),
    (("--stages", "switched"), "stages: found switched stages without capacitors"),
    (("--temperature", "300"), "--temperature: found without --capacitors"),
    (("--offsets", "1"), "--offsets: found 1, expected 2 values"),
    (("--frames", "3"), "--frames: has no effect with --scene pixel (the default)"),
    (("--scene", "wall"), "--scene wall: found no -o, expected -o DIR"),
    (("--scene", "wall", "--runs", "10", "-o", "x"), "--runs: has no effect with --scene wall"),
    (("--scene", "wall", "--mpi", "0.3", "-o", "x"), "--mpi: has no effect with --scene wall"),
    (("--scene", "wall", "--albedo", "0.3", "-o", "x"), "--albedo: has no effect with --scene wall"),
    (("--scene", "inter-reflection", "--albedo", "1", "-o", "x"), "--albedo: has no effect with --scene inter-"),
    (("--scene", "wall", "--tilt", "3", "-o", "x"), "--tilt: found 1, expected 2 values"),
    (("--scene", "wall", "--distance", "5.9", "-o", "x"), "expected less than the unambiguous range of 5.996 m"),
    (("--scene", "corner", "--distance", "2000", "-o", "x"), "scene: found nothing in view, expected a surface there"),
    (("--scene", "corner", "--albedo", "2", "-o", "x"), "albedo: found 2, expected above 0, at most 1"),
    (("--scene", "card", "--frames", "0", "-o", "x"), "frames: found 0, expected 1 or more"),
    (
        ("--scene", "cave", "-o", "x"),
        f"'cave' is not one of 'pixel', {', '.join(map(repr, SCENES))}",
    ),
    (("--scene", "room", "--furniture", "99", "-o", "x"), "furniture: found 99, expected 0 to 12 pieces"),
    (("--scene", "room", "--lamp-offset", "1,2", "-o", "x"), "--lamp-offset: found 2, expected 3 values"),
    (
        ("--scene", "room", "--lamp-offset", "0,0,-2", "-o", "x"),
        "lamp offset: found (0.0, 0.0, -2.0), expected 0.3 m or less",
    ),
    (("--scene", "room", "--distance", "2", "-o", "x"), "--distance: has no effect with --scene room"),
    (
        ("--scene", "wall", "--furniture", "2", "-o", "x"),
        "--furniture: has no effect with --scene wall",
    ),
    (("--light-paths", "9"), "--light-paths: has no effect with --scene pixel (the default)"),
    (("--speed", "nan"), "speed: found nan m/s, expected less than the speed of light"),
    (("--frame-rate", "0"), "frame rate: found 0 Hz, expected a rate of 1e-6 Hz or more"),
    (("--path", "0.2"), "'0.2' is not a ratio and a time in ns such as 0.2@27"),
    (("--path", "0.2@3"), "path: found 3 ns, a separation of -2 ns, expected a time after the direct 5 ns"),
    (("--path", "-1@20"), "path: found a ratio of -1, expected a ratio from 0 to 1e+12"),
    (("--paths", "3"), "3 paths need at least 3 periods"),
    (("--solver", "lm", "--paths", "3"), "--solver lm finds two paths, not --paths 3"),
    (
        ("--periods", "40,10"),
        "with 2 periods, 2 paths have a unique solution only if these are harmonics 1, 2",
    ),
    (("--scene", "wall", "--solver", "lm", "-o", "x"), "--solver: has no effect with --scene wall"),
    (("--scene", "wall", "--wrapped", "-o", "x"), "--wrapped: has no effect with --scene wall"),
    (
        ("--integration-length", "1e5,1e4"),
        "--integration-length: found 100000,10000, expected one number; only a scene",
    ),
    (
        ("--scene", "wall", "--integration-length", "1e5,1e4,1e3", "-o", "x"),
        "pixel.integration_length: found [100000.0, 10000.0, 1000.0], expected one number, or 2",
    ),
    (("--scene", "wall", "--dead-time", "3", "-o", "x"), "--dead-time: has no effect with --scene wall"),
    (("--scene", "wall", "--temperature", "300", "-o", "x"), "--temperature: found without --capacitors"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_INPUT)
def test_bad_input_gets_a_clear_error(
    arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = cadtof("simulate", *arguments)
    assert message in done.err
    assert "Traceback" not in done.err
    assert (done.status, done.out) == (2, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("scene", ["pixel", "card"])
def test_an_out_that_exists_is_left_alone(tmp_path: Path, scene: str) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    done = cadtof("simulate", "--scene", scene, "-o", tmp_path, "--jobs", 1)
    assert f"{tmp_path}: found a folder with files, expected nothing there; choose another name" in done.err
    assert done.status == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_the_way_of_the_paper_and_three_paths_with_three_periods() -> None:
    same = ("--runs", 50, "--jobs", 1)
    paper = cadtof("simulate", *same, "--solver", "lm", "--order", 2, "--no-pulse-correction", "--wrapped")
    assert paper.status == 0
    assert "steps of Levenberg–Marquardt from each of 10 starts" in paper.out
    three = ("--periods-ns", "40,20,13.3333", "--paths", 3, "--mpi", 0.6, "--second", 13, "--path", "0.4@21")
    report = json.loads(cadtof("simulate", *same, *three, "--integration-length", 1e6, "--json").out)
    assert [report[name]["true_ns"] for name in ("direct", "second", "path3")] == [5.0, 13.0, 21.0]
    assert report["path3"]["std_ns"] == pytest.approx(report["path3"]["bound_ns"], rel=0.4)
    lines = cadtof("simulate", *same, *three).out.splitlines()
    assert lines[0].startswith("laser : MPI : MPI : ambient = 1 : 0.6 : 0.4 : 5, ")
    assert lines[4].startswith("path3       21.000")


def test_amplitudes_beyond_the_modulation_are_counted_as_impossible() -> None:
    done = cadtof("simulate", "--offsets", "0.5,0", "--runs", 20, "--jobs", 1)
    assert "impossible amplitudes, and no answer, in 100.0% of the runs" in done.out


def test_a_moving_scene_and_a_moving_pixel(tmp_path: Path) -> None:
    """At 2 m/s and 30 frames per second, the scene moves by 3.3 cm, .222 ns, from the first harmonic to the second.

    Truth holds for the middle. One path gives the second harmonic 4/5 of the weight, so it is off by 4/5 − 1/2 = 0.3 of
    that.
    """
    fast = ("--speed", 2, "--jobs", 1)
    report = json.loads(cadtof("simulate", "--mpi", 0, "--asr", 1, "--order", 1, *fast, "--json").out)
    assert report["direct"]["bias_ns"] == pytest.approx(0.3 * 0.2224, abs=0.005)
    assert report["settings"]["speed_m_s"] == 2.0
    small = ("--width", 16, "--height", 12, "-o")
    assert cadtof("simulate", "--scene", "wall", *fast, *small, tmp_path / "fast").status == 0
    assert cadtof("simulate", "--scene", "wall", "--jobs", 1, *small, tmp_path / "still").status == 0
    assert "motion: Motion(speed_m_s=2.0, frame_rate_hz=30.0)" in (tmp_path / "fast" / "capture.toml").read_text()
    assert "motion" not in (tmp_path / "still" / "capture.toml").read_text()
    assert (tmp_path / "fast" / "frame_0000.tif").read_bytes() != (tmp_path / "still" / "frame_0000.tif").read_bytes()
