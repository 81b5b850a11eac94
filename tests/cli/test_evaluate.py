"""`cadtof evaluate`: its errors against truth equal numbers that the tests compute."""

import csv
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from cadtof_cli.files.maps import DepthMaps
from tests.support.captures import VOLTS_PER_COUNT, ZERO_COUNTS, layers_of, record, write_exr, write_frame, write_maps
from tests.support.forward import AMPLITUDE_V, C_M_PER_NS, T1_NS, Light, depth_m, step_frame, step_truth
from tests.support.run_cadtof import cadtof, program

KEYS = ["median_cm", "p90_cm", "rmse_cm", "bias_cm", "valid", "within_1_sigma", "within_2_sigma"]


def _truth(path: Path, *, known: NDArray[np.bool_] | None = None, height: int = 24) -> Path:
    truth = step_truth(height=height).astype(np.float32)
    if known is not None:
        truth[~known] = np.nan
    write_exr(path, {"direct.depth": truth})
    return path


@pytest.mark.parametrize("no_depth", [0.0, -1.0, np.inf])
def test_a_truth_without_a_depth_does_not_count(no_depth: float, tmp_path: Path) -> None:
    """Depth cameras write 0 where they know no depth, and renderers infinity where there is no surface."""
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    known = np.random.default_rng(1).random((24, 32)) < 0.8
    truth = np.where(known, step_truth(), no_depth).astype(np.float32)
    write_exr(tmp_path / "marked.exr", {"direct.depth": truth})
    _truth(tmp_path / "nan.exr", known=known)
    for command in (("evaluate", out), ("profile", out, "--row", 3)):
        marked, expected = (cadtof(*command, "--truth", tmp_path / name).out for name in ("marked.exr", "nan.exr"))
        assert marked == expected != ""


def _expected(errors_cm: NDArray[Any], valid: float) -> dict[str, Any]:
    size = np.abs(errors_cm)
    return {
        "median_cm": pytest.approx(np.quantile(size, 0.5), rel=1e-5),
        "p90_cm": pytest.approx(np.quantile(size, 0.9), rel=1e-5),
        "rmse_cm": pytest.approx(np.sqrt(np.mean(size**2)), rel=1e-5),
        "bias_cm": pytest.approx(np.mean(errors_cm), rel=1e-4, abs=1e-6),
        "valid": pytest.approx(valid),
    }


def _first_phasor_m(file: Path) -> NDArray[Any]:
    volts = VOLTS_PER_COUNT * (tifffile.imread(file).astype(np.float64) - ZERO_COUNTS)
    phase = np.arctan2(volts[1], volts[0]) % (2 * np.pi)
    return np.asarray(phase * C_M_PER_NS * T1_NS / (4 * np.pi))


def test_maps_come_in_the_order_of_time(tmp_path: Path) -> None:
    """Frames are numbered without zeros in front: frame_10 is recorded after frame_2."""
    capture, out = record(tmp_path / "capture", frames=12), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    arguments = ("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"), "--csv", tmp_path / "table.csv")
    assert cadtof(*arguments).status == 0
    with (tmp_path / "table.csv").open(newline="") as table:
        assert [row["frame"] for row in csv.DictReader(table)] == [f"frame_{number}" for number in range(12)]
    third = cadtof("profile", out, "--row", 3, "--frame", 2).out
    assert third.splitlines()[1:] == cadtof("profile", out / "frame_2.tif", "--row", 3).out.splitlines()[1:]


