"""The Tab key in bash, zsh and fish, as docs/shells.md sets it up."""

import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from cadtof_cli.cli import COMMANDS, COMPLETE, PROGRAM, cli
from tests.support.needed import needed_program
from tests.support.run_cadtof import ENVIRONMENT, ROOT


@pytest.fixture(autouse=True)
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """`cadtof` on the PATH, where shells look for it."""
    file = tmp_path / "bin" / "cadtof"
    file.parent.mkdir()
    # as pip does: a line with #! cannot hold a path with spaces, so sh reads the next line and runs Python on this file
    start = f'#!/bin/sh\n{3 * chr(39)}exec\' "{sys.executable}" "$0" "$@"\n\' {3 * chr(39)}\n'
    file.write_text(f"{start}from cadtof_cli.cli import main\nmain()\n", encoding="utf-8")
    file.chmod(0o755)
    monkeypatch.setenv("PATH", f"{file.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("HOME", str(tmp_path))
    return file


def _line(shell: str) -> str:
    """Return the line that docs/shells.md gives for a shell."""
    rows = (ROOT / "docs" / "shells.md").read_text(encoding="utf-8").splitlines()
    return next(row.split("|")[2].strip(" `") for row in rows if row.startswith(f"| {shell}"))


@pytest.mark.parametrize("command", sorted({*COMMANDS, "calibrate dark"} - {"calibrate", "simulate", "sweep"}))
def test_files_are_completed_where_a_command_takes_files(command: str) -> None:
    """A shell that completes `cadtof` asks nobody else: without this, the Tab key does nothing."""
    (found,) = ShellComplete(cli, {}, PROGRAM, COMPLETE).get_completions(command.split(), "sam")
    assert (found.type, found.value) == ("file", "sam")


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        (("cadtof", "res"), "resolve"),
        (("cadtof", "resolve", "--recu"), "--recursive"),
        (("cadtof", "cal"), "calibrate"),
    ],
)
def test_bash_completes_commands_and_options(typed: tuple[str, ...], completed: str) -> None:
    words = " ".join(typed)
    script = f"""
    {_line("bash")}
    COMP_WORDS=({words}) COMP_CWORD={len(typed) - 1}
    $(complete -p cadtof | sed 's/.*-F \\([^ ]*\\) .*/\\1/') cadtof
    printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        [needed_program("bash"), "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == [completed]


def _full_disk() -> int:
    return os.open("/dev/full", os.O_WRONLY)


def _pipe_without_reader() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize(
    ("opened", "status", "message"),
    [
        (_full_disk, 2, "Error: standard output: cannot be written: No space left on device\n"),
        (_pipe_without_reader, 141, ""),
    ],
)
def test_a_completion_script_that_cannot_be_written_is_reported(
    opened: Callable[[], int], status: int, message: str
) -> None:
    environment, output = {**os.environ, "_CADTOF_COMPLETE": "bash_source"}, opened()
    try:
        done = subprocess.run(
            ["cadtof"], env=environment, stdout=output, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    finally:
        os.close(output)
    assert (done.returncode, done.stderr) == (status, message)


@pytest.mark.parametrize(("typed", "completed"), [("cadtof res", "resolve"), ("cadtof resolve --recu", "--recursive")])
def test_fish_completes_commands_and_options(typed: str, completed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    # fish finds no program below a folder whose letters the locale lacks
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    script = f"{_line('fish')}; complete -C '{typed}'"
    done = subprocess.run(
        [needed_program("fish"), "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert [line.split("\t")[0] for line in done.stdout.splitlines()] == [completed]


@pytest.mark.parametrize(
    ("typed", "completed"), [("cadtof reso", "cadtof resolve "), ("cadtof resolve --recu", "--recursive")]
)
def test_zsh_completes_commands_and_options(typed: str, completed: str, tmp_path: Path) -> None:
    """Type the letters and the Tab key into a terminal in which zsh runs."""
    ours, theirs = pty.openpty()
    environment = {**ENVIRONMENT, **os.environ, "TERM": "dumb", "PS1": "% "}
    setup = f"autoload -Uz compinit; compinit -u; {_line('zsh')}; print rea''dy\n"
    with subprocess.Popen(
        [needed_program("zsh"), "-f", "-i"], stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=tmp_path
    ) as process:
        os.close(theirs)
        try:
            os.write(ours, setup.encode())
            assert "ready" in _shown(ours, "ready")
            os.write(ours, f"{typed}\t".encode())
            assert completed in _shown(ours, completed)
        finally:
            process.kill()
    os.close(ours)


def _shown(terminal: int, awaited: str) -> str:
    """Return what a terminal shows until the awaited text is there, or until a minute is over."""
    shown, until = "", time.monotonic() + 60
    os.set_blocking(terminal, False)
    while awaited not in shown and time.monotonic() < until:
        try:
            shown += os.read(terminal, 4096).decode(errors="replace")
        except BlockingIOError:
            time.sleep(0.05)
    return shown
