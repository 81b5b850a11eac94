"""The `cadtof` command: finds subcommands, and turns errors into a message and an exit status."""

import atexit
import contextlib
import errno
import gc
import importlib
import io
import itertools
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

import click

from cadtof_cli.commands.help import HelpContext, example
from cadtof_cli.commands.terminal import forget, prepare_streams, tell
from cadtof_cli.errors import CadtofError, OutputError
from cadtof_cli.version import __version__

COMMANDS = {
    "resolve": "Resolve recorded frames into depth maps without multi-path interference.",
    "info": "Show what a capture or map file contains, and what is wrong with it.",
    "inspect": "Show everything about one pixel of a recorded frame.",
    "evaluate": "Compare depth maps with the true depths: errors.",
    "compare": "Compare two runs, or a run and truth, layer by layer.",
    "profile": "Draw or print the cross-section of maps along a line.",
    "preview": "Draw the maps of a frame, or of many frames.",
    "report": "Write an HTML page about a run: totals, failures, a viewer of all layers, point clouds.",
    "export": "Write maps as point clouds, depth images, arrays and tables.",
    "simulate": "Simulate a pixel and resolve it many times, or record a simulated scene.",
    "sweep": "Simulate a pixel over a grid of conditions: CSV and heat maps.",
    "calibrate": "Measure the errors of a camera, for `resolve --calibration`.",
}
"""Subcommands in the order of `cadtof --help`, with what they do; each is a click command in `commands/<name>.py`."""

OBJECTS_BETWEEN_COLLECTIONS = 100_000
"""The garbage collector runs this rarely: imports make tens of thousands of objects, and no garbage."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that say how many threads linear algebra has: one, unless the user says otherwise.

Our matrices are small, and our processes keep all cores busy. While numpy is imported, threads that wait for work take a core
each; and what a sum comes to depends on how many there are.
"""

PROGRAM = "cadtof"
COMPLETE = "_CADTOF_COMPLETE"
"""Environment variable by which a shell asks how a line may go on (docs/shells.md)."""

_OUTPUTS = frozenset({"-o", "--out", "--csv", "--log", "--plot"})
"""Options that name what is written."""

_CUT_OFF = "Python has kept bytecode that is cut off, as by a full disk"

INTERRUPTED = 130
BROKEN_PIPE = 141


class LazyGroup(click.Group):
    """A group that imports the module of a subcommand only when that is run."""

    context_class = HelpContext

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a subcommand; None where there is none of that name, or one like it."""
        if cmd_name in COMMANDS:
            command: click.Command = getattr(importlib.import_module(f"cadtof_cli.commands.{cmd_name}"), cmd_name)
            command.context_class = HelpContext
            # Python leaves out all other descriptions under PYTHONOPTIMIZE=2
            command.help = command.help or COMMANDS[cmd_name]
            return command
        import difflib

        if close := difflib.get_close_matches(cmd_name, COMMANDS, n=1):
            ctx.fail(f"No such command '{cmd_name}': did you mean {close[0]}?")
        return None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what each subcommand does, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


cli = LazyGroup(
    PROGRAM,
    help="Make depth maps without multi-path interference from recorded frames of CA-dToF cameras.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog=example(
        "cadtof info sample_data/corner",
        "cadtof resolve sample_data/corner -o maps",
        "cadtof evaluate maps --truth sample_data/corner/truth.exr",
    ),
)
"""The command: what it does is done by its subcommands."""

click.version_option(__version__, "-V", "--version", prog_name=PROGRAM)(cli)
click.option("--debug", is_flag=True, help="Show the Python traceback of an error.")(cli)


def main() -> NoReturn:
    """Run the command line and exit; no traceback reaches a user who did not ask for it."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    # nor does it run at exit
    atexit.register(gc.freeze)
    for name in BLAS_THREADS:
        os.environ.setdefault(name, "1")
    prepare_streams()
    atexit.register(_let_go_of_stderr)
    for number in filter(None, (signal.SIGTERM, getattr(signal, "SIGHUP", None))):
        # nohup has SIGHUP ignored, and that is to stay
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _terminate)
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        # from here on it is answered, see `__main__.py`
        signal.signal(signal.SIGINT, signal.default_int_handler)
    debug = "--debug" in sys.argv[1:2]
    if instruction := os.environ.get(COMPLETE):
        from click.shell_completion import shell_complete

        sys.exit(shell_complete(cli, {}, PROGRAM, COMPLETE, instruction))
    status = 0
    try:
        _require_words(sys.argv[1:])
        # as `cli.main` does, but for the exit status that it makes of a reader who has gone away; help ends by Exit
        with contextlib.suppress(click.exceptions.Exit), cli.make_context(PROGRAM, sys.argv[1:]) as context:
            status = cli.invoke(context) or 0
        sys.stdout.flush()
        sys.exit(status)
    except (click.Abort, KeyboardInterrupt) as error:
        tell("\n" + ": ".join(filter(None, ("interrupted", str(error)))), err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # as a program ends that SIGPIPE ends
        forget(sys.stdout)
        sys.exit(BROKEN_PIPE)
    except Exception as error:
        if debug and not isinstance(error, click.ClickException):
            raise
        message, status = _message_and_status(error)
        tell(message, err=True)
        forget(sys.stdout)
        sys.exit(status)


def _require_words(arguments: Sequence[str]) -> None:
    """Make sure that no argument is empty: as a path it would mean the current folder, whatever variable it was to come from.

    Nor is anything to be written into a file called `-`, which stands for stdout elsewhere.

    Raises:
        click.UsageError: one is.
    """
    for before, argument in itertools.pairwise((PROGRAM, *arguments)):
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise click.UsageError(
                f"{argument.rstrip('=') or f'after {before}'}: found nothing, expected a path or a value: is a variable of"
                " the shell not set?"
            )
        if argument == "-" and before in _OUTPUTS:
            raise click.UsageError(
                f"{before}: found -, expected a name; what can go to stdout goes there without {before}"
            )


def _message_and_status(error: Exception) -> tuple[str, int]:
    """Return the message of an error, and the exit status."""
    match error:
        case click.ClickException():
            text = io.StringIO()
            error.show(text)
            return text.getvalue().rstrip(), error.exit_code
        case CadtofError():
            return f"Error: {error}", error.exit_status
        case MemoryError():
            return "Error: not enough memory; try fewer --jobs, or smaller inputs", 1
        case OSError(filename=None):
            told = f"standard output: cannot be written: {error.strerror or error}"
            if isinstance(error, FileNotFoundError):
                told = "the folder that cadtof was started in is gone; go into one that is there"
            elif error.errno in {errno.EMFILE, errno.ENFILE}:
                told = f"{error.strerror}: allow more open files (ulimit -n)"
            return f"Error: {told}", OutputError.exit_status
        case OSError():
            return f"Error: {error.filename}: {error.strerror or error}", 1
        case _:
            advice = "Run `cadtof --debug …` and report it."
            if "marshal data" in str(error):
                advice = f"{_CUT_OFF}: remove the folders __pycache__ where cadtof and what it needs are installed"
            return f"Error: unexpected {type(error).__name__}: {error}\n{advice}", 1


def _let_go_of_stderr() -> None:
    """Keep the exit status where stderr, on a full disk for instance, could not take everything."""
    try:
        sys.stderr.flush()
    except (OSError, ValueError):
        forget(sys.stderr)


def _terminate(number: int, _frame: FrameType | None) -> NoReturn:
    """Leave by the same way as any other end, so that workers stop and no half-written file stays."""
    sys.exit(128 + number)
