"""`cadtof preview`: a picture that shows answers in colour and their absence in grey."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.captures import Form, record, write_exr, write_frame
from tests.support.forward import step_frame, step_truth
from tests.support.run_cadtof import cadtof

NO_ANSWER, ONE_PATH, SATURATED = (115, 115, 115), (217, 217, 217), (255, 47, 208)
"""Colours of pixels without a depth, by the reason."""


def _maps(folder: Path, *, form: Form = "tif", dark: bool = False) -> Path:
    capture = record(folder / "capture", form=form)
    volts = step_frame(np.random.default_rng(0))
    if dark:
        volts[..., :16] = 0.0
    write_frame(capture.files[0], volts)
    assert cadtof("resolve", capture.folder, "-o", folder / "out", "-j", 1, "-q").status == 0
    return folder / "out"


def _picture(path: Path) -> NDArray[Any]:
    assert path.read_bytes().startswith(b"\x89PNG\r\n")
    return np.asarray(np.rint(255 * mpl.image.imread(path)[..., :3])).astype(int)


def _count(picture: NDArray[Any], colour: tuple[int, int, int]) -> int:
    return int(np.count_nonzero((abs(picture - colour) <= 1).all(axis=-1)))


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_picture_of_maps(form: Form, tmp_path: Path) -> None:
    maps = _maps(tmp_path, form=form)
    done = cadtof("preview", maps, "-o", tmp_path / "a.png")
    assert (done.status, done.out, done.err) == (0, f"{tmp_path / 'a.png'}\n", "")
    whole = _picture(tmp_path / "a.png")
    height, width = whole.shape[:2]
    assert 600 < height < width < 3000
    assert cadtof("preview", maps / f"frame_0.{form}", "-o", tmp_path / "b.png").status == 0
    np.testing.assert_array_equal(_picture(tmp_path / "b.png"), whole)
    # colours, not shades alone
    assert np.count_nonzero(np.ptp(whole, axis=-1) > 60) > 0.05 * height * width


def test_pixels_without_a_depth_have_colours_of_their_own(tmp_path: Path) -> None:
    answered, dark = _maps(tmp_path / "a"), _maps(tmp_path / "b", dark=True)
    capture = tmp_path / "a" / "capture"
    saturated = cadtof("resolve", capture, "-o", tmp_path / "c", "-j", 1, "-q", "--saturated-counts", "8000,16383")
    assert saturated.status == 0, saturated.err
    for name, maps in (("a", answered), ("b", dark), ("c", tmp_path / "c")):
        assert cadtof("preview", maps, "-o", tmp_path / f"{name}.png").status == 0
    whole, half, bright = (_picture(tmp_path / f"{name}.png") for name in "abc")
    share = 0.02 * whole[..., 0].size
    # half of the MPI panel has one path in all three
    assert _count(whole, ONE_PATH) > share
    # letters have shades of grey
    assert max(_count(whole, NO_ANSWER), _count(whole, SATURATED), _count(half, SATURATED)) < share / 20
    assert _count(half, NO_ANSWER) > 2 * share
    assert _count(bright, SATURATED) > share


@pytest.mark.parametrize(("height", "width"), [(24, 320), (320, 24), (48, 64)])
def test_wide_and_tall_frames_waste_no_room(height: int, width: int, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    write_frame(capture.files[0], np.tile(step_frame(np.random.default_rng(0)), (1, 1, 14, 14))[..., :height, :width])
    assert cadtof("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, "-q").status == 0
    assert cadtof("preview", tmp_path / "out", "-o", tmp_path / "a.png").status == 0
    picture = _picture(tmp_path / "a.png")
    assert np.count_nonzero((picture != 255).any(axis=-1)) > 0.35 * picture[..., 0].size


@pytest.mark.parametrize("name", ["$a$_{b}^2", "深度 ☃ 🎈", "new\nline", "größe\\x"])
def test_any_file_name_is_drawn(name: str, tmp_path: Path) -> None:
    maps = _maps(tmp_path)
    maps.rename(tmp_path / name)
    done = cadtof("preview", tmp_path / name, "-o", tmp_path / "a.png")
    assert (done.status, done.err) == (0, "")


def test_planar_depth_is_said(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    for depth in ("z", "range"):
        out = tmp_path / depth
        assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--depth", depth).status == 0
        assert cadtof("preview", out, "-o", tmp_path / f"{depth}.svg").status == 0
        # letters of an SVG are outlines with the text as a comment
        assert ("planar depth z, m" in (tmp_path / f"{depth}.svg").read_text()) == (depth == "z")


def test_truth_adds_the_errors(tmp_path: Path) -> None:
    maps, truth = _maps(tmp_path), tmp_path / "truth.exr"
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})
    assert cadtof("preview", maps, "-o", tmp_path / "plain.png").status == 0
    done = cadtof("preview", maps, "-o", tmp_path / "truth.png", "--truth", truth)
    assert (done.status, done.err) == (0, "")
    assert _picture(tmp_path / "truth.png").shape[1] > _picture(tmp_path / "plain.png").shape[1]


def test_what_cannot_be_drawn(tmp_path: Path) -> None:
    maps = _maps(tmp_path)
    small, other = tmp_path / "small.exr", tmp_path / "other.exr"
    write_exr(small, {"direct.depth": step_truth(height=20).astype(np.float32)})
    write_exr(other, {"Y": np.zeros((24, 32), np.float32)})
    (tmp_path / "empty").mkdir()
    for arguments, told in (
        ((tmp_path / "gone",), f"{tmp_path / 'gone'}: no such file or folder; expected maps that"),
        ((tmp_path / "empty",), f"{tmp_path / 'empty'}: found no maps (.exr, .tif)"),
        ((other,), f"{other}: found layers Y; expected direct.depth, mpi.depth, confidence, direct.sigma too"),
        ((maps, "--truth", other), f"{other}: found layers Y; expected direct.depth"),
        ((maps, "--truth", small), f"{maps / 'frame_0.tif'}: found 32 × 24 pixels, expected 32 × 20 as in {small}"),
    ):
        done = cadtof("preview", *arguments, "-o", tmp_path / "a.png")
        assert done.err.startswith(f"Error: {told}")
        assert (done.status, done.out) == (2, "")
    done = cadtof("preview", maps, "-o", tmp_path / "gone" / "a.png")
    assert done.err == f"Error: {tmp_path / 'gone' / 'a.png'}: cannot be written: No such file or directory\n"
    assert done.status == 2
    assert not list(tmp_path.glob("*.png"))
