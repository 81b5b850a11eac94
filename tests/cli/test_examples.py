"""Each command's help ends with an example, and every example works as it stands."""

import shlex
from pathlib import Path

import click
import pytest

from cadtof_cli.cli import cli
from cadtof_cli.commands.help import example, example_lines
from tests.support.commands import every_command
from tests.support.run_cadtof import ROOT, cadtof

COMMANDS = {"": cli, **every_command()}


@pytest.mark.parametrize("words", COMMANDS)
def test_a_help_ends_with_an_example_of_the_command(words: str) -> None:
    lines = example_lines(COMMANDS[words].epilog)
    assert lines, f"cadtof {words}: its help has no example; give its decorator epilog=example(…)"
    assert any(line.startswith(f"cadtof {words}".rstrip()) for line in lines)
    shown = [line.strip() for line in cadtof(*words.split(), "--help").out.splitlines()]
    assert tuple(shown[-len(lines) :]) == lines
    assert all(len(line) <= 110 for line in lines), "wider than a terminal of 110 columns"


@pytest.mark.parametrize("words", COMMANDS)
def test_an_example_works(words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    for line in example_lines(COMMANDS[words].epilog):
        _, *arguments = shlex.split(line)
        command = COMMANDS[arguments[0]]
        if isinstance(command, click.Group):
            command = COMMANDS[" ".join(arguments[:2])]
        # so that the test starts no other processes
        alone = ("-j", "1") if any("--jobs" in param.opts for param in command.params) else ()
        done = cadtof(*arguments, *alone)
        assert done.status == 0, f"{line}: {done.err}"
        if "-o" in arguments:
            out = Path(arguments[arguments.index("-o") + 1])
            assert out.exists(), f"{line}: wrote no {out}"
            assert out.is_file() or any(out.iterdir())
        else:
            assert done.out.strip(), f"{line}: printed nothing"


def test_what_an_example_looks_like() -> None:
    assert example("cadtof a") == "\b\nExample:\n  cadtof a"
    assert example_lines(example("cadtof a", "cadtof b -o c")) == ("cadtof a", "cadtof b -o c")
    assert example_lines("Something else.") == example_lines(None) == ()


def test_the_examples_of_all_steps_of_a_calibration_are_of_one_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for step in ("dark", "response", "petzval"):
        for line in example_lines(COMMANDS[f"calibrate {step}"].epilog):
            done = cadtof(*shlex.split(line)[1:])
            assert done.status == 0, f"{line}: {done.err}"
            assert "warning" not in done.out + done.err, f"{line}: {done.out}{done.err}"
