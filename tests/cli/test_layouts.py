"""Files with layouts and names of other software, and settings that lie elsewhere, give the same maps as our files."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile

from tests.support.captures import TOML, layers_of, record, write_exr
from tests.support.forward import step_frame
from tests.support.run_cadtof import cadtof
from tests.support.shell import shell

PLANES = ((1, 1), (1, 2), (2, 1), (2, 2))


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A capture of two frames, resolved into `expected`."""
    record(tmp_path / "whole", frames=2)
    assert shell("cadtof resolve whole -o expected -j 1", tmp_path).status == 0
    return tmp_path


def _write_planes(folder: Path, names: str, layout: str, *, called: dict[str, str], frames: int = 2) -> None:
    """Write the frames of `whole` as files of one plane each, named as other software does, and a `capture.toml`."""
    for frame in range(frames):
        pages = tifffile.imread(folder / "whole" / f"frame_{frame}.tif")
        for (harmonic, channel), page in zip(PLANES, pages, strict=True):
            words = {"frame": str(frame), "harmonic": called[f"h{harmonic}"], "channel": called[f"c{channel}"]}
            file = folder / "planes" / names.format(**words)
            file.parent.mkdir(parents=True, exist_ok=True)
            tifffile.imwrite(file, page)
    (folder / "planes" / "capture.toml").write_text(f"{TOML['tif']}[layout]\n{layout}\n", encoding="utf-8")


def _require_same_maps(one: Path, other: Path) -> None:
    expected, found = layers_of(one), layers_of(other)
    assert found.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name])


PLAIN = {"h1": "1", "h2": "2", "c1": "1", "c2": "2"}
NAMED = {"h1": "25", "h2": "50", "c1": "A", "c2": "B"}
NAMES = 'channel = ["A", "B"]\nharmonic = { "25" = 1, "50" = 2 }'


@pytest.mark.parametrize(
    ("pattern", "more", "called"),
    [
        ("H{harmonic}/f{frame}_{channel}.tif", "", PLAIN),
        ("{frame}/h{harmonic}_sc{channel}.tif", "", PLAIN),
        ("f{frame}_{harmonic}MHz_{channel}.tif", NAMES, NAMED),
        ("{harmonic}/{channel}/{frame}.tif", NAMES, NAMED),
        ("{channel}{harmonic}_größe({frame}).tif", NAMES, NAMED),
    ],
)
def test_planes_in_folders_and_under_other_names(pattern: str, more: str, called: dict[str, str], whole: Path) -> None:
    _write_planes(whole, pattern, f'pattern = "{pattern}"\n{more}', called=called)
    done = shell("cadtof resolve planes -o out -j 1", whole)
    assert done.status == 0, done.err
    for frame in (0, 1):
        _require_same_maps(whole / "expected" / f"frame_{frame}.tif", whole / "out" / f"{frame}.tif")


