"""`cadtof preview`: a picture that shows answers in colour and their absence in grey."""

import importlib.util
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from cadtof_cli.calibration.store import save_part
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import FrameError
from cadtof_cli.figures.scales import limits_of
from cadtof_cli.figures.sequence import fitted, thumbnail_size
from cadtof_cli.workflows.inspect.pictured import pictured
from tests.support.calibrations import made_up_calibration
from tests.support.captures import Form, layers_of, record, write_exr, write_frame
from tests.support.forward import step_frame, step_truth
from tests.support.needed import needed_module
from tests.support.run_cadtof import cadtof

NO_ANSWER, ONE_PATH, SATURATED = (178, 178, 178), (227, 227, 227), (123, 6, 250)
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


def _words(svg: Path) -> set[str]:
    """Return the texts of an SVG, which holds letters as outlines, with the text as a comment."""
    return set(re.findall(r"<!-- (.*?) -->", svg.read_text()))


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
    # the picture has colours, not only shades of grey
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
    # in all three, half of the MPI panel shows pixels with one path
    assert _count(whole, ONE_PATH) > share
    # letters have some pixels of this grey
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


def test_planar_depth_is_named(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    for depth in ("z", "range"):
        out = tmp_path / depth
        assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q", "--depth", depth).status == 0
        assert cadtof("preview", out, "-o", tmp_path / f"{depth}.svg").status == 0
        assert ("planar depth z, m" in _words(tmp_path / f"{depth}.svg")) == (depth == "z")
        assert cadtof("compare", out, out, "-o", tmp_path / f"compared {depth}.svg").status == 0
        kinds = {"planar depth z, m", "radial range, m"} & _words(tmp_path / f"compared {depth}.svg")
        assert kinds == {"planar depth z, m" if depth == "z" else "radial range, m"}


@pytest.mark.parametrize(("height", "width"), [(24, 32), (5, 40), (700, 3)])
def test_a_layer_is_drawn_at_full_resolution(height: int, width: int, tmp_path: Path) -> None:
    """Every pixel of the map is a square of its own in the picture, in the colour of matplotlib's own scale.

    Pixels are wider if the map has only a few columns.
    """
    depth = np.random.default_rng(0).uniform(1.0, 2.0, (height, width)).astype(np.float32)
    depth[1, 2] = np.nan
    write_exr(tmp_path / "a.exr", {"direct.depth": depth})
    options = ("--layer", "direct.depth", "--range", "1,2", "--cmap", "magma")
    assert cadtof("preview", tmp_path / "a.exr", "-o", tmp_path / "a.png", *options).status == 0
    picture = _picture(tmp_path / "a.png")
    expected = np.asarray(mpl.colormaps["magma"](depth.astype(float) - 1.0, bytes=True))[..., :3].astype(int)
    expected[1, 2] = NO_ANSWER
    side = max(1, 960 // max(height, width))
    wide = 14 if width == 3 else side
    whole = np.repeat(np.repeat(expected, side, axis=0), wide, axis=1)
    # where the axes begin in the picture
    left = 58
    top = 81 + int(np.abs(picture[81, left] - whole[0, 0]).max() > 1)  # matplotlib 3.10 rounds differently
    found = picture[top : top + height * side, left : left + width * wide]
    np.testing.assert_allclose(found, whole, rtol=0, atol=1)


def test_status_as_a_picture(tmp_path: Path) -> None:
    maps = _maps(tmp_path, dark=True)
    assert cadtof("preview", maps, "-o", tmp_path / "a.png", "--layer", "status").status == 0
    picture = _picture(tmp_path / "a.png")
    status = layers_of(maps / "frame_0.tif")["status"].astype(int)
    none = np.count_nonzero(status & (8 + 16 + 2048) == 0)
    assert none == 24 * 16
    side = (960 // 32) ** 2
    assert _count(picture, NO_ANSWER) == pytest.approx(none * side, rel=0.05)


def test_recorded_frames_truth_and_other_layers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # a longer path would be shortened in a title
    monkeypatch.chdir(tmp_path)
    capture = record(Path("capture"), frames=2)
    write_exr(tmp_path / "truth.exr", {"direct.depth": step_truth().astype(np.float32)})
    write_exr(tmp_path / "other.exr", {"Y": np.zeros((24, 32), np.float32)})
    for name, what, expected in (
        ("frame", capture.files[0], {"H1.SC1", "H2.SC2", "H1.amplitude", "H2.phase", "V", "rad"}),
        ("truth", tmp_path / "truth.exr", {"direct.depth", "radial range, m"}),
        ("other", tmp_path / "other.exr", {"Y"}),
        ("sheet", capture.folder, {"frame_0", "frame_1", "capture: H1.amplitude (V), 2 frames"}),
        ("second", ("--frame", 1, capture.folder), {"H1.SC1", f"{capture.files[1]}: as recorded"}),
    ):
        done = cadtof("preview", *(what if isinstance(what, tuple) else (what,)), "-o", tmp_path / f"{name}.svg")
        assert (done.status, done.err) == (0, "")
        assert expected <= _words(tmp_path / f"{name}.svg")


@pytest.mark.parametrize("value", [0.0, 1.0, -2.5e-3])
def test_a_layer_with_one_value_has_a_scale_about_this_value(
    value: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr(Path("even.exr"), {"Y": np.full((24, 32), value, np.float32)})
    assert cadtof("preview", "even.exr", "-o", "a.svg").status == 0
    words = _words(Path("a.svg"))
    # the file's name, without a folder before it
    assert "even.exr" in words
    # no number along the bar has an offset or a power of ten beside it
    assert not [word for word in words if re.search(r"\de[+−-]|\+1", word)]
    low, high = limits_of(np.full((24, 32), value))
    assert low < value < high


def test_counts_are_drawn_if_nothing_says_how_many_volts_they_are(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", toml="")
    done = cadtof("preview", capture.files[0], "-o", tmp_path / "a.svg", "--layer", "H2.SC1")
    assert (done.status, done.err) == (0, "")
    assert "counts" in _words(tmp_path / "a.svg")


def test_a_calibration_is_drawn_with_all_its_parts(tmp_path: Path) -> None:
    metadata = CaptureMetadata()
    calibration = made_up_calibration(metadata, (24, 32), ("dark", "response", "petzval"))
    for part in calibration.parts:
        save_part(tmp_path / "calibration", part)
    done = cadtof("preview", tmp_path / "calibration", "-o", tmp_path / "a.svg")
    assert (done.status, done.err) == (0, "")
    titles = {"dark offset H1.SC1", "dark noise H2.SC2", "phase H2", "gain H2", "field curvature"}
    assert titles | {"mV", "cm", "°"} <= _words(tmp_path / "a.svg")
    done = cadtof("preview", tmp_path / "calibration", "-o", tmp_path / "b.png", "--layer", "gain")
    assert (done.status, "a calibration is drawn as one picture" in done.err) == (2, True)
    done = cadtof("preview", tmp_path / "calibration", "-o", tmp_path / "b.png", "--frame", 1)
    assert (done.status, "leave out --layer, --range, --cmap, --truth and --frame" in done.err) == (2, True)


def test_recorded_frames_have_no_errors(tmp_path: Path) -> None:
    """The truth was left out, and the command said that it was drawn."""
    capture, truth = record(tmp_path / "capture", frames=2).folder, tmp_path / "truth.exr"
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})
    done = cadtof("preview", capture, "-o", tmp_path / "a.png", "--truth", truth)
    assert done.err == "Error: --truth: found the recorded frame frame_0, expected maps, which have errors\n"


def _sequence(folder: Path, count: int) -> Path:
    """Write maps with one depth in all pixels, which grows from frame to frame: 1 m, 1.5 m, …"""
    folder.mkdir()
    for index in range(count):
        write_exr(folder / f"frame_{index}.exr", {"direct.depth": np.full((20, 30), 1.0 + 0.5 * index, np.float32)})
    return folder


def test_a_sheet_of_thumbnails_on_one_scale(tmp_path: Path) -> None:
    maps = _sequence(tmp_path / "maps", 7)
    (maps / "frame_3.exr").write_bytes((maps / "frame_3.exr").read_bytes()[:300])
    done = cadtof("preview", maps, "-o", tmp_path / "a.png", "--range", "1,4")
    assert done.status == 0
    assert done.err.startswith(f"left out: {maps / 'frame_3.exr'}: ")
    picture = _picture(tmp_path / "a.png")
    for index in (0, 1, 2, 4, 5, 6):
        red, green, blue = mpl.colormaps["viridis"](0.5 * index / 3.0, bytes=True)[:3]
        assert _count(picture, (int(red), int(green), int(blue))) > 20 * 30


@pytest.mark.parametrize("form", ["tif", "exr"])
def test_a_damaged_first_map_is_left_out_of_the_sheet(form: Form, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3, form=form), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    for name in ("run.json", "frames.jsonl"):
        (out / name).unlink()
    first = out / f"frame_0.{form}"
    first.write_bytes(first.read_bytes()[:3000])
    done = cadtof("preview", out, "-o", tmp_path / "a.png")
    assert done.status == 0
    (message,) = done.err.splitlines()
    assert message.startswith(f"left out: {first}: ")
    assert _picture(tmp_path / "a.png").size > 0


def test_frames_that_cannot_be_drawn_in_a_sheet_or_film_are_left_out_with_a_reason(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=3), tmp_path / "out"
    assert cadtof("resolve", capture.folder, "-o", out, "-j", 1, "-q").status == 0
    write_frame(capture.files[2], step_frame(np.random.default_rng(0))[..., :12, :])
    other = tmp_path / "other"
    assert cadtof("resolve", capture.files[2], "-o", other, "-j", 1, "-q").status == 0
    (out / "frame_2.tif").write_bytes((other / "frame_2.tif").read_bytes())
    done = cadtof("preview", out, "-o", tmp_path / "a.gif")
    assert (done.status, done.err) == (0, "left out: frame_2 has another size than the first frame\n")
    for file in out.glob("*.tif"):
        file.write_bytes(file.read_bytes()[:3000])
    done = cadtof("preview", out, "-o", tmp_path / "b.png")
    assert done.status == 2
    assert done.err.count("left out: ") == 3
    assert done.err.endswith("Error: none of the 3 frames can be drawn\n")
    assert not (tmp_path / "b.png").exists()


def test_a_frame_of_a_stack_that_became_shorter_is_left_out_with_a_reason(tmp_path: Path) -> None:
    frames = np.random.default_rng(0).normal(0.0, 0.05, (3, 2, 2, 8, 9))
    np.save(tmp_path / "stack.npy", frames)
    *_, last = pictured([tmp_path / "stack.npy"], say=print)
    np.save(tmp_path / "stack.npy", frames[:2])
    with pytest.raises(FrameError, match=r"stack\.npy\[2\]: was cut off or replaced while it was read"):
        last.read()


def test_a_layer_that_no_frame_has_is_reported_once(tmp_path: Path) -> None:
    maps = _sequence(tmp_path / "maps", 4)
    done = cadtof("preview", maps, "-o", tmp_path / "a.png", "--layer", "depth")
    assert done.status == 2
    assert done.err == "Error: --layer: found 'depth', expected one of direct.depth: maps/frame_0.exr\n"


def test_a_film_of_any_height(tmp_path: Path) -> None:
    """Its page is 2.3 inches high, which binary fractions miss by a little."""
    (tmp_path / "maps").mkdir()
    for number in range(2):
        write_exr(tmp_path / "maps" / f"{number}.exr", {"direct.depth": np.full((8, 48), 1.0 + number, np.float32)})
    done = cadtof("preview", tmp_path / "maps", "-o", tmp_path / "a.gif")
    assert (done.status, done.err) == (0, "")


def test_a_film_has_one_scale_for_all_frames(tmp_path: Path) -> None:
    """Pillow reads the film."""
    maps = _sequence(tmp_path / "maps", 5)
    arguments = ("preview", maps, "-o", tmp_path / "a.gif", "--range", "1,3", "--fps", 5)
    done = cadtof(*arguments)
    assert (done.status, done.out, done.err) == (0, f"{tmp_path / 'a.gif'}\n", "")
    assert "already exists" in cadtof(*arguments).err
    with Image.open(tmp_path / "a.gif") as film:
        assert film.info["duration"] == 200
        size = film.size
        frames = [np.array(one.convert("RGB")).astype(int) for one in ImageSequence.Iterator(film)]
        assert len(frames) == 5
        for index, frame in enumerate(frames):
            middle = frame[size[1] // 2, size[0] // 2]
            expected = np.array(mpl.colormaps["viridis"](0.25 * index, bytes=True))[:3].astype(int)
            assert np.abs(middle - expected).max() <= 4
    assert size[0] > 600


@pytest.mark.parametrize(("per_second", "seconds"), [(10, 0.9), (15, 0.6), (24, 0.38), (30, 0.3), (50, 0.18)])
def test_a_gif_lasts_as_long_as_its_frames_per_second_say(per_second: int, seconds: float, tmp_path: Path) -> None:
    """GIF counts in hundredths of a second. Many viewers show no frame for less than two of them."""
    maps = _sequence(tmp_path / "maps", 9)
    assert cadtof("preview", maps, "-o", tmp_path / "a.gif", "--range", "1,9", "--fps", per_second).status == 0
    with Image.open(tmp_path / "a.gif") as film:
        durations = [one.info["duration"] for one in ImageSequence.Iterator(film)]
    assert (len(durations), sum(durations)) == (9, round(1000 * seconds))
    assert min(durations) >= 20


@pytest.mark.parametrize(("limits", "extend"), [("1,3", "neither"), ("1,2.9", "max"), ("1.5,2.9", "both")])
@pytest.mark.parametrize("suffix", [".gif", ".png"])
def test_the_bar_of_many_frames_says_that_one_of_them_is_beyond_its_ends(
    suffix: str, limits: str, extend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first frame holds 1 m, the last one 3 m."""
    extends: list[str] = []
    draw = Figure.colorbar

    def noting(figure: Figure, *arguments: Any, extend: str, **options: Any) -> Any:
        extends.append(extend)
        return draw(figure, *arguments, extend=extend, **options)

    monkeypatch.setattr(Figure, "colorbar", noting)
    done = cadtof(
        "preview", _sequence(tmp_path / "maps", 5), "-o", tmp_path / f"a{suffix}", "--range", limits, "--fps", 5
    )
    assert (done.status, extends) == (0, [extend])


@pytest.mark.parametrize("size", [(1024, 1024), (1024, 1280), (512, 640)])
def test_the_scale_of_many_frames_holds_their_right_edge(
    size: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wall whose depth grows from 1 m at the left to 5 m at the right."""
    ends: list[float] = []
    draw = Figure.colorbar

    def noting(figure: Figure, mappable: Any, *arguments: Any, **options: Any) -> Any:
        ends.extend(mappable.get_clim())
        return draw(figure, mappable, *arguments, **options)

    monkeypatch.setattr(Figure, "colorbar", noting)
    (tmp_path / "maps").mkdir()
    for index in range(2):
        depth = np.tile(np.linspace(1.0, 5.0, size[1], dtype=np.float32), (size[0], 1))
        write_exr(tmp_path / "maps" / f"{index}.exr", {"direct.depth": depth})
    assert cadtof("preview", tmp_path / "maps", "-o", tmp_path / "a.png").status == 0
    assert ends == pytest.approx([1.0, 5.0], abs=0.1)


def test_range_and_planar_depth_share_no_scale(tmp_path: Path) -> None:
    capture, folders = record(tmp_path / "capture"), [tmp_path / "range", tmp_path / "z"]
    for folder in folders:
        assert (
            cadtof("resolve", capture.folder, "-o", folder, "-j", 1, "-q", "--depth", folder.name, "--focal-length", 28)
        ).status == 0
    for suffix in (".png", ".gif"):
        done = cadtof("preview", *folders, "-o", tmp_path / f"a{suffix}")
        assert (done.status, done.out) == (2, "")
        assert "holds radial range and " in done.err
        assert "/z planar depth z: resolve both with the same --depth" in done.err
    assert cadtof("preview", *folders, "-o", tmp_path / "b.png", "--layer", "confidence").status == 0
    assert cadtof("preview", *folders, "-o", tmp_path / "c.png", "--frame", 1).status == 0


def test_an_mp4_opened_by_opencv(tmp_path: Path) -> None:
    """The compression of an MP4 changes colours a little."""
    needed_module("imageio_ffmpeg")
    cv2 = needed_module("cv2")
    maps = _sequence(tmp_path / "maps", 5)
    assert cadtof("preview", maps, "-o", tmp_path / "a.mp4", "--range", "1,3").status == 0
    film = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    for index in range(5):
        is_read, picture = film.read()
        assert is_read
        middle = picture[picture.shape[0] // 2, picture.shape[1] // 2, ::-1].astype(int)
        expected = np.array(mpl.colormaps["viridis"](0.25 * index, bytes=True))[:3].astype(int)
        assert np.abs(middle - expected).max() <= 12
    assert not film.read()[0]
    film.release()


def test_mp4_without_its_package_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps = _sequence(tmp_path / "maps", 2)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    done = cadtof("preview", maps, "-o", tmp_path / "a.mp4")
    assert (done.status, done.out) == (2, "")
    assert "MP4 needs imageio-ffmpeg, which is not installed: pip install 'cadtof[video]', or write a .gif" in done.err


def test_truth_adds_the_errors(tmp_path: Path) -> None:
    maps, truth = _maps(tmp_path), tmp_path / "truth.exr"
    write_exr(truth, {"direct.depth": step_truth().astype(np.float32)})
    assert cadtof("preview", maps, "-o", tmp_path / "plain.png").status == 0
    done = cadtof("preview", maps, "-o", tmp_path / "truth.png", "--truth", truth)
    assert (done.status, done.err) == (0, "")
    assert _picture(tmp_path / "truth.png").shape[1] > _picture(tmp_path / "plain.png").shape[1]
    for name in ("frame_1.tif", "frame_2.tif"):
        (maps / name).write_bytes((maps / "frame_0.tif").read_bytes())
    done = cadtof("preview", maps, "-o", tmp_path / "first.png", "--truth", truth)
    assert (done.status, done.err) == (0, "drawn with truth: the first of 3 frames; --frame N draws another\n")
    np.testing.assert_array_equal(_picture(tmp_path / "first.png"), _picture(tmp_path / "truth.png"))
    done = cadtof("preview", maps, "-o", tmp_path / "no.gif", "--truth", truth)
    assert (done.status, "--truth goes with the figure of one frame, not with a film" in done.err) == (2, True)


def test_a_pixel_that_truth_says_nothing_of_is_not_said_to_have_no_answer(tmp_path: Path) -> None:
    maps, truth = _maps(tmp_path), step_truth().astype(np.float32)
    for name in ("whole", "part"):
        if name == "part":
            truth[::2] = np.nan
        write_exr(tmp_path / f"{name}.exr", {"direct.depth": truth})
        done = cadtof("preview", maps, "-o", tmp_path / f"{name}.svg", "--truth", tmp_path / f"{name}.exr")
        assert (done.status, done.err) == (0, "")
    whole, part = _words(tmp_path / "whole.svg"), _words(tmp_path / "part.svg")
    assert not any(word.startswith("no answer") for word in whole | part)
    assert ("a value in only one of the two" in part, "a value in only one of the two" in whole) == (True, False)


def test_frames_of_the_same_name_are_told_apart_in_a_sheet(tmp_path: Path) -> None:
    for name in ("a", "b"):
        _maps(tmp_path / name)
    for inputs, named in (
        (("a/out", "b/out"), ("a/out/frame_0", "b/out/frame_0")),
        (("a/out/frame_0.tif", "b/out/frame_0.tif"), ("a/out/frame_0", "b/out/frame_0")),
        (("a/capture", "b/capture"), ("a/capture/frame_0", "b/capture/frame_0")),
    ):
        done = cadtof("preview", *(tmp_path / one for one in inputs), "-o", tmp_path / "a.svg", "--overwrite")
        assert done.status == 0
        assert set(named) <= _words(tmp_path / "a.svg")


def test_the_title_names_the_capture_of_a_map(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        record(tmp_path / "recordings" / day / "hall")
    done = cadtof("resolve", "--recursive", tmp_path / "recordings", "-o", tmp_path / "out", "-j", 1, "-q")
    assert done.status == 0
    for maps in (("out", "--frame", 1), ("out/tuesday/hall",), ("out/tuesday/hall/frame_0.tif",)):
        assert cadtof("preview", tmp_path / maps[0], *maps[1:], "-o", tmp_path / "a.svg", "--overwrite").status == 0
        assert "out/tuesday/hall/frame_0.tif" in _words(tmp_path / "a.svg")


def test_a_recorded_frame_is_not_drawn_on_the_scale_of_depths(tmp_path: Path) -> None:
    maps = _maps(tmp_path)
    for suffix in (".png", ".gif"):
        done = cadtof("preview", maps, tmp_path / "capture", "-o", tmp_path / f"a{suffix}")
        assert done.status == 0
        assert done.err.startswith("left out: --layer: found 'direct.depth', expected one of H1.SC1")


@pytest.mark.parametrize("shape", [(24, 32), (60, 90), (7, 100), (3, 2), (1, 1), (320, 240)])
@pytest.mark.parametrize("other", [(24, 32), (30, 30), (1, 50), (50, 1)])
def test_a_thumbnail_keeps_the_proportions_of_its_frame(shape: tuple[int, int], other: tuple[int, int]) -> None:
    """The size of thumbnails is that of the first frame. The thumbnails of frames of its shape have no margin."""
    for count in (2, 7, 100):
        size = thumbnail_size(count, shape)
        assert not (fitted(np.zeros((*shape, 4), np.uint8), size) == 255).any()
        black = (fitted(np.zeros((*other, 4), np.uint8), size) == 0).all(axis=-1)
        height, width = black.any(axis=1).sum(), black.any(axis=0).sum()
        assert black.shape == size[::-1]
        assert (width == size[0]) or (height == size[1])
        assert min(abs(width - height * other[1] / other[0]), abs(height - width * other[0] / other[1])) <= 1.5


def test_impossible_pictures_are_refused(tmp_path: Path) -> None:
    maps = _maps(tmp_path)
    small, other = tmp_path / "small.exr", tmp_path / "other.exr"
    write_exr(small, {"direct.depth": step_truth(height=20).astype(np.float32)})
    write_exr(other, {"Y": np.zeros((24, 32), np.float32)})
    (tmp_path / "empty").mkdir()
    for arguments, message in (
        ((tmp_path / "gone",), f"{tmp_path / 'gone'}: no such file or folder; expected maps that"),
        ((tmp_path / "empty",), f"{tmp_path / 'empty'}: found no maps (.exr, .tif)"),
        (
            (other, "--truth", other),
            f"{other}: found layers Y; expected direct.depth, mpi.depth, confidence, direct.sigma too",
        ),
        ((maps, "--layer", "mpi.dept"), "--layer: found 'mpi.dept', expected one of direct.depth, mpi.depth,"),
        ((maps, "--range", "3,1"), "--range: found 3,1, expected a least and a larger value such as 0.5,3"),
        ((maps, "--truth", small, "--layer", "status"), "--truth draws the errors of a whole frame"),
        ((maps, "--frame", 1), "--frame: found 1, expected 0 … 0"),
        ((maps, "--fps", 0), "--fps: found 0, expected 0.1 to 50 frames a second"),
        ((maps, "--truth", other), f"{other}: found layers Y; expected direct.depth"),
        ((maps, "--truth", small), f"{maps / 'frame_0.tif'}: found 32 × 24 pixels, expected 32 × 20 as in {small}"),
    ):
        done = cadtof("preview", *arguments, "-o", tmp_path / "a.png")
        assert done.err.startswith(f"Error: {message}")
        assert (done.status, done.out) == (2, "")
    done = cadtof("preview", maps, "-o", tmp_path / "gone" / "a.png")
    assert done.err == f"Error: {tmp_path / 'gone' / 'a.png'}: cannot be written: No such file or directory\n"
    assert done.status == 2
    assert not list(tmp_path.glob("*.png"))