def test_errors_equal_those_computed_from_the_maps(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3), tmp_path / "out"
    pages = tifffile.imread(capture.files[0])
    pages[:, 5, 6] = 16383
    tifffile.imwrite(capture.files[0], pages, photometric="minisblack", metadata=None)
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    known = np.random.default_rng(1).random((24, 32)) < 0.8
    known[5, 6] = True
    truth = _truth(tmp_path / "truth.exr", known=known)
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert (done.status, done.err) == (0, "")
    found = json.loads(done.out)
    assert list(found) == ["frames", "direct", "first_phasor"]
    assert found["frames"] == 3
    assert list(found["direct"]) == list(found["first_phasor"]) == KEYS
    valid = (3 * known.sum() - 1) / (3 * known.sum())
    direct = [layers_of(out / f"frame_{index}.tif")["direct.depth"] for index in range(3)]
    first = [_first_phasor_m(file) for file in capture.files]
    first[0][5, 6] = np.nan
    for name, depths in (("direct", direct), ("first_phasor", first)):
        errors = 100 * (np.stack(depths).astype(np.float64) - step_truth().astype(np.float32))[:, known]
        shares = [found[name].pop(share) for share in KEYS[-2:]]
        assert found[name] == _expected(errors[np.isfinite(errors)], valid)
        if name == "first_phasor":
            assert shares == [None, None]
            continue
        sigma = 100 * np.stack([layers_of(out / f"frame_{index}.tif")["direct.sigma"] for index in range(3)])[:, known]
        ratio = (np.abs(errors) / sigma)[np.isfinite(errors)]
        assert shares == pytest.approx([np.mean(ratio <= 1), np.mean(ratio <= 2)], abs=0.002)
    assert found["direct"]["rmse_cm"] < 2
    assert found["first_phasor"]["rmse_cm"] > 10


def test_the_first_phasor_of_a_far_wall_lies_in_the_far_half_of_the_range(tmp_path: Path) -> None:
    """25 ns are 3.75 m, which is more than half of the range of 6 m. So the phase is above π; it is not negative."""
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    far = Light(asr=2.0, direct_ns=25.0).voltages(np.random.default_rng(1), 1e5, 24 * 32)
    write_frame(capture.files[0], AMPLITUDE_V * far.reshape(2, 2, 24, 32))
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    write_exr(tmp_path / "truth.exr", {"direct.depth": np.full((24, 32), depth_m(25.0), np.float32)})
    found = json.loads(cadtof("evaluate", out, "--truth", tmp_path / "truth.exr", "--json").out)
    assert found["first_phasor"]["rmse_cm"] < 1.0
    assert found["direct"]["rmse_cm"] < 1.0


