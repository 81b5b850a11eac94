"""Standard streams that are closed, full, or lose their reader: the status tells, and a message if one can be written."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cadtof_cli.commands.terminal import tell
from tests.support.captures import record
from tests.support.run_cadtof import ENVIRONMENT, PROGRAM, ROOT, Finished, cadtof, program


def _shell(script: str, *arguments: object) -> Finished:
    """Run a script by bash; in it, "$@" stands for `cadtof` with its arguments."""
    command = ["bash", "-c", script, "bash", *PROGRAM, *map(str, arguments)]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False)
    return Finished(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_reader_that_goes_away_ends_us_like_any_program(jobs: int, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=40), tmp_path / "out"
    script = '"$@" | (read -r line; echo "$line"); exit ${PIPESTATUS[0]}'
    done = _shell(script, "resolve", capture.folder, "-o", out, "-j", jobs, "-q", "--json")
    assert (done.status, done.err) == (141, "")
    first = json.loads(done.out)
    assert (first["status"], first["source"]) == ("ok", str(capture.files[0]))
    assert not list(out.glob(".*"))


@pytest.mark.parametrize("arguments", [("--help",), ("resolve", "--help"), ("info", "{capture}"), ("--version",)])
def test_a_reader_that_is_gone_before_anything_is_written(arguments: tuple[str, ...], tmp_path: Path) -> None:
    capture = record(tmp_path / "capture").folder
    # the reader is gone before anything is written
    script = '{ sleep 1; "$@"; echo $? >&2; } | true'
    done = _shell(script, *(word.format(capture=capture) for word in arguments))
    assert done.err == "141\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("info", "{capture}"),
        ("sweep", "--asr", "1", "--mpi", "0", "--integration-length", "1e4", "--runs", "2", "-j", "1"),
        ("resolve", "{capture}", "-o", "{out}", "--json"),
    ],
)
@pytest.mark.parametrize(
    ("place", "message"), [(">/dev/full", "No space left on device"), (">&-", "Bad file descriptor")]
)
def test_stdout_that_takes_nothing(place: str, message: str, arguments: tuple[str, ...], tmp_path: Path) -> None:
    capture = record(tmp_path / "capture").folder
    done = _shell(f'"$@" {place}', *(word.format(capture=capture, out=tmp_path / "out") for word in arguments))
    assert done.status == 2
    assert done.err.splitlines()[-1].startswith("Error: standard output: cannot be written: ")
    assert message in done.err
    assert "unexpected" not in done.err
    assert "Exception ignored" not in done.err


def test_a_log_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    done = _shell(
        '"$@"', "resolve", record(tmp_path / "capture").folder, "-o", tmp_path / "out", "-q", "--log", "/dev/full"
    )
    assert (done.status, done.err) == (2, "Error: /dev/full: cannot be written: No space left on device\n")


def test_a_current_folder_that_is_gone_is_reported(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture").folder
    script = 'mkdir gone; cd gone; rmdir ../gone; "$@"'
    done = _shell(f"cd {shlex.quote(str(tmp_path))}; {script}", "resolve", capture, "-o", "out", "-q")
    message = "Error: the folder in which cadtof was started is gone; change to a folder that exists\n"
    assert (done.status, done.err) == (2, message)
    assert _shell(f"cd {shlex.quote(str(tmp_path))}; {script}", "--version").status == 0


@pytest.mark.parametrize("most", range(6, 13, 2))
def test_the_limit_of_open_files_is_reported(most: int, tmp_path: Path) -> None:
    capture = record(tmp_path / "capture", frames=2).folder
    done = _shell(f'ulimit -n {most}; "$@"', "resolve", capture, "-o", tmp_path / "out", "-j", 2)
    assert done.status in {1, 2}
    assert "Too many open files" in done.err
    assert "allow more open files (ulimit -n)" in done.err
    assert "standard output" not in done.err
    assert "unexpected" not in done.err


_BEFORE_NUMPY = """
import re, sys
from cadtof_cli.cli import main
class Watched:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            with open("/proc/self/status") as status:
                sys.stdout.write(re.search("VmPeak: *[^0-9]*([0-9]+) kB", status.read())[1])
            sys.exit()
