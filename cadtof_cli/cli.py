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
from cadtof_cli.files.system import expanded
from cadtof_cli.version import __version__

COMMANDS = {
    "resolve": "Resolve recorded frames into depth maps without multi-path interference.",
    "info": "Show what a capture or map file contains, and what is wrong with it.",
    "inspect": "Show everything about one pixel of a recorded frame.",
    "evaluate": "Compare depth maps with the true depths, and print the errors.",
    "compare": "Compare two runs, or a run and truth, layer by layer.",
    "profile": "Draw or print the cross-section of maps along a line.",
    "preview": "Draw the maps of a frame, or of many frames.",
    "report": "Write an HTML page about a run: totals, failures, a viewer of all layers, point clouds.",
    "export": "Write maps as point clouds, depth images, arrays and tables.",
    "simulate": "Simulate a pixel and resolve it many times, or record a simulated scene.",
    "sweep": "Simulate a pixel over a grid of conditions: CSV and heat maps.",
    "calibrate": "Measure the errors of a camera, for `resolve --calibration`.",
}
"""Subcommands and their descriptions, in the order of `cadtof --help`. Each is a command in `commands/<name>.py`."""

OBJECTS_BETWEEN_COLLECTIONS = 100_000
"""Number of new objects after which the garbage collector runs.

Imports make tens of thousands of objects, but no garbage.
"""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that set the number of threads of linear algebra: one, unless the user sets another number.

