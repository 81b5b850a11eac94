"""What people are used to from other programs, typed into a real shell."""

import json
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cadtof_cli.capture.suggested_layout import layout_of_names
from cadtof_cli.capture.toml import load_metadata
from tests.support.captures import layers_of, record
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, ROOT
from tests.support.shell import shell
from tests.support.terminal import on_terminal


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A capture `cap` of three frames."""
    record(tmp_path / "cap", frames=3)
    return tmp_path


def _stack(folder: Path, frames: int) -> None:
    record(folder)
    pages = tifffile.imread(folder / "frame_0.tif")
    (folder / "frame_0.tif").unlink()
    tifffile.imwrite(folder / "stack.tif", np.tile(pages, (frames, 1, 1)), photometric="minisblack", metadata=None)
    toml = folder / "capture.toml"
    toml.write_text(f"{toml.read_text()}[layout]\nframes = {frames}\n")


def test_the_bar_of_a_stack_counts_to_its_frames(tmp_path: Path) -> None:
    _stack(tmp_path / "cap", 100)
    _, shown = on_terminal("resolve", tmp_path / "cap", "-o", tmp_path / "out", "-j", 1)
    counts = re.findall(r"(\d+)/(\d+|\?)", shown)
    assert ("100", "100") in counts
    assert {total for _, total in counts} <= {"100", "?"}
    assert re.search(r"\d:\d\d:\d\d", shown), "no time left"


def test_a_slow_pooling_tells_how_long_it_takes(tmp_path: Path) -> None:
    capture = ROOT / "sample_data" / "corner"
    command = [*PROGRAM, "resolve", str(capture), "-o", str(tmp_path / "out"), "-j", "1", "--pool", "101"]
    with subprocess.Popen(command, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        note = next((line for line in process.stderr if "--pool" in line), "")
        process.terminate()
    assert re.search(r"--pool 101: 1 frame will take about \d+ (s|min)", note)


def test_resuming_a_complete_run_says_that_all_maps_are_there(here: Path) -> None:
    assert shell("cadtof resolve cap -o out -j 1", here).status == 0
    done = shell("cadtof resolve cap -o out -j 1 --resume", here)
    assert done.status == 0
    assert done.err == "nothing to do: the maps of 3 frames are already in out\n"
    (here / "out" / "frame_1.tif").unlink()
    done = shell("cadtof resolve cap -o out -j 1 --resume", here)
    assert "resolved 1 of 3 frames" in done.err
    assert "2 already there; maps in out" in done.err


@pytest.mark.parametrize(
    ("typed", "places"),
    [("1:3", (1, 2)), ("1:", (1, 2)), (":2", (0, 1)), ("2", (2,)), ("2:9", (2,))],
)
def test_frames_are_chosen_by_place_or_as_a_slice(typed: str, places: tuple[int, ...], here: Path) -> None:
    done = shell(f"cadtof resolve cap -o out -j 1 --frames {typed}", here)
    assert done.status == 0, done.err
    assert sorted(path.name for path in (here / "out").glob("*.tif")) == [f"frame_{place}.tif" for place in places]


@pytest.mark.parametrize("typed", ["x", "3:1", "-1:2", "1:1"])
def test_a_malformed_range_of_frames_is_refused(typed: str, here: Path) -> None:
    done = shell(f"cadtof resolve cap -o out --frames={typed}", here)
    assert done.status == 2
    assert "is not a range of frames such as 10:20" in done.err


def test_some_frames_of_a_stack(tmp_path: Path) -> None:
    _stack(tmp_path / "cap", 12)
    assert shell("cadtof resolve cap -o out -j 1 --frames 5:7", tmp_path).status == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.tif")) == ["stack_0005.tif", "stack_0006.tif"]


def test_maps_of_a_region_are_that_part_of_whole_maps(here: Path) -> None:
    assert shell("cadtof resolve cap -o all -j 1; cadtof resolve cap -o part -j 1 --roi 5,3,20,18", here).status == 0
    whole, part = layers_of(here / "all" / "frame_0.tif"), layers_of(here / "part" / "frame_0.tif")
    for name, layer in part.items():
        np.testing.assert_array_equal(layer, whole[name][3:18, 5:20])
    done = shell(
        "cadtof evaluate part --truth all/frame_0.tif; cadtof preview part --truth all/frame_0.tif -o x.png", here
    )
    assert done.status == 0, done.err
    assert "first phasor" in done.out
    for typed, message in (
        ("0,0,33,10", "expected it inside the 32 × 24 pixels"),
        ("5,5,5,9", "0 ≤ X0 < X1"),
        ("1,2", "two pixels X0,Y0,X1,Y1"),
    ):
        done = shell(f"cadtof resolve cap -o none --roi {typed}", here)
        assert done.status == 2
        assert message in done.err
    assert not (here / "none").exists()


@pytest.mark.parametrize("ending", ["tif", "exr"])
def test_maps_of_a_region_say_so_without_their_run(ending: str, here: Path) -> None:
    made = f"cadtof resolve cap -o all -j 1; cadtof resolve cap -o part -j 1 --roi 5,3,20,18 --format {ending}"
    assert shell(f"{made}; mkdir copied; cp part/frame_0.{ending} copied", here).status == 0
    assert "roi" not in shell("cadtof info all", here).out
    assert re.search(r"^  roi +5,3,20,18$", shell(f"cadtof info copied/frame_0.{ending}", here).out, re.MULTILINE)
    done = shell("cadtof evaluate copied --truth all/frame_0.tif --json", here)
    assert done.status == 0, done.err
    assert json.loads(done.out)["direct"]["median_cm"] == 0.0
    refused = shell("cadtof export copied -o points.ply --focal-length 28", here)
    assert refused.status == 2
    assert "for maps of a --roi also --principal-point-px" in refused.err


def test_a_dry_run_lists_the_maps_and_writes_nothing(here: Path) -> None:
    done = shell("cadtof resolve cap -o out --dry-run", here)
    assert done.status == 0
    assert done.out == "".join(f"cap/frame_{n}.tif → out/frame_{n}.tif\n" for n in range(3))
    assert "would write 3 files of maps into out; nothing has been written" in done.err
    assert not (here / "out").exists()
    assert shell("cadtof resolve cap -o out -j 1 --frames :2", here).status == 0
    done = shell("cadtof resolve cap -o out --dry-run", here)
    assert done.status == 2
    assert "would be replaced" in done.err
    done = shell("cadtof resolve cap -o out --dry-run --resume --json", here)
    assert [json.loads(line)["status"] for line in done.out.splitlines()] == ["skipped", "skipped", "ok"]
    done = shell("cadtof resolve cap -o out --dry-run --resume --order 1", here)
    assert done.status == 2
    assert "cannot resume: order was 'auto' and is '1' now" in done.err


def test_a_log_holds_the_command_its_messages_and_errors(here: Path) -> None:
    (here / "cap" / "frame_1.tif").write_bytes(b"nothing")
    assert (
        shell("cadtof resolve cap -o out -j 1 -q --log run.log; cadtof resolve gone -o x --log run.log", here).status
        == 2
    )
    lines = (here / "run.log").read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d ", line) for line in lines)
    assert "cadtof resolve cap -o out -j 1 -q --log run.log" in lines[0]
    assert "failed: cap/frame_1.tif" in lines[1]
    assert "resolved 2 of 3 frames" in lines[2]
    assert "ended by CaptureError: gone: no such file" in lines[-1]


def test_maps_are_evaluated_from_any_folder_and_after_a_move(here: Path) -> None:
    (here / "project").mkdir()
    (here / "cap").rename(here / "project" / "cap")
    assert shell("cd project; cadtof resolve cap -o out -j 1", here).status == 0
    for folder, project in ((".", "project"), ("project/out", ".."), ("/", shlex.quote(str(here / "project")))):
        done = shell(f"cd {folder}; cadtof evaluate {project}/out --truth {project}/out/frame_0.tif", here)
        assert done.status == 0, done.err
        assert "first phasor" in done.out
    (here / "project").rename(here / "moved")
    done = shell("cadtof evaluate moved/out --truth moved/out/frame_0.tif", here)
    assert "first phasor" in done.out, done.err
    shutil.rmtree(here / "moved" / "cap")
    done = shell("cadtof evaluate moved/out --truth moved/out/frame_0.tif", here)
    assert done.status == 0
    assert "first phasor " not in done.out
    assert "no longer where they were" in done.err


def test_a_missing_pattern_is_suggested_in_one_line(here: Path) -> None:
    folder = here / "planes"
    folder.mkdir()
    (folder / "capture.toml").write_text((here / "cap" / "capture.toml").read_text())
    for frame in range(3):
        for index, page in enumerate(tifffile.imread(here / "cap" / f"frame_{frame}.tif")):
            tifffile.imwrite(folder / f"shot{frame}_h{index // 2 + 1}_sc{index % 2 + 1}.tif", page)
    done = shell("cadtof resolve planes -o out", here)
    assert done.status == 2
    (line,) = done.err.splitlines()
    assert "found 12 files with one plane each" in line
    pattern = "shot{frame}_h{harmonic}_sc{channel}.tif"
    assert f'pattern = "{pattern}"' in line
    assert shell(f"cadtof resolve planes -o out -j 1 --pattern '{pattern}'", here).status == 0
    done = shell("cadtof info planes", here)
    assert done.status == 1
    assert done.err.count("wrong: ") == 1


@pytest.mark.parametrize(
    ("names", "pattern", "channel", "harmonic"),
    [
        ("f{f}_h{h}_sc{c}.tif", "f{frame}_h{harmonic}_sc{channel}.tif", None, None),
        ("sc{c}-h{h}-{f}.tif", "sc{channel}-h{harmonic}-{frame}.tif", None, None),
        ("{f}_{M}MHz_{A}.tif", "{frame}_{harmonic}MHz_{channel}.tif", ("A", "B"), (("25", 1), ("50", 2))),
        ("day 7, {f}.{A}{h}.tif", "day 7, {frame}.{channel}{harmonic}.tif", ("A", "B"), None),
    ],
)
def test_names_of_planes_suggest_a_pattern(
    names: str, pattern: str, channel: tuple[str, str] | None, harmonic: tuple[tuple[str, int], ...] | None
) -> None:
    files = [
        names.format(f=f"{f:03}", h=h, c=c, M=25 * h, A="AB"[c - 1]) for f in (3, 4, 17) for h in (1, 2) for c in (1, 2)
    ]
    found = layout_of_names(files, (1, 2))
    assert found is not None
    assert (found.pattern, found.channel, found.harmonic) == (pattern, channel, harmonic)
    assert layout_of_names(files[1:], (1, 2)) is None
    assert layout_of_names(["one.tif", "two.tif", "three.tif", "four.tif"], (1, 2)) is None


@pytest.mark.parametrize(
    ("harmonics", "channels", "form"),
    [
        (("40", "20"), ("I", "Q"), "{}ns_{}.tif"),
        (("25", "50"), ("real", "imag"), "a_{}MHz_{}.tif"),
        (("40", "20"), ("1", "2"), "{}ns_tap{}.tif"),
    ],
)
def test_a_suggested_pattern_has_the_planes_that_the_names_say(
    harmonics: tuple[str, str], channels: tuple[str, str], form: str
) -> None:
    """In the order of letters and numbers, 20 ns comes before 40 ns, and imag before real."""
    names = [form.format(harmonic, channel) for harmonic in harmonics for channel in channels]
    found = layout_of_names(names, (1, 2))
    assert found is not None
    assert [label for label, _ in found.harmonic or ()] == list(harmonics)
    assert tuple(found.channel or "12") == channels


@pytest.mark.parametrize(
    ("period_ns", "order"), [(40.0, ["40", "20"]), (39.6, ["40", "20"]), (50.0, ["20", "40"]), (None, ["20", "40"])]
)
def test_numbers_that_are_the_periods_name_these(period_ns: float | None, order: list[str]) -> None:
    """Other numbers without a unit are taken in rising order, as frequencies."""
    names = [f"cam_{number}_{channel}.tif" for number in (20, 40) for channel in "AB"]
    found = layout_of_names(names, (1, 2), period_ns=period_ns)
    assert found is not None
    assert [label for label, _ in found.harmonic or ()] == order


def test_periods_of_two_and_one_ns_are_not_read_into_numbers_of_harmonics() -> None:
    names = [f"cam_{number}_{channel}.tif" for number in (1, 2) for channel in "AB"]
    found = layout_of_names(names, (1, 2), period_ns=2.0)
    assert found is not None
    assert found.harmonic is None


@pytest.mark.parametrize(
    ("names", "pattern"),
    [
        ("{f}_h{h}_sc{c}.tif", "{frame}_h{harmonic}_sc{channel}.tif"),
        ("h{h}_sc{c}_f{f}.tif", "h{harmonic}_sc{channel}_f{frame}.tif"),
        ("{f}_{M}MHz_{A}.tif", "{frame}_{harmonic}MHz_{channel}.tif"),
        ("img{f}_{h}_{c}.tif", None),
        ("{f}_{M}_{A}.tif", None),
    ],
)
def test_the_number_of_one_of_two_frames_is_not_taken_for_a_harmonic(names: str, pattern: str | None) -> None:
    """Two frames with the numbers 1 and 2: nothing but words beside the numbers tells them from two harmonics."""
    files = [names.format(f=f, h=h, c=c, M=25 * h, A="AB"[c - 1]) for f in (1, 2) for h in (1, 2) for c in (1, 2)]
    found = layout_of_names(files, (1, 2))
    assert (found and found.pattern) == pattern


def test_info_writes_settings_to_be_completed(here: Path) -> None:
    toml = here / "cap" / "capture.toml"
    known = toml.read_text()
    done = shell("cadtof info cap --write-settings", here)
    assert done.status != 0
    assert "already exists; add --overwrite" in done.err
    assert toml.read_text() == known
    done = shell(
        "cadtof info cap --write-settings -o mine.toml && cadtof resolve cap -o out -j 1 --settings mine.toml", here
    )
    assert done.status == 0, done.err
    assert shell("cadtof resolve cap -o again -j 1", here).status == 0
    np.testing.assert_array_equal(
        tifffile.imread(here / "out" / "frame_2.tif"), tifffile.imread(here / "again" / "frame_2.tif")
    )
    toml.unlink()
    done = shell("cadtof info cap --write-settings", here)
    assert "wrote cap/capture.toml" in done.err
    text = toml.read_text()
    assert (
        "# saturated_counts = [0, 16383]  # lower and upper limit; stored values at or beyond them are saturated; stored values"
        in text
    )
    assert (
        shell(
            "sed -i 's/^# volts_per_count/volts_per_count/; s/^# zero_counts/zero_counts/' cap/capture.toml", here
        ).status
        == 0
    )
    assert shell("cadtof resolve cap -o third -j 1", here).status == 0
    # every example is a value that its key may have
    toml.write_text(re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE))
    assert load_metadata(toml).metadata.layout.frames == 100


def test_info_writes_settings_of_volts_and_of_planes_that_nothing_names(here: Path) -> None:
    pages = tifffile.imread(here / "cap" / "frame_0.tif").reshape(4, 24, 32)
    (here / "volts").mkdir()
    np.save(here / "volts" / "frame.npy", np.zeros((4, 24, 32), np.float32))
    (here / "planes").mkdir()
    for page, name in zip(pages, ("25MHz_SC1", "25MHz_SC2", "50MHz_SC1", "50MHz_SC2"), strict=True):
        tifffile.imwrite(here / "planes" / f"rec001_{name}.tif", page)
    for folder, layout in (
        ("volts", {}),
        ("planes", {"pattern": "rec001_{harmonic}MHz_SC{channel}.tif", "harmonic": {"25": 1, "50": 2}}),
    ):
        done = shell(f"cadtof info {folder} --write-settings", here)
        assert f"wrote {folder}/capture.toml" in done.err, done.err
        text = (here / folder / "capture.toml").read_text()
        assert "# zero_counts = 8192.0  #" in text
        assert tomllib.loads(text)["layout"] == {**layout, "raw": {}}


def test_info_writes_the_layout_of_raw_dumps(here: Path) -> None:
    stored = np.full((2, 2, 4, 5), 9000, np.uint16)
    stored.tofile(here / "dump.raw")
    shell("cadtof info dump.raw --raw-dtype uint16 --raw-shape 2,2,4,5 --write-settings -o capture.toml", here)
    settings = tomllib.loads((here / "capture.toml").read_text())
    assert settings["layout"] == {"raw": {"dtype": "uint16", "shape": [2, 2, 4, 5]}}
    assert "2 harmonics × 2 channels × 4 × 5" in shell("cadtof info dump.raw", here).out


def test_frames_beyond_the_capture_end_the_run_with_status_1(here: Path) -> None:
    done = shell("cadtof resolve cap -o out --frames 3:", here)
    assert (done.status, done.out) == (1, "")
    assert done.err == "no frame was resolved: no capture has a frame in the range of --frames\n"


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ('cd cap; cadtof resolve "$CAPTURE" -o ../out', "after resolve: found an empty argument"),
        ('cadtof resolve cap -o "$OUT"', "after -o: found an empty argument"),
        ('cadtof resolve cap --out="$OUT"', "--out: found an empty argument"),
    ],
)
def test_a_shell_variable_that_is_not_set_is_reported(typed: str, message: str, here: Path) -> None:
    done = shell(typed, here)
    assert (done.status, done.out) == (2, "")
    assert f"{message}, expected a path or a value; is a variable of the shell not set?" in done.err
    assert {path.name for path in here.iterdir()} == {"cap"}