sys.meta_path.insert(0, Watched())
main()
"""
"""Prints the memory that the command line has taken when it imports its first library, in KiB."""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not count the memory of libraries")
@pytest.mark.parametrize("more_kib", [4_000, 20_000])
def test_too_little_memory_for_a_library_is_reported(more_kib: int, tmp_path: Path) -> None:
    """How much memory is too little depends on the Python, and on whether it has to compile modules."""
    arguments = ("resolve", record(tmp_path / "capture").folder, "-o", tmp_path / "out", "-j", 2)
    command = [sys.executable, "-c", _BEFORE_NUMPY, *map(str, arguments)]
    before = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=True)
    done = _shell(f'ulimit -v {int(before.stdout) + more_kib}; "$@"', *arguments)
    assert done.status == 1
    assert re.fullmatch(r"Error: .*\.so.*: not enough memory \(ulimit -v\), or the disk is mounted noexec\n", done.err)


@pytest.mark.parametrize("place", ["2>&-", "2>/dev/full"])
def test_stderr_that_takes_nothing(place: str, tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    done = _shell(f'"$@" {place}', "resolve", capture.folder, "-o", out, "-j", 2, "--json")
    assert done.status == 0
    assert [json.loads(line)["status"] for line in done.out.splitlines()] == ["ok", "ok"]
    assert _shell(f'"$@" {place}', "resolve", tmp_path / "nowhere", "-o", out).status == 2


def test_notes_that_stderr_cannot_take_do_not_keep_workers_from_starting(tmp_path: Path) -> None:
    """Python writes out its buffers before it forks, and stderr cannot take them."""
    capture = record(tmp_path / "capture", frames=4)
    (capture.folder / "capture.toml").write_text("[voltage]\nzero_counts = 8192.0\nvolts_per_count = 6.0e-5\n")
    arguments = ("resolve", capture.folder, "-o", tmp_path / "out", "-j", 2, "--json")
    done = _shell('"$@" 2>/dev/full', *arguments)
    assert done.status == 0
    assert [json.loads(line)["status"] for line in done.out.splitlines()] == ["ok"] * 4


def test_letters_that_an_encoding_lacks_are_shown_by_their_number(tmp_path: Path) -> None:
    capture = str(record(tmp_path / "capture").folder)
    command = [*PROGRAM, "inspect", capture, "--pixel", "3,3", "--mpi-model", "discrete"]
    environment = {**ENVIRONMENT, "PYTHONUTF8": "0", "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(command, env=environment, capture_output=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert "\\u03c3 " in done.stdout.decode("latin-1")
    assert " ± " in done.stdout.decode("latin-1")


def test_captures_are_resolved_with_all_streams_closed(tmp_path: Path) -> None:
    capture, out = record(tmp_path / "capture", frames=2), tmp_path / "out"
    done = _shell('"$@" <&- >&- 2>&-', "resolve", capture.folder, "-o", out, "-j", 2)
    assert (done.status, done.out, done.err) == (0, "", "")
    assert sorted(path.name for path in out.iterdir()) == ["frame_0.tif", "frame_1.tif", "frames.jsonl", "run.json"]


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the system does not list open files")
def test_an_error_leaves_no_file_open(tmp_path: Path) -> None:
    # hundreds of tests run the command line in one process
    assert cadtof("info", tmp_path / "none").status == 2
    before = len(list(Path("/proc/self/fd").iterdir()))
    assert cadtof("info", tmp_path / "none").status == 2
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_names_cannot_steer_a_terminal(tmp_path: Path) -> None:
    folder = tmp_path / "red\x1b[31m\u202e\x07\nresolved 1 of 1"
    capture = record(folder)
    capture.files[0].write_bytes(b"nothing")
    for arguments in (("resolve", folder, "-o", tmp_path / "out"), ("info", folder), ("info", folder / "\x1b]0;x")):
        done = _shell('"$@"', *arguments)
        assert done.status in {1, 2}
        assert "\x1b" not in done.out + done.err
        assert "\u202e" not in done.out + done.err
        assert "\x07" not in done.out + done.err
        assert "red\\x1b[31m\\u202e\\x07" in done.err
        assert "\nresolved 1 of 1" not in done.out + done.err
    assert "\x1b" not in _shell('"$@"', "info", "--no-such\x1b[2J").err


def test_control_characters_are_escaped_and_other_letters_shown(capsys: pytest.CaptureFixture[str]) -> None:
    tell("µ – 320 × 240\tB", "")
    tell("\x1b[0m\r\udcff\x9b\u2028\n\u061c", err=True)
    assert capsys.readouterr() == ("µ – 320 × 240\tB\n\n", r"\x1b[0m\r\udcff\x9b\u2028\n\u061c" + "\n")


def test_names_cannot_forge_the_lines_of_a_log(tmp_path: Path) -> None:
    capture, log = record(tmp_path / "capture"), tmp_path / "log.txt"
    (capture.folder / "bad\n2026-01-01T00:00:00+00:00 resolved\x1b[2J.tif").write_bytes(b"II*\0" + bytes(20))
    assert program("resolve", capture.folder, "-o", tmp_path / "out", "--log", log).status == 1
    lines = log.read_text().splitlines()
    assert not [line for line in lines if line.startswith("2026-01-01") or not line[:4].isdigit()]
    assert [line for line in lines if r"bad\n2026-01-01T00:00:00+00:00 resolved\x1b[2J.tif" in line]


def test_everything_that_is_said_goes_through_tell() -> None:
    """`tell` escapes what would steer a terminal, and reports what could not be written."""
    package = ROOT / "cadtof_cli"
    for path in package.rglob("*.py"):
        if path != package / "commands" / "terminal.py":
            assert not re.search(r"\bclick\.s?echo\(|(?<!\.)\bprint\(", path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize(("ends", "status"), [("sys.exit(0)", 0), ("sys.exit(3)", 3), ("raise OSError('seen')", 1)])
def test_what_waits_for_the_end_of_the_process_is_done(ends: str, status: int) -> None:
    script = (
        "import atexit, sys, threading, time\n"
        "from cadtof_cli import __main__, cli\n"
        "class Kept:\n"
        "    def __del__(self): print('freed', flush=True)\n"
        "kept = Kept()\n"
        "def run():\n"
        "    threading.Thread(target=lambda: (time.sleep(0.2), print('thread', flush=True))).start()\n"
        "    atexit.register(print, 'function', flush=True)\n"
        f"    {ends}\n"
        "cli.main = run\n"
        "__main__.main()\n"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=False)
    # after an error that Python shows, the process ends in Python's own way, which frees all objects
    freed = "freed\n" if status == 1 else ""
    assert (done.returncode, done.stdout) == (status, f"thread\nfunction\n{freed}")
    assert ("seen" in done.stderr) is (status == 1)
