"""Maps without their `run.json`: their headers say which pixels they show and which kind of depth they hold."""

import shutil
from pathlib import Path

import pytest

from tests.support.captures import record, write_exr
from tests.support.forward import step_truth
from tests.support.run_cadtof import cadtof

LEFT, RIGHT = "0,0,16,24", "16,0,32,24"


def _collected(folder: Path, **options: tuple[object, ...]) -> Path:
    """Return a folder with a map for each name, resolved with its options, as someone collects them from several runs."""
    capture, collected = record(folder / "capture").folder, folder / "collected"
    collected.mkdir()
    for name, given in options.items():
        out = folder / name
        assert cadtof("resolve", capture, "-o", out, "-j", 1, "-q", *given).status == 0
        (found,) = out.glob("*.tif")
        shutil.copy(found, collected / f"{name}.tif")
    return collected


@pytest.fixture
def halves(tmp_path: Path) -> Path:
    """The maps of the left and the right half of a frame."""
    return _collected(tmp_path, left=("--roi", LEFT), right=("--roi", RIGHT))


@pytest.fixture
def kinds(tmp_path: Path) -> Path:
    """A map of radial range and one of planar depth."""
    return _collected(tmp_path, radial=(), planar=("--depth", "z"))


def test_maps_of_different_parts_are_not_taken_for_one_part(halves: Path, tmp_path: Path) -> None:
    """Each half has the size of the part of truth that belongs to the other half."""
    truth = write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype("float32")})
    told = f"{halves}: found maps of different roi, {LEFT} (left.tif) and {RIGHT} (right.tif), expected one run; "
    for arguments in (("--truth", truth), ("--over-time", tmp_path / "scatter.exr")):
        done = cadtof("evaluate", halves, *arguments)
        assert (done.status, done.out) == (2, "")
        assert told in done.err
    for name in ("left", "right"):
        alone = cadtof("evaluate", halves / f"{name}.tif", "--truth", truth, "--max-median", 2)
        assert (name, alone.status) == (name, 0)


def test_a_map_of_a_whole_frame_is_not_taken_for_one_of_a_part(tmp_path: Path) -> None:
    """Truth is that of whole frames: it must not be cut and then found too small."""
    collected = _collected(tmp_path, left=("--roi", LEFT), whole=())
    truth = write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype("float32")})
    done = cadtof("evaluate", collected, "--truth", truth)
    assert done.status == 2
    assert f"{collected}: found maps of different roi, {LEFT} (left.tif) and whole frames (whole.tif), " in done.err


def test_maps_of_different_parts_are_not_compared(halves: Path, tmp_path: Path) -> None:
    for name in ("left", "right"):
        (tmp_path / f"only_{name}").mkdir()
        shutil.copy(halves / f"{name}.tif", tmp_path / f"only_{name}" / "frame_0.tif")
    left, right = tmp_path / "only_left", tmp_path / "only_right"
    for command, *line in (("compare",), ("profile", "--row", 3)):
        done = cadtof(command, left, right, *line)
        assert (done.status, done.out) == (2, "")
        assert f"{left} shows pixels {LEFT} and {right} {RIGHT}: resolve both with the same --roi" in done.err
        assert cadtof(command, left, tmp_path / "left", *line).status == 0


@pytest.mark.parametrize("suffix", [".ply", ".png"])
def test_each_map_is_exported_as_the_depth_that_it_holds(kinds: Path, suffix: str, tmp_path: Path) -> None:
    out, optics = (
        tmp_path / f"a{suffix}",
        ("--focal-length", 28, "--principal-point", "15,9") if suffix == ".ply" else (),
    )
    done = cadtof("export", kinds, "-o", out, *optics)
    assert (done.status, done.out) == (2, "")
    assert "found maps of different depth, planar depth z (planar.tif) and radial range (radial.tif), " in done.err
    files = [kinds / "planar.tif", kinds / "radial.tif"]
    assert cadtof("export", *files, "-o", out, *optics).status == 0
    for name in ("planar", "radial"):
        of_run = tmp_path / f"{name}_of_run{suffix}"
        assert cadtof("export", tmp_path / name, "-o", of_run, *optics).status == 0
        written, expected = ((tmp_path / f"a_{name}{suffix}").read_bytes(), of_run.read_bytes())
        assert len(written) > 100
        # the comment of a PLY names the file
        assert written[-100:] == expected[-100:]
