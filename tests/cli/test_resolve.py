"""`cadtof resolve` from recorded files to maps: exit status, messages, records and pixels."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.commands.resolve import _summary
from cadtof_cli.resolver.kernels import NUMPY, chosen_kernel
from cadtof_cli.workflows.resolve.reports import RunTotals
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from tests.support.captures import (
    MAP_LAYERS,
    PLANE_NAMES,
    TOML,
    VOLTS_PER_COUNT,
    ZERO_COUNTS,
    Form,
    counts_of,
    layers_of,
    record,
    write_exr,
    write_pages,
)
from tests.support.forward import AMPLITUDE_V, depth_m, step_frame, step_truth
from tests.support.run_cadtof import cadtof, program

ONE_PATH, TWO_PATHS, ILL_CONDITIONED = 8, 16, 32
LINE_KEYS = [
    *("source", "output", "status", "reason", "seconds", "one_path", "two_paths", "diffuse", "invalid"),
    *("files", "digest", "output_bytes", "output_digest"),
]
PULSE_RESPONSE = np.exp(-((2 * np.pi * 1.7 / 2.354820045 / 40.0) ** 2) / 2)
LEFT, RIGHT = np.s_[:, :16], np.s_[:, 16:]
"""The halves of `step_frame`: one path at 5 ns, and 12 ns with MPI of 0.3 at 20 ns."""


@pytest.mark.parametrize("form", ["tif", "exr"])
@pytest.mark.parametrize("map_format", ["same", "tif", "exr"])
def test_maps_hold_the_truth_within_noise(form: Form, map_format: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form=form)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "--format", map_format, "--jobs", 1)
    assert (done.status, done.out) == (0, "")
    suffix = form if map_format == "same" else map_format
    assert f"maps in {tmp_path / 'out'}" in done.err
    assert "resolved 1 of 1 frames in " in done.err
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"frame_0.{suffix}", "frames.jsonl", "run.json"]
    layers = layers_of(tmp_path / "out" / f"frame_0.{suffix}")
    assert sorted(layers) == sorted(MAP_LAYERS)
    assert {layer.shape for layer in layers.values()} == {(24, 32)}
    _require_truth(layers)


def _require_truth(layers: dict[str, NDArray[Any]]) -> None:
    error = layers["direct.depth"] - step_truth()
    # one path at ASR 2: sigma of the phase is 1.58e-3 · 3 rad, 4.5 mm, for one harmonic, and less for two;
    # the median of the absolute error is .67 of sigma
    assert np.sqrt(np.median(np.square(error[LEFT]))) < 0.0031
    assert np.median(np.abs(error[RIGHT])) < 0.012
    status = layers["status"].astype(np.uint32)
    two = (status & TWO_PATHS) != 0
    assert ((status & (ONE_PATH | TWO_PATHS)) != 0).all()
    assert two[LEFT].mean() < 0.05
    assert two[RIGHT].all()
    assert np.median(np.abs(layers["mpi.depth"][RIGHT] - depth_m(20.0))) < 0.05
    # laser : MPI : ambient = 1 : 0.3 : 2
    assert np.median(layers["direct.amplitude"][RIGHT]) == pytest.approx(AMPLITUDE_V / 3.3, rel=0.01)
    assert np.median(layers["mpi.amplitude"][RIGHT]) == pytest.approx(0.3 * AMPLITUDE_V / 3.3, rel=0.04)
    assert np.median(layers["confidence"][LEFT]) == pytest.approx(AMPLITUDE_V / 3, rel=0.01)
    for name in ("mpi.depth", "mpi.amplitude", "mpi.sigma"):
        np.testing.assert_array_equal(np.isnan(layers[name]), ~two)
    for name in ("direct.depth", "direct.amplitude", "direct.sigma", "confidence"):
        assert np.isfinite(layers[name]).all()
    scatter = np.std(error[RIGHT])
    assert 0.7 < np.median(layers["direct.sigma"][RIGHT]) / scatter < 1.3


def test_counts_and_volts_give_the_same_maps(tmp_path: Path) -> None:
    for form in ("tif", "exr"):
        out = tmp_path / f"{form}-out"
        assert cadtof("resolve", record(tmp_path / form, form=form).folder, "-o", out, "-j", 1).status == 0
    counts = layers_of(tmp_path / "tif-out" / "frame_0.tif")["direct.depth"]
    volts = layers_of(tmp_path / "exr-out" / "frame_0.exr")["direct.depth"]
    # half a count is 30 µV of 275 mV
    assert np.median(np.abs(counts - volts)) < 0.0005


def test_every_frame_has_its_line_in_the_order_of_the_inputs(tmp_path: Path) -> None:
    a, b = record(tmp_path / "a", frames=12), record(tmp_path / "b", form="exr", seed=1)
    b.files[0].rename(b.folder / "other.exr")
    done = program("resolve", b.folder, a.folder, "-o", tmp_path / "out", "--json", "--jobs", 2)
    assert done.status == 0
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["source"] for line in lines] == [str(b.folder / "other.exr"), *map(str, a.files)]
    assert done.out == (tmp_path / "out" / "frames.jsonl").read_text()
    for line in lines:
        assert list(line) == LINE_KEYS
        assert (line["status"], line["reason"]) == ("ok", None)
        assert line["one_path"] + line["two_paths"] + line["diffuse"] + line["invalid"] == 24 * 32
        status = layers_of(Path(line["output"]))["status"].astype(np.uint32)
        assert line["two_paths"] == np.count_nonzero(status & TWO_PATHS)
        assert line["seconds"] > 0


def test_the_run_is_recorded(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--pulse-fwhm-ns", 1.6, "--order", "2")
    assert done.status == 2
    assert "--fwhm-ns" in done.err
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--fwhm-ns", 1.6, "--order", "2")
    assert done.status == 0
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["finished"] is True
    assert run["arguments"]["order"] == "2"
    assert run["arguments"]["overrides"] == {"pulse.fwhm_ns": 1.6}
    (recorded,) = run["captures"]
    assert recorded["metadata"]["pulse"]["fwhm_ns"] == 1.6
    assert recorded["origins"]["pulse.fwhm_ns"] == "--fwhm-ns"
    assert recorded["origins"]["pixel.integration_length"] == str(capture.folder / "capture.toml")
    assert recorded["origins"]["target.distance_m"] == "default"
    assert {name: run["totals"][name] for name in ("frames", "ok", "failed", "skipped")} == {
        "frames": 2,
        "ok": 2,
        "failed": 0,
        "skipped": 0,
    }
    lines = [json.loads(line) for line in (tmp_path / "out" / "frames.jsonl").read_text().splitlines()]
    assert run["totals"]["two_paths"] == sum(line["two_paths"] for line in lines)
    assert run["cadtof"]


def test_planar_depth_by_the_pinhole(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    for kind in ("range", "z"):
        done = cadtof("resolve", capture.folder, "-o", tmp_path / kind, "--depth", kind, "-j", 1, "--quiet")
        assert (done.status, done.out, done.err) == (0, "", "")
    radial, planar = (layers_of(tmp_path / kind / "frame_0.tif") for kind in ("range", "z"))
    y, x = np.indices((24, 32))
    factor = 28.0 / np.sqrt(28.0**2 + (x - 15.0) ** 2 + (y - 10.0) ** 2)
    for name in ("direct.depth", "mpi.depth", "direct.sigma", "mpi.sigma"):
        np.testing.assert_allclose(planar[name], radial[name] * factor, rtol=3e-7)
    for name in ("direct.amplitude", "confidence", "status"):
        np.testing.assert_array_equal(planar[name], radial[name])


@pytest.mark.parametrize(
    ("choice", "direct_ns", "mpi_ns"),
    [
        (("--return", "first"), 12.0, 20.0),
        (("--return", "last"), 20.0, 12.0),
        (("--return", "strongest"), 12.0, 20.0),
        # the second path has 0.3 of the amplitude of the first
        (("--return", "last", "--min-return-ratio", "0.45"), 12.0, 20.0),
        (("--return", "last", "--min-return-ratio", "0.2"), 20.0, 12.0),
    ],
)
def test_which_path_is_direct(choice: tuple[str, ...], direct_ns: float, mpi_ns: float, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, *choice).status == 0
    layers = layers_of(tmp_path / "out" / "frame_0.tif")
    assert np.median(layers["direct.depth"][RIGHT]) == pytest.approx(depth_m(direct_ns), abs=0.05)
    assert np.median(layers["mpi.depth"][RIGHT]) == pytest.approx(depth_m(mpi_ns), abs=0.05)


@pytest.mark.parametrize("choice", [("--order", "1"), ("--solver", "one-path")])
def test_one_path_everywhere_if_one_is_asked_for(choice: tuple[str, ...], tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, *choice).status == 0
    layers = layers_of(tmp_path / "out" / "frame_0.tif")
    assert set(np.unique(layers["status"])) == {ONE_PATH, ONE_PATH + ILL_CONDITIONED}
    assert (layers["status"] == ONE_PATH + ILL_CONDITIONED)[RIGHT].all()
    assert np.isnan(layers["mpi.depth"]).all()
    assert np.median(np.abs(layers["direct.depth"] - step_truth())[LEFT]) < 0.003
    # an answer that ignores the second path is wrong: the first phasor is off by about 20 cm
    assert np.median(np.abs(layers["direct.depth"] - step_truth())[RIGHT]) > 0.1


def test_two_paths_almost_everywhere_if_two_are_asked_for(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--order", 2).status == 0
    status = layers_of(tmp_path / "out" / "frame_0.tif")["status"].astype(np.uint32)
    assert ((status & TWO_PATHS) != 0).mean() > 0.9


def test_pixels_below_the_least_confidence_have_no_answer(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    volts = VOLTS_PER_COUNT * (tifffile.imread(capture.files[0]).astype(np.float64) - ZERO_COUNTS)
    expected_v = np.hypot(volts[0], volts[1]) / PULSE_RESPONSE
    least = float(np.median(expected_v))
    low = expected_v < least
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--min-confidence", least)
    assert done.status == 0
    layers = layers_of(tmp_path / "out" / "frame_0.tif")
    np.testing.assert_allclose(layers["confidence"], expected_v, rtol=1e-6)
    np.testing.assert_array_equal(layers["status"] == 4, low)
    np.testing.assert_array_equal(np.isnan(layers["direct.depth"]), low)
    assert "50.0% no answer" in done.err


def test_paths_are_read_from_stdin_in_their_order(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    named = "".join(f"{file}\n" for file in reversed(capture.files[:2]))
    done = program("resolve", "-", "-o", tmp_path / "out", "--json", "-j", 1, stdin=named)
    assert done.status == 0
    assert [json.loads(line)["source"] for line in done.out.splitlines()] == [
        str(capture.files[1]),
        str(capture.files[0]),
    ]
    done = program("resolve", "-", "-o", tmp_path / "none", stdin="\n")
    assert (done.status, done.out) == (2, "")
    assert "no paths arrived on stdin; expected one path per line" in done.err


def test_one_file_takes_the_metadata_beside_it(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    assert cadtof("resolve", capture.files[1], "-o", tmp_path / "out", "-j", 1).status == 0
    assert not (tmp_path / "out" / "frame_0.tif").exists()
    layers = layers_of(tmp_path / "out" / "frame_1.tif")
    assert np.median(np.abs(layers["direct.depth"] - step_truth())) < 0.01


def test_defaults_and_an_estimated_noise_are_reported(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", form="exr", toml="")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--json")
    assert done.status == 0
    assert (
        f"{capture.folder}: not given, so taken from the paper: modulation.periods_ns = [40.0, 20.0], "
        "modulation.waveform = 'sine', modulation.amplitude_v = 0.2746, pulse.fwhm_ns = 1.7" in done.err
    )
    assert "pixel.integration_length is not given, so the noise is estimated from each frame" in done.err
    words, _, estimate = json.loads(done.out)["reason"].rpartition(" ")
    assert words == "noise estimated from the frame: integration_length"
    assert float(estimate) == pytest.approx(1e5, rel=0.25)
    assert np.median(np.abs(layers_of(tmp_path / "out" / "frame_0.exr")["direct.depth"] - step_truth())) < 0.01


def test_given_settings_cause_no_message_and_quiet_runs_print_nothing(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    assert len(done.err.splitlines()) == 1 + (chosen_kernel() == NUMPY)
    done = program("resolve", capture.folder, "-o", tmp_path / "quiet", "-j", 2, "--quiet")
    assert (done.status, done.out, done.err) == (0, "", "")


def _require_same_depths(file: Path, expected: Path) -> None:
    np.testing.assert_array_equal(layers_of(file)["direct.depth"], layers_of(expected)["direct.depth"])


@pytest.mark.parametrize("labelled", [True, False])
def test_a_stack_is_resolved_frame_by_frame(labelled: bool, tmp_path: Path) -> None:
    single = record(tmp_path / "single", frames=3)
    pages = np.stack([tifffile.imread(file) for file in single.files])
    stack = tmp_path / "stack"
    stack.mkdir()
    if labelled:
        (stack / "capture.toml").write_text(TOML["tif"])
        tifffile.imwrite(stack / "s.tif", pages.reshape(3, 2, 2, 24, 32), metadata={"axes": "THCYX"})
    else:
        (stack / "capture.toml").write_text(TOML["tif"] + "[layout]\nframes = 3\n")
        write_pages(stack / "s.tif", pages.reshape(12, 24, 32))
    assert cadtof("resolve", single.folder, "-o", tmp_path / "singles", "-j", 1).status == 0
    done = cadtof("resolve", stack, "-o", tmp_path / "out", "-j", 1, "--json")
    assert done.status == 0
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["source"] for line in lines] == [f"{stack / 's.tif'}[{index}]" for index in range(3)]
    for index, line in enumerate(lines):
        assert line["output"] == str(tmp_path / "out" / f"s_{index:04}.tif")
        _require_same_depths(Path(line["output"]), tmp_path / "singles" / f"frame_{index}.tif")


def test_a_frame_named_like_one_of_a_stack_keeps_its_name(tmp_path: Path) -> None:
    single = record(tmp_path / "single", frames=3)
    capture = tmp_path / "capture"
    capture.mkdir()
    (capture / "capture.toml").write_text(TOML["tif"])
    pages = np.stack([tifffile.imread(file) for file in single.files[:2]])
    tifffile.imwrite(capture / "s.tif", pages.reshape(2, 2, 2, 24, 32), metadata={"axes": "THCYX"})
    shutil.copy(single.files[2], capture / "s_0001.tif")
    assert cadtof("resolve", single.folder, "-o", tmp_path / "singles", "-j", 1).status == 0
    assert cadtof("resolve", capture, "-o", tmp_path / "out", "-j", 1).status == 0
    names = ["s_00000.tif", "s_00001.tif", "s_0001.tif"]
    assert sorted(p.name for p in (tmp_path / "out").glob("*.tif")) == names
    for index, name in enumerate(names):
        _require_same_depths(tmp_path / "out" / name, tmp_path / "singles" / f"frame_{index}.tif")


@pytest.mark.parametrize("suffix", ["tif", "exr"])
def test_planes_in_files_of_one_plane_each(suffix: str, tmp_path: Path) -> None:
    single = record(tmp_path / "single", frames=2)
    capture = tmp_path / "capture"
    capture.mkdir()
    pattern = f"{{frame}}_h{{harmonic}}_sc{{channel}}.{suffix}"
    (capture / "capture.toml").write_text(TOML["tif"] + f'[layout]\npattern = "{pattern}"\n')
    for file in single.files:
        for (harmonic, channel), plane in zip(((1, 1), (1, 2), (2, 1), (2, 2)), tifffile.imread(file), strict=True):
            path = capture / f"{file.stem}_h{harmonic}_sc{channel}.{suffix}"
            if suffix == "exr":
                write_exr(path, {"Y": plane.astype(np.float32)})
            else:
                write_pages(path, plane)
    assert cadtof("resolve", single.folder, "-o", tmp_path / "singles", "-j", 1).status == 0
    assert cadtof("resolve", capture, "-o", tmp_path / "out", "-j", 1).status == 0
    for file in single.files:
        made, expected = (layers_of(folder / f"{file.stem}.{kind}") for folder, kind in (
            (tmp_path / "out", suffix), (tmp_path / "singles", "tif")
        ))  # fmt: skip
        np.testing.assert_allclose(made["direct.depth"], expected["direct.depth"], atol=2e-4)


def test_truth_and_maps_in_a_folder_are_no_frames(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2)
    write_exr(capture.folder / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "first", "-j", 1).status == 0
    shutil.copy(tmp_path / "first" / "frame_0.tif", capture.folder / "map_a.tif")
    write_exr(capture.folder / "map_b.exr", {"direct.depth": step_truth().astype(np.float32)})
    done = cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--json")
    assert done.status == 0
    lines = {Path(line["source"]).name: line for line in map(json.loads, done.out.splitlines())}
    assert {name: line["status"] for name, line in lines.items()} == {
        "frame_0.tif": "ok",
        "frame_1.tif": "ok",
        "map_a.tif": "skipped",
        "map_b.exr": "skipped",
    }
    assert "holds maps (direct.depth, mpi.depth, " in lines["map_a.tif"]["reason"]
    assert str(capture.folder / "map_b.exr") in lines["map_b.exr"]["reason"]
    assert lines["map_b.exr"]["output"] is None
    assert f"2 skipped, see {tmp_path / 'out' / 'frames.jsonl'}" in done.err


def test_saturated_and_not_finite_pixels_are_marked_and_cost_no_other_pixel(tmp_path: Path) -> None:
    volts = step_frame(np.random.default_rng(0))
    forms: tuple[Form, ...] = ("tif", "exr")
    for form in forms:
        record(tmp_path / form, form=form)
    counts = counts_of(volts)
    counts[2, 3, 4], counts[0, 5, 6] = 16383, 0
    write_pages(tmp_path / "tif" / "frame_0.tif", counts)
    floats = volts.reshape(4, 24, 32).astype(np.float32)
    floats[1, 7, 8], floats[3, 9, 10], floats[0, 9, 11], floats[2, 9, 12] = np.nan, np.inf, -np.inf, 3e38
    write_exr(tmp_path / "exr" / "frame_0.exr", dict(zip(PLANE_NAMES, floats, strict=True)))
    # once with known noise, by two processes; once with noise that is estimated from such a frame, by one process
    for noise, jobs in (("known", 2), ("estimated", 1)):
        for form in forms:
            if noise == "estimated":
                toml = tmp_path / form / "capture.toml"
                toml.write_text(toml.read_text().replace("integration_length = 100000\n", ""))
            out = tmp_path / f"{noise}-{form}"
            done = program("resolve", tmp_path / form, "-o", out, "--json", "--quiet", "--jobs", jobs)
            assert (done.status, done.err) == (0, "")
            line = json.loads(done.out)
            assert (line["invalid"], line["reason"] is None) == ({"tif": 2, "exr": 4}[form], noise == "known")
            if noise == "estimated":
                assert float(line["reason"].rpartition(" ")[2]) == pytest.approx(1e5, rel=0.25)
            _require_bad_pixels_marked(layers_of(out / f"frame_0.{form}"), form)


def _require_bad_pixels_marked(layers: dict[str, NDArray[Any]], form: Form) -> None:
    status = layers["status"].astype(np.uint32)
    marked = {1: {(3, 4), (5, 6)}} if form == "tif" else {2: {(7, 8), (9, 10), (9, 11)}, 4096: {(9, 12)}}
    for bit, pixels in marked.items():
        assert set(zip(*np.nonzero(status & bit), strict=True)) == pixels
    bad = (status & (1 | 2 | 4096)) != 0
    for name in MAP_LAYERS[:-1]:
        assert np.isnan(layers[name][bad]).all()
    assert np.median(np.abs(layers["direct.depth"] - step_truth())[~bad]) < 0.01


@pytest.mark.parametrize(
    ("frames", "seconds", "text"), [(424, 2.0, "212"), (99, 10.0, "9.9"), (3, 8.5, "0.35"), (1, 3600.0, "0.00028")]
)
def test_the_rate_of_a_slow_run_is_not_rounded_to_0(frames: int, seconds: float, text: str) -> None:
    totals = RunTotals(frames=frames, ok=frames, one_path=1, seconds=seconds)
    assert f"({text} frames/s)" in _summary(totals, ResolveSettings(out=Path("out")))
