"""Every command has help, every option says what it does, and the README names them all."""

from pathlib import Path

import click
import pytest

from cadtof_cli.cli import COMMANDS, cli
from tests.support.run_cadtof import cadtof

README = Path(__file__).parents[2] / "README.md"


def commands(name: str) -> list[click.Command]:
    found = cli.get_command(click.Context(cli), name)
    assert found is not None
    return [found, *(found.commands.values() if isinstance(found, click.Group) else ())]


@pytest.mark.parametrize("name", COMMANDS)
def test_help(name: str) -> None:
    for command in commands(name):
        assert command.help
        options = [param for param in command.params if isinstance(param, click.Option)]
        assert not [option.opts for option in options if not option.help]
    done = cadtof(name, "--help")
    assert done.status == 0
    assert done.out.startswith(f"Usage: cadtof {name}")
    assert f"cadtof {name}" in README.read_text(encoding="utf-8")


def test_an_unknown_command_is_an_error() -> None:
    done = cadtof("resolv")
    assert (done.status, done.out) == (2, "")
    assert "No such command 'resolv'" in done.err
