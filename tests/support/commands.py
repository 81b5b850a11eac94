"""Every command of the program, including the commands of groups."""

import click

from cadtof_cli.cli import COMMANDS, cli

GROUP = click.Context(cli, info_name="cadtof")


def every_command() -> dict[str, click.Command]:
    """Return every command by the words that call it."""
    found: dict[str, click.Command] = {}
    for name in COMMANDS:
        command = cli.get_command(GROUP, name)
        assert command is not None
        found[name] = command
        if isinstance(command, click.Group):
            context = click.Context(command, parent=GROUP, info_name=name)
            for inner in command.list_commands(context):
                below = command.get_command(context, inner)
                assert below is not None
                found[f"{name} {inner}"] = below
    return found