def test_raw_dumps_of_one_plane_each_suggest_a_pattern(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    for harmonic, channel in PLANES:
        (tmp_path / "rec" / f"a_h{harmonic}_sc{channel}.raw").write_bytes(bytes(2 * 4 * 5))
    done = shell("cadtof info rec --raw-dtype uint16 --raw-shape 4,5", tmp_path)
    assert done.status == 1
    assert "found 4 files with one plane each, and nothing says which plane is which" in done.err
    assert 'pattern = "a_h{harmonic}_sc{channel}.raw"' in done.err


def test_of_planes_whose_names_suggest_no_pattern_nothing_is_told_but_that(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    for name in ("a", "bb1", "c_2x", "dd"):
        (tmp_path / "rec" / f"{name}.raw").write_bytes(bytes(2 * 4 * 5))
    options = "--raw-dtype uint16 --raw-shape 4,5 --integration-length 1e5"
    done = shell(f"cadtof info rec {options}", tmp_path)
    assert done.status == 1
    assert 'for example: pattern = "{frame}_h{harmonic}_sc{channel}.tif"' in done.err
    assert len(done.err.splitlines()) == 1
    assert "mV per channel" not in done.out


def test_a_channel_without_a_name_is_refused(whole: Path) -> None:
    layout = 'pattern = "{harmonic}{channel}{frame}.tif"\nchannel = ["", "x"]'
    _write_planes(whole, "{harmonic}{channel}{frame}.tif", layout, called=PLAIN)
    done = shell("cadtof resolve planes -o out -j 1", whole)
    assert done.status == 2
    assert "layout.channel: found ['', 'x'], expected two different names" in done.err


def test_info_shows_names_as_they_are_given(whole: Path) -> None:
    _write_planes(
        whole, "{harmonic}{channel}{frame}.tif", 'pattern = "{harmonic}{channel}{frame}.tif"\n' + NAMES, called=NAMED
    )
    done = shell("cadtof info planes -j 1", whole)
    assert done.status == 0, done.err
    assert re.search(r"layout.harmonic +25 = 1, 50 = 2 +from ", done.out)


@pytest.mark.parametrize("names", ["SC{c}.{f}MHz", "SC{c}_{f}MHz", "{f}MHz.SC{c}", "SC{c}.H{h}"])
def test_planes_are_found_by_other_names_in_tiff_and_exr_alike(names: str, tmp_path: Path) -> None:
    """Planes in another order than ours are found by their names, in TIFF and EXR alike, and are drawn as voltages."""
    volts = step_frame(np.random.default_rng(0)).astype(np.float32)
    planes = {names.format(h=h, c=c, f=25 * h): volts[h - 1, c - 1] for c in (2, 1) for h in (2, 1)}
    (tmp_path / "capture.toml").write_text(TOML["exr"])
    write_exr(tmp_path / "a.exr", planes)
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        for name, plane in planes.items():
            tiff.write(plane, photometric="minisblack", metadata=None, extratags=[(285, 2, None, name, False)])
    for file in (tmp_path / "a.exr", tmp_path / "a.tif"):
        done = cadtof("info", file, "--json", "-j", 1)
        assert (done.status, done.err) == (0, "")
        found = json.loads(done.out)["planes"]
        assert list(found.values()) == [[plane.min(), plane.max()] for plane in volts.reshape(4, 24, 32)]
        picture = file.with_suffix(file.suffix + ".svg")
        assert cadtof("preview", file, "-o", picture).status == 0
        assert "H1.amplitude" in picture.read_text()


def test_a_tree_of_planes_and_planes_by_name(whole: Path) -> None:
    _write_planes(
        whole, "H{harmonic}/{frame}_{channel}.tif", 'pattern = "H{harmonic}/{frame}_{channel}.tif"', called=PLAIN
    )
    shell("cadtof resolve -r planes -o out -j 1; cadtof resolve planes/H?/*.tif -o given -j 1", whole)
    done = shell("cd planes; cadtof resolve ../planes/H?/*.tif -o ../above -j 1", whole)
    assert done.status == 0, done.err
    for out in ("out", "given", "above"):
        _require_same_maps(whole / "expected" / "frame_1.tif", whole / out / "1.tif")


def test_a_pattern_without_frame_means_a_single_frame(whole: Path) -> None:
    _write_planes(whole, "{channel}_{harmonic}.tif", "", called=NAMED, frames=1)
    (whole / "planes" / "capture.toml").write_text(TOML["tif"])
    named = "--pattern '{channel}_{harmonic}.tif' --channel A,B --harmonic 25=1,50=2"
    done = shell(f"cadtof resolve planes -o out -j 1 {named}", whole)
    assert done.status == 0, done.err
    _require_same_maps(whole / "expected" / "frame_0.tif", whole / "out" / "frame.tif")
    done = shell(f"cadtof resolve planes -o out2 -j 1 {named.replace('50=2', '50=3')}", whole)
    assert done.status == 2
    expected = "expected a name for each of the harmonics 1, 2"
    assert f"Error: --harmonic: layout.harmonic: found {{'25': 1, '50': 3}}, {expected}" in done.err


def test_a_folder_above_describes_its_captures(whole: Path) -> None:
    (whole / "archive" / "day").mkdir(parents=True)
    (whole / "whole").rename(whole / "archive" / "day" / "scene")
    (whole / "archive" / "day" / "scene" / "capture.toml").rename(whole / "archive" / "capture.toml")
    done = shell("cd archive/day/scene; cadtof resolve . -o ../../../out -j 1 && cadtof info frame_0.tif", whole)
    assert done.status == 0, done.err
    assert f"settings of {whole / 'archive' / 'capture.toml'}" in done.err
    assert f"from {whole / 'archive' / 'capture.toml'}" in done.out
    _require_same_maps(whole / "expected" / "frame_0.tif", whole / "out" / "frame_0.tif")


@pytest.mark.parametrize(
    ("name", "message"),
    [("Capture.toml", "found settings under this name, expected capture.toml"), ("capture.toml", "cannot be read")],
)
def test_unusable_settings_in_a_folder_above_are_reported_not_ignored(name: str, message: str, whole: Path) -> None:
    archive = whole / "archive"
    (archive / "day").mkdir(parents=True)
    (whole / "whole").rename(archive / "day" / "scene")
    (archive / "day" / "scene" / "capture.toml").unlink()
    (archive / name).symlink_to("nowhere")
    done = shell("cadtof resolve archive/day/scene -o out -j 1 --volts-per-count 1e-4 --zero-counts 8192", whole)
    assert (done.status, done.out) == (2, "")
    assert f"{archive / name}: {message}" in done.err


@pytest.mark.parametrize("with_own", [False, True])
def test_settings_from_elsewhere_for_a_read_only_archive(with_own: bool, whole: Path) -> None:
    shutil.move(whole / "whole" / "capture.toml", whole / "mine.toml")
    if with_own:
        (whole / "whole" / "capture.toml").write_text("[voltage]\nvolts_per_count = 1.0\n")
    (whole / "whole").chmod(0o555)
    done = shell("cadtof resolve whole --settings mine.toml -o out -j 1; cadtof info whole --settings mine.toml", whole)
    assert done.status == 0, done.err
    assert "from mine.toml" in done.out
    _require_same_maps(whole / "expected" / "frame_0.tif", whole / "out" / "frame_0.tif")
    evaluated = shell('cd /; cadtof evaluate "$OLDPWD/out" --truth "$OLDPWD/expected/frame_0.tif"', whole)
    assert evaluated.status == 0, evaluated.err
    assert "first phasor" in evaluated.out


def test_a_capture_toml_from_a_windows_editor(whole: Path) -> None:
    toml = whole / "whole" / "capture.toml"
    toml.write_bytes(b"\xef\xbb\xbf" + toml.read_bytes().replace(b"\n", b"\r\n"))
    done = shell("cadtof resolve whole -o out -j 1", whole)
    assert done.status == 0, done.err
    _require_same_maps(whole / "expected" / "frame_0.tif", whole / "out" / "frame_0.tif")
