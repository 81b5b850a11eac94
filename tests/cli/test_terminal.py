"""Progress is drawn on a terminal and nowhere else."""

import os
import pty
import re
import subprocess
from pathlib import Path

import pytest

from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, program
from tests.support.terminal import on_terminal


def _without_control_sequences(shown: str) -> str:
    return re.sub(r"\x1b\[[?\d;]*[a-zA-Z]", "", shown)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_terminal_shows_a_bar(jobs: int, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=4, form="exr", toml="[pixel]\nintegration_length = 1e5\n")
    out, shown = on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-j", jobs, "--json")
    assert len(out.splitlines()) == 4
    assert "not given, so taken from the paper" in " ".join(shown.split())
    _, bar, after = shown.partition("━")
    assert bar
    assert "resolving" in shown
    assert "4/4" in after
    assert " frames/s" in after.partition("resolved 4 of 4 frames")[0]
    assert "resolved 4 of 4 frames" in after
    assert "\x1b[?25l" not in shown, "if the process is killed, the cursor stays hidden"


@pytest.mark.parametrize(("columns", "parts"), [(50, 5), (40, 4), (28, 3), (20, 2)])
def test_the_bar_takes_one_line_however_narrow_the_terminal_is(columns: int, parts: int, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=4, form="exr")
    _, shown = on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, columns=columns)
    drawn, _, _ = shown.partition("resolved 4 of 4")
    assert "\x1b[1A" not in drawn
    lines = re.split(r"[\r\n]+", _without_control_sequences(drawn))
    assert max(len(line) for line in lines if re.search(r"\d/[4?]", line)) <= columns
    last = [line for line in lines if line][-1]
    by_importance = ("4/4", "0:00:00", "resolving", "━━━━━━━━", " frames/s")
    assert [part in last for part in by_importance] == [place < parts for place in range(5)]


@pytest.mark.parametrize("size", ["0", "²", "9" * 5000])
def test_a_size_in_the_environment_that_no_terminal_has_is_ignored(size: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=4, form="exr")
    _, shown = on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, COLUMNS=size, LINES=size)
    assert "━━━━━━━━ 4/4" in _without_control_sequences(shown)


def test_lines_are_broken_between_words(tmp_path: Path) -> None:
    """This holds above the bar, below it, and in an error. A path stays whole."""
    capture, out = record(tmp_path / "capture", frames=2).folder, tmp_path / ("long_" * 20 + "name")
    _, shown = on_terminal("resolve", capture, "-o", out, "-j", 1, columns=40)
    _, refused = on_terminal("resolve", capture, "-o", out, "-j", 1, columns=40, status=2, TERM="dumb")
    shown += refused
    lines = _without_control_sequences(shown).replace("\r", "\n").splitlines()
    assert not [line for line in lines if len(line) > 40 and " " in line.strip()]
    assert str(out).split()[-1] in lines
    assert "add --overwrite to replace, --resume to go on" in " ".join(shown.split())


@pytest.mark.parametrize("kind", ["dumb", ""])
def test_a_terminal_that_cannot_move_its_cursor_gets_lines(kind: str, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=4)
    _, shown = on_terminal("resolve", capture.folder, "-o", tmp_path / "out", TERM=kind)
    assert "\x1b" not in shown
    assert "resolved 4 of 4" in shown


def test_a_command_goes_on_when_its_terminal_is_closed(tmp_path: Path) -> None:
    """This happens when a user closes the window of a command that was told to stay (`disown`, `setsid`)."""
    ours, theirs = pty.openpty()
    words = ("simulate", "--scene", "corner", "--width", 64, "--height", 48, "--frames", 30, "-o", tmp_path / "out")
    command = [*PROGRAM, *map(str, words)]
    process = subprocess.Popen(command, env={**ENVIRONMENT, "TERM": "xterm"}, stdout=subprocess.DEVNULL, stderr=theirs)
    os.close(theirs)
    shown = b""
    while "━".encode() not in shown:
        shown += os.read(ours, 4096)
    os.close(ours)
    assert process.wait(60) == 0
    assert len(list((tmp_path / "out").glob("frame_*"))) == 30


def test_an_error_at_the_beginning_leaves_no_bar(tmp_path: Path) -> None:
    _, shown = on_terminal("resolve", tmp_path / "nowhere", "-o", tmp_path / "out", status=2)
    (bar, cleared, error) = shown.partition("\r\x1b[1A\x1b[2K")
    assert bar.count("\n") == 1
    assert cleared
    assert error.startswith("Error: ")


def test_info_shows_a_bar_while_it_reads(tmp_path: Path) -> None:
    out, shown = on_terminal("info", record(tmp_path / "capture", frames=3).folder, "-j", 1)
    assert "3/3" in shown.partition("reading")[2]
    assert "frames" in out


def test_a_bar_that_showed_no_step_is_gone_at_the_end(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1)
    _, shown = on_terminal("info", tmp_path / "out" / "frame_0.tif")
    # the line of the bar is erased, and nothing is written after that
    assert shown.rpartition("\x1b[2K")[2].strip() == ""


def test_quiet_is_quiet_on_a_terminal_too(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    assert on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-q") == ("", "")


def test_without_a_terminal_there_is_no_bar(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=3)
    done = program("resolve", capture.folder, "-o", tmp_path / "out", "-j", 2)
    assert done.out == ""
    # without compiled kernels, a note says so first
    assert next(line for line in done.err.splitlines() if "kernel" not in line).startswith("resolved 3 of 3 frames in ")
    assert not any(sign in done.err for sign in ("\x1b", "━", "resolving"))


def test_names_are_shown_as_they_are_above_a_bar(tmp_path: Path) -> None:
    """`:warning:` was drawn as a picture."""
    capture = record(tmp_path / "capture")
    (capture.folder / "a:warning:b.tif").write_bytes(b"II*\0" + bytes(20))
    _, shown = on_terminal("resolve", capture.folder, "-o", tmp_path / "out", "-j", 1, columns=400, status=1)
    assert "a:warning:b.tif: damaged TIFF" in shown