Our matrices are small, and our processes keep all cores busy. While numpy is imported, each thread that waits for work
occupies a core. The result of a sum depends on the number of threads.
"""

PROGRAM = "cadtof"
COMPLETE = "_CADTOF_COMPLETE"
"""Environment variable by which a shell asks for the completions of a command line (docs/shells.md)."""

_OUTPUTS = frozenset({"-o", "--out", "--csv", "--log", "--over-time", "--plot"})
"""Options that name a file or folder to write."""

_CALLED_DASH = {f"{name}=-" if name.startswith("--") else f"{name}-": name for name in _OUTPUTS}
"""Arguments that name the output `-` in the same word as the option, such as `--out=-`, and their option."""

_CUT_OFF = "Python has stored bytecode that is cut off; was a disk full?"

RAISED_AGAIN_S = 0.001
"""Time after which the end of the command is tried again, if Python was in a call that cannot be ended."""

_NO_ROOM = "failed to map segment from shared object"
"""What the system says if memory is too short for a library, or if no file of the disk may be executed (noexec)."""

INTERRUPTED = 130
BROKEN_PIPE = 141


class LazyGroup(click.Group):
    """A group that imports the module of a subcommand only when the subcommand is used."""

    context_class = HelpContext

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a subcommand; return None if no subcommand has this name or a similar one.

        Raises:
            click.UsageError: a subcommand has a similar name.
        """
        if cmd_name in COMMANDS:
            command: click.Command = getattr(importlib.import_module(f"cadtof_cli.commands.{cmd_name}"), cmd_name)
            # PYTHONOPTIMIZE=2 removes docstrings, and with them the command's own description
            command.help = command.help or COMMANDS[cmd_name]
            return command
        import difflib

        if close := difflib.get_close_matches(cmd_name, COMMANDS, n=1):
            ctx.fail(f"No such command '{cmd_name}': did you mean {close[0]}?")
        return None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the description of each subcommand, without importing any of them."""
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
"""The `cadtof` command. All work is done by its subcommands."""

click.version_option(__version__, "-V", "--version", prog_name=PROGRAM)(cli)
click.option("--debug", is_flag=True, help="Show the Python traceback of an error.")(cli)


def main() -> NoReturn:
    """Run the command line and exit; no traceback reaches a user who did not ask for it."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    for name in BLAS_THREADS:
        os.environ.setdefault(name, "1")
    prepare_streams()
    atexit.register(_flush_stderr)
    for number in filter(None, (signal.SIGTERM, getattr(signal, "SIGHUP", None))):
        # an ignored signal stays ignored: nohup ignores SIGHUP
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _terminate)
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        # `__main__.py` switched Ctrl-C to the default action during imports; from here on, it raises KeyboardInterrupt
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.unraisablehook = _raised_again
    debug = "--debug" in sys.argv[1:2]
    status = 0
    try:
        if instruction := os.environ.get(COMPLETE):
            from click.shell_completion import shell_complete

            sys.exit(shell_complete(cli, {}, PROGRAM, COMPLETE, instruction))
        arguments = expanded(sys.argv[1:])
        _require_words(arguments)
        # as `cli.main` does, but with our own exit status if the reader of stdout is gone; --help ends by raising Exit
        with contextlib.suppress(click.exceptions.Exit), cli.make_context(PROGRAM, arguments) as context:
            status = cli.invoke(context) or 0
        sys.stdout.flush()
        sys.exit(status)
    except (click.Abort, KeyboardInterrupt) as error:
        tell("", ": ".join(filter(None, ("interrupted", str(error)))), err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # the exit status of a program that SIGPIPE ends
        forget(sys.stdout)
        sys.exit(BROKEN_PIPE)
    except Exception as error:
        if debug and not isinstance(error, click.ClickException):
            raise
        lines, status = _message_and_status(error)
        tell(*lines, err=True)
        forget(sys.stdout)
        sys.exit(status)


def _require_words(arguments: Sequence[str]) -> None:
    """Make sure that no argument is empty or unreadable, and that no output is called `-`.

    An empty argument comes from a shell variable that is not set; as a path, it would mean the current folder. In other
    programs `-` stands for stdout, so a file of this name would be a surprise.

    Raises:
        click.UsageError: an argument is empty or not in the encoding of the locale, or an output is called `-`.
    """
    for before, argument in itertools.pairwise((PROGRAM, *arguments)):
        try:
            os.fsencode(argument)
        except UnicodeEncodeError as error:
            raise click.UsageError(
                f"{argument!a}: found a name that is not in {error.encoding}, the encoding of the locale; set PYTHONUTF8=1"
            ) from error
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise click.UsageError(
                f"{argument.rstrip('=') or f'after {before}'}: found an empty argument, expected a path or a value; is a"
                " variable of the shell not set?"
            )
        option = before if argument == "-" and before in _OUTPUTS else _CALLED_DASH.get(argument)
        if option is not None:
            raise click.UsageError(
                f"{option}: found -, expected a name; commands that can write to stdout do so without {option}"
            )


def _message_and_status(error: Exception) -> tuple[Sequence[str], int]:
    """Return the lines of the message of an error, and the exit status."""
    match error:
        case click.ClickException():
            text = io.StringIO()
            error.show(text)
            return text.getvalue().rstrip().split("\n"), error.exit_code
        case CadtofError():
            return (f"Error: {error}",), error.exit_status
        # an older numpy names the reason only in the cause
        case _ if isinstance(error, MemoryError) or _NO_ROOM in f"{error}\n{error.__cause__}":
            told = "Error: not enough memory; try fewer --jobs, or smaller inputs"
            for line in f"{error}\n{error.__cause__}".split("\n"):
                if _NO_ROOM in line:
                    told = f"Error: {line}: not enough memory (ulimit -v), or the disk is mounted noexec"
            return (told,), 1
        case OSError(filename=None):
            told = f"standard output: cannot be written: {error.strerror or error}"
            if error.errno is None:
                # raised by a library, as by matplotlib if no folder at all can be written into
                told = str(error)
            elif isinstance(error, FileNotFoundError):
                told = "the folder in which cadtof was started is gone; change to a folder that exists"
            elif error.errno in {errno.EMFILE, errno.ENFILE}:
                told = f"{error.strerror}: allow more open files (ulimit -n)"
            return (f"Error: {told}",), OutputError.exit_status
        case OSError():
            return (f"Error: {error.filename}: {error.strerror or error}",), 1
        case _:
            lacks = isinstance(error, ModuleNotFoundError)
            advice = "`pip check` lists what cadtof lacks." if lacks else "Run `cadtof --debug …` and report it."
            if "marshal data" in str(error):
                advice = f"{_CUT_OFF} Remove the folders __pycache__ where cadtof and its packages are installed"
            return (f"Error: unexpected {type(error).__name__}: {error}", advice), 1


def _flush_stderr() -> None:
    """Flush stderr. If it cannot take everything, such as on a full disk, forget the rest and keep the exit status."""
    try:
        sys.stderr.flush()
    except (OSError, ValueError):
        forget(sys.stderr)


def _terminate(number: int, _frame: FrameType | None) -> NoReturn:
    """Exit by SystemExit, as at any other end, so that workers stop and no half-written file stays."""
    sys.exit(128 + number)


def _raised_again(dropped: "sys.UnraisableHookArgs") -> None:
    """Raise once more what a signal raised while Python called a `__del__` or a callback: Python drops what these raise."""
    ending = dropped.exc_value
    if (
        not isinstance(ending, SystemExit | KeyboardInterrupt)
        or sys.is_finalizing()
        or not hasattr(signal, "setitimer")
    ):
        sys.__unraisablehook__(dropped)
        return

    def end(_number: int, _frame: FrameType | None) -> NoReturn:
        raise ending

    signal.signal(signal.SIGALRM, end)
    # a moment later, because Python drops what is raised here, too
    signal.setitimer(signal.ITIMER_REAL, RAISED_AGAIN_S)
