"""The `cadtof` command: finds subcommands, and turns errors into a message and an exit status."""

import importlib
import os
import signal
import sys
from types import FrameType
from typing import NoReturn

import click

from cadtof_cli import __version__
from cadtof_cli.errors import CadtofError

COMMANDS = {
    "resolve": "Recorded frames → depth maps without multi-path interference.",
    "info": "What a capture or map file holds, and what is wrong with it.",
    "inspect": "Everything about one pixel of a recorded frame.",
    "evaluate": "Errors of depth maps against truth.",
    "preview": "A picture of a frame's maps.",
    "export": "Maps as point clouds, pictures of depths, arrays and tables.",
    "simulate": "A simulated pixel, resolved many times; or a scene recorded as a capture.",
    "sweep": "A grid of simulated conditions: CSV and heat maps.",
    "calibrate": "Measure what is wrong with a camera, for `resolve --calibration`.",
}
"""Subcommands in the order of `cadtof --help`, with what they do; each is a click command in `commands/<name>.py`."""

INTERRUPTED = 130
TERMINATED = 143
BROKEN_PIPE = 141


class LazyGroup(click.Group):
    """A group that imports the module of a subcommand only when that is run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a subcommand; None where there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(importlib.import_module(f"cadtof_cli.commands.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what each subcommand does, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, "-V", "--version", prog_name="cadtof")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def cli(debug: bool) -> None:
    """Depth maps free of multi-path interference from recorded frames of CA-dToF cameras."""


def main() -> NoReturn:
    """Run the command line and exit; no traceback reaches a user who did not ask for it."""
    signal.signal(signal.SIGTERM, _terminate)
    debug = "--debug" in sys.argv[1:2]
    try:
        sys.exit(cli.main(prog_name="cadtof", standalone_mode=False) or 0)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted", err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(BROKEN_PIPE)
    except CadtofError as error:
        if debug:
            raise
        click.echo(f"Error: {error}", err=True)
        sys.exit(error.exit_status)
    except Exception as error:
        if debug:
            raise
        click.echo(
            f"Error: unexpected {type(error).__name__}: {error}\nRun `cadtof --debug …` and report it.", err=True
        )
        sys.exit(1)


def _terminate(_signal: int, _frame: FrameType | None) -> NoReturn:
    """Leave by the same way as any other end, so that workers stop and no half-written file stays."""
    sys.exit(TERMINATED)
