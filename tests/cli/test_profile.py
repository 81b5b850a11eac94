"""`cadtof profile`: the values along a line are those of the pixels of the maps."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.captures import layers_of, record, write_exr
from tests.support.forward import step_truth
from tests.support.run_cadtof import cadtof


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    place = tmp_path_factory.mktemp("runs")
    capture = record(place / "capture", frames=2)
    for name, options in (("two", ()), ("one", ("--order", 1))):
        done = cadtof("resolve", capture.folder, "-o", place / name, "-j", 1, "-q", "--mpi-model", "discrete", *options)
        assert done.status == 0
    write_exr(place / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    return place / "two", place / "one"


def _table(text: str) -> dict[str, np.ndarray]:
    lines = list(csv.DictReader(text.splitlines()))
    return {name: np.array([float(line[name] or "nan") for line in lines]) for name in lines[0]}


LINES = {
    ("--row", "7"): ([7] * 32, list(range(32))),
    ("--column", "30"): (list(range(24)), [30] * 24),
    ("--line", "2,3,8,6"): ([3, 4, 4, 4, 5, 6, 6], list(range(2, 9))),
    ("--line", "9,20,9,18"): ([20, 19, 18], [9, 9, 9]),
}


@pytest.mark.parametrize("line", LINES)
def test_a_table_holds_the_pixels_of_the_line(line: tuple[str, str], runs: tuple[Path, Path]) -> None:
    truth = runs[0].parent / "truth.exr"
    done = cadtof("profile", *runs, *line, "--truth", truth, "--frame", 1)
    assert (done.status, done.err) == (0, "")
    found = _table(done.out)
    rows, columns = LINES[line]
    np.testing.assert_array_equal(found["x"], columns)
    if line != ("--line", "2,3,8,6"):
        np.testing.assert_array_equal(found["y"], rows)
    rows = found["y"].astype(int).tolist()
    assert np.abs(np.array(rows) - LINES[line][0]).max() <= 1
    for run in runs:
        layers = layers_of(run / "frame_1.tif")
        np.testing.assert_allclose(found[run.name], layers["direct.depth"][rows, columns], rtol=1e-7)
        np.testing.assert_allclose(found[f"{run.name} sigma"], layers["direct.sigma"][rows, columns], rtol=1e-7)
    np.testing.assert_allclose(found["truth"], step_truth()[rows, columns], rtol=1e-6)
    far = found["truth"] > 1.0
    off = np.abs(found["two first phasor"] - found["truth"])
    assert off[far].min(initial=1.0) > 0.05
    assert off[~far].max(initial=0.0) < 0.05


def test_other_layers_and_pixels_without_a_value(runs: tuple[Path, Path]) -> None:
    found = _table(cadtof("profile", runs[0] / "frame_0.tif", "--row", 3, "--layer", "mpi.depth").out)
    assert list(found) == ["x", "y", "two", "two sigma"]
    np.testing.assert_array_equal(np.isnan(found["two"]), np.isnan(layers_of(runs[0] / "frame_0.tif")["mpi.depth"][3]))
    found = _table(cadtof("profile", runs[0], "--row", 3, "--layer", "confidence").out)
    assert list(found) == ["x", "y", "two"]


def test_a_profile_is_written_as_picture_or_table(runs: tuple[Path, Path], tmp_path: Path) -> None:
    truth = runs[0].parent / "truth.exr"
    for name in ("a.png", "a.svg", "a.csv"):
        arguments = ("profile", *runs, "--row", 3, "--truth", truth, "-o", tmp_path / name)
        done = cadtof(*arguments)
        assert (done.status, done.out, done.err) == (0, f"{tmp_path / name}\n", "")
        assert (cadtof(*arguments).status, cadtof(*arguments, "--overwrite").status) == (2, 0)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.csv").read_text() == cadtof("profile", *runs, "--row", 3, "--truth", truth).out
    # an SVG holds letters as outlines, with the text as a comment: both runs, one first phasor for both, truth, errors
    words = set(re.findall(r"<!-- (.*?) -->", (tmp_path / "a.svg").read_text()))
    assert {"two", "one", "first phasor", "truth", "radial range, m", "error, cm", "column, px"} <= words
    assert "direct.depth, row 3 of frame_0" in words


def test_planar_truth_for_planar_maps(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """z over range is 1/√(1 + X² + Y²), with a focal length of 28 px and the axis at column 15, row 10."""
    out, truth = tmp_path / "z", runs[0].parent / "truth.exr"
    capture = runs[0].parent / "capture"
    assert cadtof("resolve", capture, "-o", out, "-j", 1, "-q", "--depth", "z").status == 0
    found = _table(cadtof("profile", out, "--row", 4, "--truth", truth).out)
    slope = np.hypot((np.arange(32) - 15.0) / 28.0, (4 - 10.0) / 28.0)
    np.testing.assert_allclose(found["truth"], step_truth()[4] / np.sqrt(1 + slope**2), rtol=1e-6)
    half = found["x"] < 16
    assert np.abs(found["z first phasor"] - found["truth"])[half].max() < 0.05
    done = cadtof("profile", out, runs[0], "--row", 4)
    assert (done.status, ": resolve both with the same --depth" in done.err) == (2, True)
    # maps of planar depth may be the truth of ranges
    against_z = ("profile", runs[0], "--row", 4, "--truth", out / "frame_0.tif")
    truth_of_range = _table(cadtof(*against_z).out)["truth"]
    np.testing.assert_allclose(truth_of_range, layers_of(runs[0] / "frame_0.tif")["direct.depth"][4], rtol=1e-5)
    found = _table(cadtof(*against_z, "--layer", "confidence").out)
    np.testing.assert_allclose(found["truth"], layers_of(out / "frame_0.tif")["confidence"][4], rtol=1e-6)


def test_planar_truth_of_the_pixels_of_a_roi_alone(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """The optical axis lies at column 15, row 10 of the frame, whichever part of it truth and maps hold."""
    capture, out, truth = runs[0].parent / "capture", tmp_path / "z", tmp_path / "part.exr"
    write_exr(truth, {"direct.depth": step_truth()[2:12, 4:20].astype(np.float32)})
    options = ("-j", 1, "-q", "--depth", "z", "--roi", "4,2,20,12")
    assert cadtof("resolve", capture, "-o", out, *options).status == 0
    slope = np.hypot((np.arange(4, 20) - 15.0) / 28.0, (6 - 10.0) / 28.0)
    for given in (truth, runs[0].parent / "truth.exr"):
        found = _table(cadtof("profile", out, "--row", 4, "--truth", given).out)
        np.testing.assert_allclose(found["truth"], step_truth()[6, 4:20] / np.sqrt(1 + slope**2), rtol=1e-6)


def test_planar_truth_of_a_roi_needs_the_principal_point(tmp_path: Path) -> None:
    """Without a principal point, the axis is in the middle of the frame, and truth of a part does not tell where that is."""
    capture, out, truth = record(tmp_path / "capture"), tmp_path / "z", tmp_path / "part.exr"
    settings = capture.folder / "capture.toml"
    lines = settings.read_text().splitlines(keepends=True)
    settings.write_text("".join(line for line in lines if not line.startswith("principal_point_px")))
    write_exr(truth, {"direct.depth": step_truth()[2:12, 4:20].astype(np.float32)})
    options = ("-j", 1, "-q", "--depth", "z", "--roi", "4,2,20,12")
    assert cadtof("resolve", capture.folder, "-o", out, *options).status == 0
    done = cadtof("profile", out, "--row", 4, "--truth", truth)
    assert (done.status, done.out) == (2, "")
    assert f"{truth}: holds only the pixels of --roi, and run.json names no principal point" in done.err


def test_maps_of_other_pixels_are_not_drawn_together(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """The maps have the same size, so a picture would not show that they are different parts of a frame."""
    capture = runs[0].parent / "capture"
    for roi in ("0,0,16,12", "16,12,32,24"):
        assert cadtof("resolve", capture, "-o", tmp_path / roi, "-j", 1, "-q", "--roi", roi).status == 0
    done = cadtof("profile", tmp_path / "0,0,16,12", tmp_path / "16,12,32,24", "--row", 1)
    assert (done.status, done.out) == (2, "")
    assert "0,0,16,12 shows pixels 0,0,16,12 and " in done.err
    assert "16,12,32,24: resolve both with the same --roi" in done.err
    for roi, status in (("0,0,32,24", 0), ("1,1,32,24", 2)):
        assert cadtof("resolve", capture, "-o", tmp_path / roi, "-j", 1, "-q", "--roi", roi).status == 0
        assert cadtof("profile", runs[0], tmp_path / roi, "--row", 1).status == status


def test_a_map_of_another_program_may_show_any_part(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """Nothing says which part it shows, so it is taken for that of the run beside it, whichever of the two comes first."""
    out, other = tmp_path / "out", tmp_path / "other" / "frame.exr"
    assert cadtof("resolve", runs[0].parent / "capture", "-o", out, "-j", 1, "-q", "--roi", "4,2,20,12").status == 0
    other.parent.mkdir()
    write_exr(other, {"direct.depth": np.ones((10, 16), np.float32)})
    for maps in ((out, other), (other, out)):
        done = cadtof("profile", *maps, "--row", 1)
        assert (done.status, done.err) == (0, "")


def test_a_damaged_first_map_does_not_hide_which_pixels_the_others_show(tmp_path: Path) -> None:
    capture, out, truth = record(tmp_path / "capture", frames=2), tmp_path / "out", tmp_path / "truth.exr"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--roi", "4,2,20,12").status == 0
    (out / "run.json").unlink()
    (out / "frame_0.tif").write_bytes(b"II*\0garbage")
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})
    done = cadtof("profile", out, "--frame", 1, "--row", 3, "--truth", truth)
    assert (done.status, done.err) == (0, "")
    np.testing.assert_allclose(_table(done.out)["truth"], step_truth()[5, 4:20], rtol=1e-6)


def test_impossible_profiles_are_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    write_exr(tmp_path / "small.exr", {"direct.depth": np.ones((3, 4), np.float32)})
    for arguments, message in (
        ((runs[0],), "found 0 of --row, --column and --line, expected one of them"),
        ((runs[0], "--row", 3, "--column", 4), "found 2 of --row, --column and --line"),
        ((runs[0], "--row", 24), "--row: found 24, expected columns 0 … 31 and rows 0 … 23"),
        ((runs[0], "--line", "0,0,32,3"), "--line: found 0,0,32,3, expected columns 0 … 31"),
        ((runs[0], "--line", "0,0"), "'0,0' is not two pixels X0,Y0,X1,Y1 such as 40,30,280,210"),
        ((runs[0], "--row", 3, "--frame", 2), "--frame: found 2, expected 0 … 1"),
        ((runs[0], "--row", 3, "--layer", "other"), "expected other"),
        ((runs[0], tmp_path / "small.exr", "--row", 1), "found 4 × 3 pixels, expected 32 × 24 as in"),
        ((runs[0], "--row", 1, "--truth", tmp_path / "small.exr"), "found 32 × 24 pixels, expected 4 × 3 as in"),
        ((runs[0], "--row", 1, "-o", tmp_path / "a.gif"), "found the suffix '.gif', expected one of .png"),
    ):
        done = cadtof("profile", *arguments)
        assert (done.status, done.out) == (2, "")
        assert message in done.err
