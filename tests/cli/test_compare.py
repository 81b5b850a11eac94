"""`cadtof compare`: its figures about two runs, or a run and truth, equal those that numpy computes from the files."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray

from cadtof_cli.files.layers import read_layers
from cadtof_cli.workflows.inspect import compare
from tests.support.captures import layers_of, record, write_exr
from tests.support.forward import step_truth
from tests.support.run_cadtof import cadtof


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two runs on three frames. The second takes every pixel for one path, and has no answer below 0.0917 V."""
    place = tmp_path_factory.mktemp("runs")
    capture = record(place / "capture", frames=3)
    for name, options in (("a", ()), ("b", ("--order", 1, "--min-confidence", "0.0917"))):
        done = cadtof("resolve", capture.folder, "-o", place / name, "-j", 1, "-q", "--mpi-model", "discrete", *options)
        assert done.status == 0
    return place / "a", place / "b"


def _stacked(run: Path, layer: str) -> NDArray[Any]:
    return np.stack([layers_of(run / f"frame_{index}.tif")[layer] for index in range(3)])


def test_figures_of_each_layer_and_each_status_bit(runs: tuple[Path, Path]) -> None:
    done = cadtof("compare", *runs, "--json")
    assert (done.status, done.err) == (0, "")
    found = json.loads(done.out)
    assert found["frames"] == 3
    assert list(found["layers"]) == [name for name in layers_of(runs[0] / "frame_0.tif") if name != "status"]
    for layer, figures in found["layers"].items():
        one, other = (_stacked(run, layer) for run in runs)
        size = np.abs(one.astype(float) - other)
        size = size[np.isfinite(size)]
        expected = [np.median(size), np.quantile(size, 0.9), size.max()] if size.size else None
        assert list(figures) == ["median_abs", "p90_abs", "max_abs"]
        assert list(figures.values()) == ([None] * 3 if expected is None else pytest.approx(expected, rel=1e-6))
        alone = found["answers"].get(layer, {"only_a": 0, "only_b": 0})
        assert alone["only_a"] == np.count_nonzero(np.isfinite(one) & ~np.isfinite(other))
        assert alone["only_b"] == np.count_nonzero(np.isfinite(other) & ~np.isfinite(one)) == 0
    before, after = (_stacked(run, "status").astype(np.uint32) for run in runs)
    assert found["status_changed"] == np.count_nonzero(before != after) > 0
    assert found["status_bits"]["two paths"] == {"gained": 0, "lost": int(np.count_nonzero(before & 16))}
    assert found["status_bits"]["low confidence"]["gained"] == np.count_nonzero(after & 4) > 0
    worst = [frame["p90_abs"] for frame in found["worst"]]
    assert len(worst) == 3
    assert worst == sorted(worst, reverse=True)


def test_a_run_does_not_differ_from_itself(runs: tuple[Path, Path]) -> None:
    assert "differ most" in cadtof("compare", *runs).out
    assert "differ most" not in cadtof("compare", runs[0], runs[0]).out
    found = json.loads(cadtof("compare", runs[0], runs[0], "--json").out)
    assert found["status_changed"] == 0
    assert {figure for layer in found["layers"].values() for figure in layer.values()} == {0.0}
    assert found["status_bits"] == found["answers"] == {}


def test_truth_is_compared_with_every_frame(runs: tuple[Path, Path], tmp_path: Path) -> None:
    truth = tmp_path / "truth.exr"
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32), "other": np.zeros((24, 32), np.float32)})
    for order in ((runs[0], truth), (truth, runs[0])):
        found = json.loads(cadtof("compare", *order, "--json").out)
        size = np.abs(_stacked(runs[0], "direct.depth").astype(float) - step_truth().astype(np.float32))
        assert (found["frames"], list(found["layers"]), found["status_changed"]) == (3, ["direct.depth"], None)
        assert found["layers"]["direct.depth"]["median_abs"] == pytest.approx(np.median(size), rel=1e-6)
        assert {*found["only_a"]["layers"], *found["only_b"]["layers"]} >= {"other", "mpi.depth", "status"}


