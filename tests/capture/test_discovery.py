"""Captures are found by file names alone: which files are frames, in which order, and the message if there are none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture, FrameSource, open_frames
from cadtof_cli.errors import CaptureError, FrameError
from tests.files.forms import known_frame, planes_of, tiff
from tests.support.captures import FRAME_SUFFIXES

PATTERN = "{frame}_h{harmonic}_sc{channel}.tif"


def _touch(folder: Path, *names: str) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return paths


def _names(capture: Capture) -> list[str]:
    return [frame.name for frame in capture.frames]


def _message(*inputs: Path) -> str:
    with pytest.raises(CaptureError) as caught:
        find_captures(inputs)
    return str(caught.value)


def test_frames_of_a_folder_come_in_natural_order(tmp_path: Path) -> None:
    _touch(tmp_path, "frame_10.tif", "frame_2.TIF", "frame_1.exr", "frame_3.tiff", "Frame_4.EXR")
    (capture,) = find_captures([tmp_path])
    assert _names(capture) == ["frame_1", "frame_2", "frame_3", "Frame_4", "frame_10"]
    assert capture.root == tmp_path
    assert capture.frames[1] == FrameSource("frame_2", (tmp_path / "frame_2.TIF",))


def test_what_is_no_frame_is_left_out(tmp_path: Path) -> None:
    _touch(tmp_path, "frame.tif", "truth.exr", "Truth.TIF", ".hidden.tif", "capture.toml.bak", "notes.txt", "frame.png")
    _touch(tmp_path / "calibration", "frame_0.tif")
    (tmp_path / "folder").mkdir()
    (capture,) = find_captures([tmp_path])
    assert _names(capture) == ["frame"]


def test_a_folder_named_like_a_frame_counts_as_one(tmp_path: Path) -> None:
    _touch(tmp_path, "frame_0.tif", "frame_2.tif")
    (tmp_path / "frame_1.tif").mkdir()
    for recursive in (False, True):
        (capture,) = find_captures([tmp_path], recursive=recursive)
        assert _names(capture) == ["frame_0", "frame_1", "frame_2"]
    _touch(tmp_path / "frame_1.tif", "a.tif")
    found = find_captures([tmp_path], recursive=True)
    assert [_names(capture) for capture in found] == [["frame_0", "frame_2"], ["a"]]


def test_a_folder_of_a_tree_whose_files_are_named_otherwise_is_an_error(tmp_path: Path) -> None:
    """It is not left out without a word, as a folder without any such file is."""
    _touch(tmp_path / "a", *(f"f_h{h}_sc{channel}.tif" for h in (1, 2) for channel in (1, 2)))
    _touch(tmp_path / "b", "notes.txt")
    overrides = {"layout.pattern": PATTERN}
    (capture,) = find_captures([tmp_path], overrides=overrides, recursive=True)
    assert _names(capture) == ["f"]
    _touch(tmp_path / "c", "f_1a.tif", "f_1b.tif")
    with pytest.raises(CaptureError, match=r"c: no frames: looked for files named .*, found f_1a\.tif, f_1b\.tif"):
        find_captures([tmp_path], overrides=overrides, recursive=True)


def test_no_file_is_opened_to_find_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _touch(tmp_path, *(f"frame_{index}.tif" for index in range(50)))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("opened")

    monkeypatch.setattr("builtins.open", refuse)
    monkeypatch.setattr("os.open", refuse)
    (capture,) = find_captures([tmp_path])
    assert len(capture.frames) == 50


def test_metadata_comes_from_the_folder_unless_it_is_overridden(tmp_path: Path) -> None:
    _touch(tmp_path, "frame.tif")
    (tmp_path / "capture.toml").write_text("[modulation]\nperiods_ns = [30.0, 10.0]\n[layout]\nframes = 5\n")
    (capture,) = find_captures([tmp_path], overrides={"layout.frames": 7})
    assert capture.layout.harmonics == (1, 3)
    assert capture.layout.frames == 7
    assert capture.source.origins["modulation.periods_ns"] == str(tmp_path / "capture.toml")


def test_files_that_follow_each_other_share_their_capture(tmp_path: Path) -> None:
    in_a = _touch(tmp_path / "a", "x_2.tif", "x_1.tif")
    in_b = _touch(tmp_path / "b", "y.exr")
    (tmp_path / "b" / "capture.toml").write_text("[voltage]\nzero_counts = 3.0\n")
    more_in_a = _touch(tmp_path / "a", "x_3.tif")
    captures = find_captures([*in_a, *in_b, in_a[0], *more_in_a, in_a[0]])
    assert [_names(capture) for capture in captures] == [["x_2", "x_1"], ["y"], ["x_3"]]
    assert [capture.source.metadata.voltage.zero_counts for capture in captures] == [None, 3.0, None]


def test_capture_toml_among_the_inputs_is_no_frame(tmp_path: Path) -> None:
    names = _touch(tmp_path, "capture.toml", "frame_0.tif", "frame_1.tif")
    (capture,) = find_captures(names)
    assert _names(capture) == ["frame_0", "frame_1"]


def test_a_folder_and_a_file_in_it_are_one_capture(tmp_path: Path) -> None:
    path, _ = _touch(tmp_path, "frame_0.tif", "frame_1.tif")
    for inputs in ([tmp_path, path], [path, tmp_path], [tmp_path, path, tmp_path]):
        (capture,) = find_captures(inputs)
        assert _names(capture) == ["frame_0", "frame_1"]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ((), "found nothing"),
        (("truth.exr", "notes.txt"), "found notes.txt, truth.exr"),
        (("camera/h1/cos/1.png", "notes.txt"), "found camera/, notes.txt"),
        (
            tuple(f"{i}.png" for i in range(12)),
            "found 0.png, 1.png, 2.png, 3.png, 4.png and 7 more; a PNG holds one plane: give --pattern, which says how "
            "the planes of a frame are named",
        ),
        (
            ("a.RAW", "b.txt"),
            "found a.RAW, b.txt; to read raw dumps such as a.RAW, give --raw-dtype and --raw-shape, or [layout.raw] in "
            "capture.toml",
        ),
    ],
)
def test_empty_folder_says_what_it_holds(names: tuple[str, ...], found: str, tmp_path: Path) -> None:
    _touch(tmp_path, *names)
    assert _message(tmp_path) == f"{tmp_path}: no frames: looked for {FRAME_SUFFIXES} files other than truth.*, {found}"


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        (
            "{frame}_{harmonic}_{channel}.pgm",
            f"found a_1_1.pgm; planes are read from {FRAME_SUFFIXES}, .png files",
        ),
        ("{frame}_{harmonic}_{channel}", f"found a_1_1.pgm; planes are read from {FRAME_SUFFIXES}, .png files"),
        ("h{harmonic}/{frame}_{channel}.png", "found a_1_1.pgm"),
    ],
)
def test_planes_that_cannot_be_found_or_read_say_why(pattern: str, found: str, tmp_path: Path) -> None:
    _touch(tmp_path, "a_1_1.pgm")
    with pytest.raises(CaptureError) as caught:
        find_captures([tmp_path], overrides={"layout.pattern": pattern})
    assert str(caught.value) == f"{tmp_path}: no frames: looked for files named {pattern} (layout.pattern), {found}"


@pytest.mark.parametrize(
    ("more", "now"),
    [
        ({}, "{harmonic} stands for 1, 2, … and {channel} for 1 or 2"),
        ({"layout.channel": ("A", "B")}, "{harmonic} stands for 1, 2, … and {channel} for A or B"),
        ({"layout.harmonic": {"25": 1, "50": 2}}, "{harmonic} stands for 25, 50 and {channel} for 1 or 2"),
    ],
)
def test_a_pattern_with_unknown_words_for_harmonic_and_channel_says_so(
    more: dict[str, Any], now: str, tmp_path: Path
) -> None:
    _touch(tmp_path, "notes.txt", "img-0-25MHz-A.png", "img-0-50MHz-A.png")
    with pytest.raises(CaptureError) as caught:
        find_captures([tmp_path], overrides={"layout.pattern": "img-{frame}-{harmonic}-{channel}.png", **more})
    text = str(caught.value)
    assert text.endswith(f"; img-0-25MHz-A.png would fit if --harmonic and --channel listed the words in it; now {now}")


def test_named_files_that_are_no_frames_say_so(tmp_path: Path) -> None:
    """The folder of such a file may well have frames."""
    _touch(tmp_path, "capture.toml", "frame.tif")
    with pytest.raises(CaptureError) as caught:
        find_captures([tmp_path / "capture.toml"])
    assert str(caught.value).startswith(f"{tmp_path}: no frames among the files that were named: looked for ")
    assert str(caught.value).endswith(", found capture.toml")


def test_raw_dumps_need_the_suffix_of_raw_dumps(tmp_path: Path) -> None:
    raw = {"layout.raw_dtype": "uint16", "layout.raw_shape": (2, 2, 3, 4)}
    _touch(tmp_path, "frame.img")
    with pytest.raises(CaptureError, match=r"looked for .*\.npy, \.raw, \.bin, \.dat files .*, found frame\.img$"):
        find_captures([tmp_path], overrides=raw)


def test_a_folder_without_permission_to_list_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.scandir", refuse)
    assert _message(tmp_path) == f"{tmp_path}: no permission to list this folder; expected one that can be read"


def test_two_frames_of_one_name(tmp_path: Path) -> None:
    _touch(tmp_path, "frame.exr", "frame.tif")
    assert "frame.exr and frame.tif would both be written as frame" in _message(tmp_path)


def _planes(folder: Path, harmonics: tuple[int, ...], frames: tuple[str, ...] = ("a_2", "a_10")) -> None:
    _touch(folder, *(f"{f}_h{h}_sc{c}.tif" for f in frames for h in harmonics for c in (1, 2)), "other.tif")


def _found_planes(folder: Path, periods: str = "[40.0, 20.0]") -> Capture:
    (folder / "capture.toml").write_text(f"[modulation]\nperiods_ns = {periods}\n[layout]\npattern = '{PATTERN}'\n")
    (capture,) = find_captures([folder])
    return capture


def test_planes_are_grouped_into_frames(tmp_path: Path) -> None:
    _planes(tmp_path, (1, 2))
    capture = _found_planes(tmp_path)
    assert _names(capture) == ["a_2", "a_10"]
    expected = ["a_2_h1_sc1.tif", "a_2_h1_sc2.tif", "a_2_h2_sc1.tif", "a_2_h2_sc2.tif"]
    assert [path.name for path in capture.frames[0].paths] == expected


@pytest.mark.parametrize(
    ("named", "taken"),
    [((1, 3), (1, 3)), ((1, 2), (1, 2)), ((1, 2, 3), (1, 3)), ((1,), (1, 3))],
    ids=["numbers", "places", "numbers-go-first", "neither-asks-for-numbers"],
)
def test_harmonics_in_file_names_are_numbers_or_places(
    named: tuple[int, ...], taken: tuple[int, ...], tmp_path: Path
) -> None:
    _planes(tmp_path, named, ("a",))
    capture = _found_planes(tmp_path, "[30.0, 10.0]")
    expected = [f"a_h{h}_sc{c}.tif" for h in taken for c in (1, 2)]
    assert [path.name for path in capture.frames[0].paths] == expected


def test_a_frame_that_lacks_a_plane_fails_alone(tmp_path: Path) -> None:
    recorded = known_frame("u2")
    for name in ("a", "b"):
        for index, plane in enumerate(planes_of(recorded)):
            tiff()(tmp_path / f"{name}_h{index // 2 + 1}_sc{index % 2 + 1}", plane)
    (tmp_path / "a_h2_sc1.tif").unlink()
    capture = _found_planes(tmp_path)
    assert _names(capture) == ["a", "b"]
    with open_frames(capture.frames[1], capture.layout) as frames:
        assert np.array_equal(frames.read(0), recorded)
    with pytest.raises(FrameError) as caught, open_frames(capture.frames[0], capture.layout):
        pass
    assert str(caught.value) == f"{tmp_path / 'a_h2_sc1.tif'}: no such file, expected H2.SC1 of frame a there"


def test_one_plane_as_input_means_its_whole_frame(tmp_path: Path) -> None:
    _planes(tmp_path, (1, 2))
    folder = _found_planes(tmp_path)
    (capture,) = find_captures([tmp_path / "a_10_h1_sc1.tif"])
    assert capture.frames == folder.frames[1:]


def test_no_file_that_fits_the_pattern(tmp_path: Path) -> None:
    _touch(tmp_path, "frame_0.tif")
    (tmp_path / "capture.toml").write_text(f"[layout]\npattern = '{PATTERN}'\n")
    expected = f"looked for files named {PATTERN} (layout.pattern), found capture.toml, frame_0.tif"
    assert _message(tmp_path) == f"{tmp_path}: no frames: {expected}"