def test_one_map_is_evaluated_and_shown_in_a_table(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    done = cadtof("evaluate", out / "frame_1.tif", "--truth", _truth(tmp_path / "truth.exr"))
    assert (done.status, done.err) == (0, "")
    title, first, direct, about = done.out.splitlines()
    assert "median" in title
    assert about.startswith("1 frame; ")
    # a terminal has 80 columns unless somebody has made it wider
    assert len(title) == len(first) == len(direct) < 80
    error = 100 * (_first_phasor_m(capture.files[1]) - step_truth())
    assert first.startswith("first phasor")
    assert float(first.split()[3]) == pytest.approx(np.quantile(np.abs(error), 0.9), abs=0.02)
    assert float(first.split()[5]) == pytest.approx(error.mean(), abs=0.01)
    assert direct.startswith("direct path")
    assert direct.split()[-3] == "100.0%"
    sigma = layers_of(out / "frame_1.tif")["direct.sigma"]
    off = np.abs(layers_of(out / "frame_1.tif")["direct.depth"] - step_truth())
    assert direct.split()[-2:] == [f"{np.mean(off <= k * sigma):.1%}" for k in (1, 2)]
    assert first.split()[-2:] == ["–", "–"]


def test_recordings_that_are_gone_cost_only_the_first_phasor(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    truth = _truth(tmp_path / "truth.exr")
    shutil.rmtree(capture.folder)
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert "the recorded frames are no longer where they were, so the first phasor is left out" in done.err
    assert (done.status, json.loads(done.out)["first_phasor"]) == (0, None)
    record_of_run = (out / "run.json").read_text()
    (out / "run.json").write_text(record_of_run.replace('"captures"', '"ceptures"'))
    assert cadtof("evaluate", out, "--truth", truth).status == 0
    for content in ("{", "[]", '{"arguments": 3}', None):
        if content is None:
            (out / "run.json").unlink()
        else:
            (out / "run.json").write_text(content)
        done = cadtof("evaluate", out, "--truth", truth)
        why = "no run.json beside the maps" if content is None else f"{out / 'run.json'}: not the record of a run ("
        assert (done.status, done.err.count("\n")) == (0, 1)
        assert done.err.startswith(why)
        assert done.err.endswith(", so the first phasor is left out\n")
        assert "direct path" in done.out


def test_a_recorded_frame_that_is_another_one_now_costs_only_its_first_phasor(tmp_path: Path) -> None:
    """Of four frames one is sound, one damaged, one of another content, and one of another size that its line does not tell."""
    capture, out = record(tmp_path / "capture", frames=4), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    capture.files[1].write_bytes(b"II*\0 and no more")
    write_frame(capture.files[2], step_frame(np.random.default_rng(9)))
    write_frame(capture.files[3], step_frame(np.random.default_rng(9))[..., :5, :])
    lines = [json.loads(line) for line in (out / "frames.jsonl").read_text().splitlines()]
    lines[3]["digest"] = None
    (out / "frames.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    table = tmp_path / "table.csv"
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"), "--csv", table)
    assert done.status == 0
    left_out = "so the first phasor is left out"
    assert (
        f"{out / 'frame_1.tif'}: its recorded frame cannot be read any more, {left_out}: {capture.files[1]}" in done.err
    )
    assert f"{out / 'frame_2.tif'}: its recorded frame has changed since the run, {left_out}\n" in done.err
    assert f"{out / 'frame_3.tif'}: its recorded frame has another size now, {left_out}\n" in done.err
    with table.open(newline="") as rows:
        assert [bool(row["first_phasor_median_cm"]) for row in csv.DictReader(rows)] == [True, False, False, False]


def test_a_map_whose_frame_is_not_known_is_named(tmp_path: Path) -> None:
    """Else the two lines of the table would be about other frames each."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.files[0], "-o", out, "-j", 1).status == 0
    shutil.copy(out / "frame_0.tif", out / "frame_7.tif")
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"))
    assert done.status == 0
    assert done.err == (
        f"{out / 'frame_7.tif'}: run.json names no recorded frame of it, so the first phasor is left out\n"
    )
    done = cadtof("evaluate", out, "--over-time", tmp_path / "scatter.exr")
    assert (done.status, done.err) == (
        0,
        f"{out / 'frame_7.tif'}: frames.jsonl does not name it, so it may be of another run; it is counted all the same\n",
    )


def test_a_line_that_names_files_of_no_frame_costs_only_the_first_phasor(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    first, second = (out / "frames.jsonl").read_text().splitlines()
    line = json.loads(first)
    line["files"][0]["name"] = "another.tif"
    (out / "frames.jsonl").write_text(f"{json.dumps(line)}\n{second}\n")
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"))
    assert (done.status, done.err) == (
        0,
        f"{out / 'frame_0.tif'}: run.json names no recorded frame of it, so the first phasor is left out\n",
    )
    (out / "frame_1.tif").unlink()
    done = cadtof("evaluate", out, "--truth", tmp_path / "truth.exr")
    assert (done.status, done.err.splitlines()[-1]) == (
        0,
        f"{out}: its records name no recorded frame of any map, so the first phasor is left out",
    )


def test_frames_of_the_run_without_maps_are_counted(tmp_path: Path) -> None:
    """Else the errors of a run look as good if half of its frames failed."""
    capture, out = record(tmp_path / "capture", frames=3), tmp_path / "out"
    capture.files[1].write_bytes(capture.files[1].read_bytes()[:1000])
    truth = _truth(tmp_path / "truth.exr")
    # no frame, so it is skipped
    shutil.copy(truth, capture.folder / "map_b.exr")
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 1
    one = cadtof("evaluate", out / "frame_0.tif", "--truth", truth)
    assert (one.status, one.err) == (0, "")
    done = cadtof("evaluate", out, "--truth", truth)
    assert done.err == f"{out}: 1 frame of the run without maps, not compared: see frames.jsonl\n"
    (out / "frame_2.tif").unlink()
    done = cadtof("evaluate", out, "--truth", truth)
    assert done.err == f"{out}: 2 frames of the run without maps, not compared: see frames.jsonl\n"
    done = cadtof("evaluate", out, "--over-time", tmp_path / "scatter.exr")
    assert done.err == f"{out}: 2 frames of the run without maps, not compared: see frames.jsonl\n"
    # the maps are compared all the same if the record of the frames is lost
    (out / "frames.jsonl").unlink()
    (out / "frames.jsonl").mkdir()
    done = cadtof("evaluate", out, "--truth", truth)
    told = f"frames of the run without maps are not counted: {out}/frames.jsonl: cannot be read: Is a directory\n"
    assert (done.status, done.err) == (0, told)


def test_a_run_that_has_not_finished_is_told(tmp_path: Path) -> None:
    """Else the errors of a run that was stopped after its first frame look like those of all frames."""
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    truth = _truth(tmp_path / "truth.exr")
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    assert cadtof("evaluate", out, "--truth", truth).err == ""
    # as a killed run leaves them
    (out / "frame_1.tif").unlink()
    (out / "frames.jsonl").write_text((out / "frames.jsonl").read_text().splitlines(keepends=True)[0])
    run = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**run, "finished": False, "totals": None}))
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    hint = "if it was stopped, `cadtof resolve --resume` completes it"
    told = f"{out}: the run has not finished, so frames may be missing; {hint}\n"
    assert (done.status, done.err, json.loads(done.out)["frames"]) == (0, told, 1)
    assert cadtof("evaluate", out, "--over-time", tmp_path / "scatter.exr").err == told
    assert cadtof("evaluate", out / "frame_0.tif", "--truth", truth).err == ""
    others: dict[str, list[object]] = {
        "compare": [truth],
        "preview": ["-o", tmp_path / "picture.png"],
        "profile": ["--row", 1, "--no-first-phasor"],
        "export": ["-o", tmp_path / "maps.npz"],
    }
    for command, more in others.items():
        done = cadtof(command, out, *more)
        assert (done.status, done.err) == (0, told), command
    assert cadtof("compare", out, out).err == told


def test_links_in_a_circle_among_maps(tmp_path: Path) -> None:
    """Two links to the folder that they lie in make 2⁴⁰ paths before the system reports too many links."""
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    truth = _truth(tmp_path / "truth.exr")
    for name in "ab":
        (out / name).symlink_to(".")
    done = cadtof("evaluate", out, "--truth", truth, "--json")
    assert (done.status, json.loads(done.out)["frames"]) == (0, 1)


def test_a_signalling_nan_in_truth_causes_no_warning(tmp_path: Path) -> None:
    """A signalling NaN in truth, which numpy warns of when it is converted, causes no warning."""
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    truth = np.full((24, 32), 1.0, np.float32)
    truth.view(np.uint32)[0, 0] = 0x7F800001
    write_exr(tmp_path / "truth.exr", {"direct.depth": truth})
    done = program("evaluate", out, "--truth", tmp_path / "truth.exr")
    assert (done.status, done.err) == (0, "")


def test_maps_without_an_answer(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    names = ("direct.depth", "mpi.depth", "confidence")
    pages = np.full((len(names) + 1, 24, 32), np.nan, np.float32)
    write_maps(out / "frame_0.tif", DepthMaps(names, pages, np.full((24, 32), 4, np.uint32)))
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"), "--json")
    assert done.status == 0
    assert json.loads(done.out)["direct"] == dict.fromkeys(KEYS) | {"valid": 0.0}
    assert "–" in cadtof("evaluate", out, "--truth", tmp_path / "truth.exr").out


def test_another_layer_of_depths_is_compared_without_the_first_phasor(tmp_path: Path) -> None:
    """The right half of the step has MPI at 20 ns."""
    capture, truth = record(tmp_path / "capture"), tmp_path / "truth.exr"
    write_frame(capture.files[0], step_frame(np.random.default_rng(0)))
    second = np.full((24, 32), np.nan, np.float32)
    second[:, 16:] = depth_m(20.0)
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32), "mpi.depth": second})
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "--mpi-model", "discrete").status == 0
    done = cadtof("evaluate", tmp_path / "out", "--truth", truth, "--layer", "mpi.depth", "--json")
    found = json.loads(done.out)
    layers = layers_of(tmp_path / "out" / "frame_0.tif")
    errors_cm = 100.0 * (layers["mpi.depth"] - second)[:, 16:].astype(float)
    ratio = np.abs(errors_cm) / (100.0 * layers["mpi.sigma"][:, 16:])
    assert list(found) == ["frames", "mpi"]
    assert found["mpi"]["rmse_cm"] == pytest.approx(np.sqrt(np.nanmean(errors_cm**2)), rel=1e-4)
    assert found["mpi"]["valid"] == pytest.approx(np.mean(np.isfinite(errors_cm)))
    assert found["mpi"]["within_1_sigma"] == pytest.approx(np.mean(ratio[np.isfinite(ratio)] <= 1.0))
    shown = cadtof("evaluate", tmp_path / "out", "--truth", truth, "--layer", "mpi.depth").out.splitlines()
    assert [line.split()[0] for line in shown] == ["error,", "mpi", "1"]
    for options, message in (
        (("--layer", "confidence"), "--layer: found 'confidence', expected a layer of depths such as mpi.depth"),
        (("--layer", "path3.depth"), "expected path3.depth"),
    ):
        refused = cadtof("evaluate", tmp_path / "out", "--truth", truth, *options)
        assert (refused.status, message in refused.err) == (2, True)


@pytest.mark.parametrize("roi", [None, "3,2,20,24"])
def test_truth_becomes_the_kind_of_depth_that_the_maps_hold(tmp_path: Path, roi: str | None) -> None:
    """z over range is 1/√(1 + X² + Y²), with a focal length of 28 px and the axis at column 15, row 10."""
    capture, truth = record(tmp_path / "capture"), _truth(tmp_path / "truth.exr")
    write_frame(capture.files[0], step_frame(np.random.default_rng(0)))
    part = () if roi is None else ("--roi", roi)
    found = {}
    for kind in ("range", "z"):
        out = tmp_path / kind
        assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "--depth", kind, *part).status == 0
        found[kind] = json.loads(cadtof("evaluate", out, "--truth", truth, "--json").out)["direct"]
        assert cadtof("preview", out, "--truth", truth, "-o", tmp_path / f"{kind}.png").status == 0
        assert cadtof("report", out, "--truth", truth, "-o", tmp_path / f"{kind}.html").status == 0
    x0, y0, x1, y1 = map(int, (roi or "0,0,32,24").split(","))
    x, y = (np.arange(32) - 15.0) / 28.0, (np.arange(24)[:, np.newaxis] - 10.0) / 28.0
    planar = (1.0 / np.sqrt(1.0 + x * x + y * y))[y0:y1, x0:x1]
    depth = layers_of(tmp_path / "z" / "frame_0.tif")["direct.depth"]
    errors_cm = 100.0 * (depth - step_truth()[y0:y1, x0:x1] * planar)
    assert found["z"]["rmse_cm"] == pytest.approx(np.sqrt(np.nanmean(errors_cm**2)), rel=1e-4)
    for key in ("valid", "within_1_sigma", "within_2_sigma"):
        assert found["z"][key] == pytest.approx(found["range"][key], abs=0.01)
    # maps of the one kind are truth for maps of the other
    same = cadtof("evaluate", tmp_path / "z", "--truth", tmp_path / "range" / "frame_0.tif", "--json")
    assert json.loads(same.out)["direct"]["rmse_cm"] < 1e-4


def test_inputs_that_cannot_be_evaluated_are_refused(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    write_frame(capture.files[0], step_frame(np.random.default_rng(0)))
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "z", "-j", 1, "--depth", "z").status == 0
    (tmp_path / "z" / "run.json").unlink()
    truth, small = _truth(tmp_path / "truth.exr"), _truth(tmp_path / "small.exr", height=20)
    write_exr(tmp_path / "other.exr", {"Y": np.zeros((24, 32), np.float32)})
    (tmp_path / "empty").mkdir()
    for maps, against, message in (
        (out, small, f"{out / 'frame_0.tif'}: found 32 × 24 pixels, expected 32 × 20 as in {small}"),
        (out, tmp_path / "other.exr", f"{tmp_path / 'other.exr'}: found layers Y; expected direct.depth"),
        (
            out,
            tmp_path / "gone.exr",
            f"{tmp_path / 'gone.exr'}: no such file or folder; expected the truth of the maps",
        ),
        (tmp_path / "gone", truth, f"{tmp_path / 'gone'}: no such file or folder; expected maps that"),
        (tmp_path / "empty", truth, f"{tmp_path / 'empty'}: found no maps (.exr, .tif), expected those of"),
        (
            tmp_path / "z",
            truth,
            f"{truth}: holds radial range and {tmp_path / 'z'} planar depth z, and no run.json tells the optics",
        ),
    ):
        done = cadtof("evaluate", maps, "--truth", against)
        assert f"Error: {message}" in done.err
        assert (done.status, done.out) == (2, "")
    counts, volts = record(tmp_path / "counts").folder, record(tmp_path / "volts", form="exr").folder
    for recorded, hint in (
        (counts, "as `cadtof resolve` writes it"),
        (volts, "`cadtof resolve` makes maps of voltages"),
    ):
        assert cadtof("evaluate", recorded, "--truth", truth).err.endswith(f"{hint}\n")


def test_a_limit_of_the_median_a_table_of_frames_and_maps_over_time(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=4), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--mpi-model", "discrete").status == 0
    truth = _truth(tmp_path / "truth.exr")
    found = json.loads(cadtof("evaluate", out, "--truth", truth, "--json").out)
    median = found["direct"]["median_cm"]
    for limit, status in ((1.01 * median, 0), (median, 0), (math.nextafter(median, 0.0), 1), (0.9 * median, 1)):
        done = cadtof("evaluate", out, "--truth", truth, "--max-median", limit)
        assert done.status == status
        assert ("(--max-median)" in done.err) == (status == 1)
        told = re.search(r"found a median error of (\S+) cm, expected at most (\S+) cm", done.err)
        if told:
            # the message never says that it found what it expected
            assert float(told[1]) > float(told[2]) == limit
            assert float(told[1]) == pytest.approx(median, rel=0.005)
        assert bool(told) == (status == 1)
        assert "direct path" in done.out
    table, scatter = tmp_path / "frames.csv", tmp_path / "scatter.exr"
    done = cadtof("evaluate", out, "--truth", truth, "--csv", table, "--over-time", scatter, "--json")
    assert (done.status, done.err) == (0, "")
    lines = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [line["frame"] for line in lines] == [f"frame_{index}" for index in range(4)]
    depths = np.stack([layers_of(out / f"frame_{index}.tif")["direct.depth"] for index in range(4)]).astype(float)
    for line, depth in zip(lines, depths, strict=True):
        error = 100 * (depth - step_truth().astype(np.float32))
        assert float(line["rmse_cm"]) == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-5)
        assert float(line["first_phasor_rmse_cm"]) > float(line["rmse_cm"])
    layers = layers_of(scatter)
    np.testing.assert_allclose(layers["direct.mean"], depths.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(layers["direct.std"], depths.std(axis=0, ddof=1), rtol=1e-4)
    assert (layers["direct.frames"] == 4).all()
    assert json.loads(cadtof("info", scatter, "--json").out)["layers"]["direct.std"]["unit"] == "m"
    over = json.loads(done.out)["over_time"]
    assert over["median_std_cm"] == pytest.approx(100 * np.median(depths.std(axis=0, ddof=1)), rel=1e-4)
    done = cadtof("evaluate", out, "--over-time", scatter)
    assert (done.status, "already exists" in done.err) == (2, True)
    done = cadtof("evaluate", out, "--over-time", scatter, "--overwrite")
    assert (done.status, done.out.startswith("over 4 frames: direct depth scatters by ")) == (0, True)
    done = cadtof("evaluate", out)
    assert (done.status, "--truth is missing" in done.err) == (2, True)


def test_one_frame_has_no_scatter_over_time(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    done = cadtof("evaluate", out, "--over-time", tmp_path / "scatter.exr")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("over 1 frame: no pixel has depths in two frames; predicted sigma of the median pixel: ")
    done = cadtof("evaluate", out, "--over-time", tmp_path / "scatter.tif")
    assert (done.status, "found the suffix '.tif', expected .exr" in done.err) == (2, True)
    assert not (tmp_path / "scatter.tif").exists()


def test_a_limit_of_the_median_fails_if_no_pixel_has_an_answer(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    pages = np.full((2, 24, 32), np.nan, np.float32)
    write_maps(out / "frame_0.tif", DepthMaps(("direct.depth",), pages, np.full((24, 32), 4, np.uint32)))
    done = cadtof("evaluate", out, "--truth", _truth(tmp_path / "truth.exr"), "--max-median", 5)
    assert done.status == 1
    assert "failed: found no pixel with truth and an answer, expected at most 5 cm (--max-median)" in done.err


@pytest.mark.parametrize("per_metre", [1000.0, 100.0])
def test_truth_in_another_unit_is_refused(per_metre: float, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture"), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1).status == 0
    truth = _truth(tmp_path / "truth.exr")
    write_exr(truth, {"direct.depth": per_metre * layers_of(truth)["direct.depth"]})
    done = cadtof("evaluate", out, "--truth", truth)
    assert done.status == 2
    assert f"{truth}: found true depths of " in done.err
    assert "expected metres: are they in mm or cm?" in done.err