def test_truth_is_read_once_for_all_frames(
    runs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, read = tmp_path / "truth.exr", list[Path]()
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})

    def counted(path: Path) -> dict[str, NDArray[Any]]:
        read.append(path)
        return read_layers(path)

    monkeypatch.setattr(compare, "read_layers", counted)
    pairs = compare.MapPairs(runs[0], truth)
    for name in pairs.files:
        pairs.pair(name)
    assert (len(read), read.count(truth)) == (4, 1)


def test_truth_of_0_and_less_is_no_value(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """As in `evaluate`: many programs write 0 where they know no depth."""
    holes, truth = step_truth().astype(np.float32), tmp_path / "truth.exr"
    holes[:2], holes[2, :9], holes[2, 9:] = 0.0, -1.0, np.inf
    write_exr(
        truth, {"direct.depth": holes, "mpi.depth": np.zeros_like(holes), "direct.amplitude": np.zeros_like(holes)}
    )
    found = json.loads(cadtof("compare", runs[0], truth, "--json").out)
    size = np.abs(_stacked(runs[0], "direct.depth").astype(float) - holes)[:, 3:]
    assert found["layers"]["direct.depth"]["max_abs"] == pytest.approx(size.max(), rel=1e-6)
    assert found["layers"]["direct.depth"]["p90_abs"] == pytest.approx(np.quantile(size, 0.9), rel=1e-6)
    assert found["layers"]["mpi.depth"]["max_abs"] is None
    assert found["layers"]["direct.amplitude"]["median_abs"] > 0.0
    assert found["answers"]["direct.depth"] == {"only_a": 3 * 3 * 32, "only_b": 0}


def test_two_runs_are_compared_in_a_table_and_a_picture(runs: tuple[Path, Path], tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    done = cadtof("compare", *runs, "-o", picture)
    assert (done.status, done.err) == (0, "")
    assert done.out.splitlines()[0].split() == ["|A", "−", "B|", "median", "90", "%", "largest", "(3", "frames)"]
    assert "two paths" in done.out
    assert "frames that differ most, by 90 % of direct.depth:" in done.out
    assert done.out.splitlines()[-1] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = cadtof("compare", *runs, "-o", picture)
    assert done.status == 2
    assert "already exists; add --overwrite" in done.err


def test_pixels_that_one_run_alone_answers_have_a_colour_of_their_own(runs: tuple[Path, Path], tmp_path: Path) -> None:
    def yellow(other: Path) -> int:
        assert cadtof("compare", runs[0], other, "-o", tmp_path / "a.png", "--overwrite").status == 0
        picture = np.rint(255 * mpl.image.imread(tmp_path / "a.png")[..., :3])
        return int(np.count_nonzero((picture == (240, 228, 66)).all(axis=-1)))

    assert yellow(runs[1]) > 10_000
    assert yellow(runs[0]) == 0


def test_inputs_that_cannot_be_compared_are_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    write_exr(tmp_path / "small.exr", {"direct.depth": np.ones((3, 4), np.float32)})
    (tmp_path / "other").mkdir()
    for index in range(2):
        write_exr(tmp_path / "other" / f"elsewhere_{index}.exr", {"direct.depth": np.ones((24, 32), np.float32)})
    write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    capture = runs[0].parent / "capture"
    assert cadtof("resolve", capture, "-o", tmp_path / "z", "-j", 1, "-q", "--depth", "z").status == 0
    (tmp_path / "z" / "run.json").unlink()
    for other, message in (
        (tmp_path / "gone", "no such file or folder; expected maps"),
        (tmp_path / "small.exr", "found 4 × 3 pixels, expected 32 × 24 as in"),
        (tmp_path / "other", "share no frame: found frame_0, frame_1, frame_2 … and elsewhere_0, elsewhere_1 …"),
        (tmp_path / "z", "resolve both with the same --depth"),
    ):
        # the record of one of two runs tells the optics of both, but truth has none
        first = tmp_path / "truth.exr" if other.name == "z" else runs[0]
        done = cadtof("compare", first, other)
        assert (done.status, done.out) == (2, "")
        assert message in done.err


@pytest.mark.parametrize("kinds", [("range", "z"), ("z", "range")])
@pytest.mark.parametrize("roi", [None, "3,2,20,24"])
def test_depths_of_b_become_those_of_a(
    runs: tuple[Path, Path], tmp_path: Path, kinds: tuple[str, str], roi: str | None
) -> None:
    capture, part = runs[0].parent / "capture", () if roi is None else ("--roi", roi)
    assert cadtof("resolve", capture, "-o", tmp_path / kinds[0], "-j", 1, "-q", "--depth", kinds[0]).status == 0
    assert cadtof("resolve", capture, "-o", tmp_path / kinds[1], "-j", 1, "-q", "--depth", kinds[1], *part).status == 0
    done = cadtof("compare", tmp_path / kinds[0], tmp_path / kinds[1], "--json")
    assert "converted into" in done.err
    found = json.loads(done.out)
    for name in ("direct.depth", "direct.sigma", "mpi.depth"):
        assert found["layers"][name]["max_abs"] < 1e-6
    # truth is range, whatever the maps are
    truth = tmp_path / "truth.exr"
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})
    of_truth = [json.loads(cadtof("compare", tmp_path / kind, truth, "--json").out) for kind in kinds]
    assert of_truth[0]["layers"]["direct.depth"]["median_abs"] < 0.01
    assert of_truth[1]["layers"]["direct.depth"]["median_abs"] < 0.01


def test_frames_that_only_one_run_has_are_named(runs: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert cadtof("resolve", runs[0].parent / "capture", "-o", out, "-j", 1, "-q", "--frames", "1:3").status == 0
    found = json.loads(cadtof("compare", runs[0], out, "--json").out)
    assert (found["frames"], found["only_a"]["frames"], found["only_b"]["frames"]) == (2, ["frame_0"], [])
    assert "only A has the frames frame_0" in cadtof("compare", runs[0], out).out


def test_single_frames_of_two_runs_with_other_names_are_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """They were compared as if they were one frame, and no line said so."""
    capture = runs[0].parent / "capture"
    for frame in "12":
        assert cadtof("resolve", capture, "-o", tmp_path / frame, "-j", 1, "-q", "--frames", frame).status == 0
    done = cadtof("compare", tmp_path / "1", tmp_path / "2")
    assert (done.status, done.out) == (2, "")
    assert "share no frame: found frame_1 … and frame_2 …" in done.err
    # a file that the user names is compared with every frame
    assert cadtof("compare", tmp_path / "1", tmp_path / "2" / "frame_2.tif").status == 0


def test_a_run_is_compared_with_the_folder_of_its_capture_in_a_run_of_several(
    runs: tuple[Path, Path], tmp_path: Path
) -> None:
    record(tmp_path / "other", seed=3)
    several, capture = tmp_path / "several", runs[0].parent / "capture"
    arguments = (capture, tmp_path / "other", "-o", several, "-j", 1, "-q", "--mpi-model", "discrete")
    assert cadtof("resolve", *arguments).status == 0
    (folder,) = several.rglob("capture")
    found = json.loads(cadtof("compare", runs[0], folder, "--json").out)
    assert (found["frames"], found["status_changed"], found["only_a"]["frames"]) == (3, 0, [])


def test_inputs_without_a_common_layer_are_refused_and_their_layers_named(
    runs: tuple[Path, Path], tmp_path: Path
) -> None:
    file, picture = tmp_path / "others.exr", tmp_path / "a.png"
    write_exr(file, {name: np.ones((24, 32), np.float32) for name in ("beta", "alpha")})
    of_run = ", ".join(sorted(layers_of(runs[0] / "frame_0.tif")))
    for options in ((), ("--json",), ("-o", picture)):
        done = cadtof("compare", runs[0], file, *options)
        assert (done.status, done.out) == (2, "")
        assert f"{runs[0]} and {file} have no layer in common: found {of_run} in A and alpha, beta in B; " in done.err
    assert not picture.exists()
    assert f"found alpha, beta in A and {of_run} in B" in cadtof("compare", file, runs[0]).err


def test_status_alone_is_enough_to_compare(runs: tuple[Path, Path], tmp_path: Path) -> None:
    write_exr(tmp_path / "status.exr", {"status": np.zeros((24, 32), np.uint32)})
    done = cadtof("compare", runs[0], tmp_path / "status.exr")
    assert done.status == 0
    assert "status differs" in done.out
    done = cadtof("compare", runs[0], tmp_path / "status.exr", "-o", tmp_path / "a.png")
    assert (done.status, done.err) == (0, "")
