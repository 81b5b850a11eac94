"""The output of a command: lines, and a progress bar on stderr if stderr is a terminal."""

import io
import os
import re
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

import click

from cadtof_cli.errors import OutputError
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

_CONTROL_CHARACTERS = "[\x00-\x08\x0a-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
"""Characters that are escaped: control characters except tab, separators of lines, characters that change the direction of
writing, and surrogates, which stand for bytes of file names that are not UTF-8."""


def _one_line(text: object) -> str:
    """Return a text as one line, in which characters that would control a terminal are escaped."""
    line = str(text)
    # the pattern takes time and memory, also after memory has run out
    return line if line.isprintable() else re.sub(_CONTROL_CHARACTERS, lambda found: repr(found.group())[1:-1], line)


def tell(*texts: object, err: bool = False, above: "RichProgress | None" = None) -> None:
    """Write texts to stdout, or to stderr with `err`, one line each. Characters that would control a terminal are escaped.

    If a bar is drawn on stderr, pass it as `above`: the line then stands above it. On a terminal, a line of stderr that is too
    long is broken between two words.

    Raises:
        OutputError: stdout cannot be written; errors of stderr are ignored.
        BrokenPipeError: the reader of stdout has gone away.
    """
    line = "\n".join(_wrapped(one) if err else one for one in map(_one_line, texts))
    if above is not None:
        above.console.print(line, markup=False, highlight=False, emoji=False, soft_wrap=True)
        return
    try:
        click.echo(line, err=err)
    except BrokenPipeError:
        if not err:
            raise
        forget(sys.stderr)
    except OSError as error:
        if not err:
            raise OutputError(f"standard output: cannot be written: {error.strerror}") from error
        forget(sys.stderr)


_NOTES = "cadtof_cli.notes"
"""Where the context of a command holds the notes that were told before its log is opened."""


def note(line: str, /) -> None:
    """Tell on stderr what became of an option, unless the command is quiet. Its log gets the line in any case."""
    context = click.get_current_context()
    context.meta.setdefault(_NOTES, []).append(line)
    # a shell that asks for completions shows them in the middle of the line that is typed
    if not (context.params.get("quiet") or context.resilient_parsing):
        tell(line, err=True)


def _wrapped(line: str) -> str:
    """Return a line of stderr, broken to the width of the terminal. A word, such as a path, stays whole: it can be copied."""
    try:
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        return line
    if not 0 < columns < len(line):
        return line
    import textwrap

    return textwrap.fill(
        line, columns, break_long_words=False, break_on_hyphens=False, expand_tabs=False, replace_whitespace=False
    )


def forget(stream: TextIO, /) -> None:
    """Discard what a stream could not take; Python would try to write it again at exit, and before it forks a process."""
    with suppress(OSError, ValueError):
        number = stream.fileno()
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, number)
        os.close(null)


def prepare_streams() -> None:
    r"""Replace closed stdin, stdout and stderr, so that no file that is opened later gets their descriptors.

    Writing to a stdout that was closed fails; a stderr that was closed ignores everything. Characters that the encoding
    of a stream lacks are written as their numbers, such as `\u03c3`.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdin = sys.stdin or os.fdopen(0, "r", encoding="utf-8", closefd=False)
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


REDRAW_SECONDS = 0.1
"""Shortest time between two drawings of the bar. A drawing takes about a millisecond; frames come every few milliseconds."""

_LEAST_BAR, _WIDEST_BAR = 8, 40
"""Least and largest width of the bar, in columns."""


class Log(io.FileIO):
    """A file to which lines are appended, each with the time."""

    def note(self, message: str, /) -> None:
        """Append a line; raises OutputError if the file cannot be written."""
        line = f"{datetime.now().astimezone().isoformat(timespec='seconds')} {_one_line(message)}\n"
        try:
            self.write(line.encode())
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be written: {error.strerror}") from error


@dataclass
class Bar:
    """The progress of a workflow: a bar, and lines on stderr above it.

    Attributes:
        quiet: show only those lines that are warnings.
        log: file to which all lines are appended; None: no log.
        drawn: the bar, which shows steps, steps per second and the time left; None: it is not drawn.
    """

    quiet: bool = False
    log: Log | None = None
    drawn: "RichProgress | None" = None
    _drawn_s: float = 0.0

    def advance(self, steps: int = 1, /, *, total: int | None = None) -> None:
        """Count steps that were done; `total` is the number of all steps that are known by now."""
        if self.drawn is None:
            return
        self.drawn.update(self.drawn.task_ids[0], advance=steps, total=total)
        now = time.monotonic()
        if now - self._drawn_s >= REDRAW_SECONDS:
            self._drawn_s = now
            self.drawn.refresh()

    def say(self, message: str, /, *, warning: bool = False) -> None:
        """Append a line to the log, and show it above the bar; if `quiet`, show it only if it is a warning."""
        if self.log:
            self.log.note(message)
        if warning or not self.quiet:
            tell(message, err=True, above=self.drawn)


class _Terminal:
    """The stream on which a bar is drawn. If its terminal goes away, the bar is lost and the command goes on."""

    def __init__(self, stream: TextIO, /) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; if that fails, forget it."""
        try:
            return self._stream.write(text)
        except OSError:
            forget(self._stream)
            return len(text)

    def flush(self) -> None:
        """Write what is buffered; if that fails, forget it."""
        try:
            self._stream.flush()
        except OSError:
            forget(self._stream)


_WITHOUT_CURSOR = ("dumb", "unknown", *([""] if os.name == "posix" else []))
"""Values of TERM for terminals that cannot move their cursor back, or may not, so that a bar cannot be redrawn."""


@contextmanager
def progress_bar(description: str, unit: str, *, quiet: bool = False, log: Path | None = None) -> Iterator[Bar]:
    """Yield a bar for the steps of a workflow; rich is imported only if the bar can be seen.

    The file `log` gets the command line, all lines (also those that `quiet` hides), and the error that ended the workflow;
    raises OutputError if it cannot be written.
    """
    try:
        opened = nullcontext() if log is None else Log(log, "a")
    except OSError as error:
        raise OutputError(f"{log}: cannot be written: {error.strerror}; choose another file with --log") from error
    with opened as file:
        try:
            seen = not quiet and sys.stderr.isatty() and os.environ.get("TERM", "") not in _WITHOUT_CURSOR
            with _drawn(description, unit) if seen else nullcontext() as drawn:
                if file:
                    import shlex

                    file.note(shlex.join(["cadtof", *sys.argv[1:]]))
                    for line in click.get_current_context().meta.get(_NOTES, ()):
                        file.note(line)
                yield Bar(quiet, file, drawn)
        except BaseException as error:
            if file:
                with suppress(OutputError):
                    file.note(f"ended by {type(error).__name__}: {error}")
            raise


@contextmanager
def _drawn(description: str, unit: str) -> Iterator["RichProgress"]:
    """Yield a bar of rich in one line, with one task."""
    from rich.console import Console
    from rich.measure import Measurement
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.table import Table
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            # at the end, the rate of all steps: if there are few, rich knows only the rate of the last moments
            speed = task.completed / task.finished_time if task.finished_time else task.speed
            return Text("" if speed is None else f"{speed:.1f} {unit}/s", style="progress.data.speed")

    title, bar, rate, left = TextColumn(description), BarColumn(), Rate(), TimeRemainingColumn()
    columns: tuple[ProgressColumn, ...] = (title, bar, MofNCompleteColumn(), rate, left)

    class OneLine(Progress):
        """Progress in one line. On a narrow terminal, columns that do not fit are left out, but never the count of steps."""

        def make_tasks_table(self, tasks: Iterable[Task]) -> Table:
            """Return the line."""
            for task in tasks:
                self.columns = self._fitting(task)
            return super().make_tasks_table(tasks)

        def _fitting(self, task: Task) -> tuple[ProgressColumn, ...]:
            width = {one: Measurement.get(self.console, self.console.options, one(task)).maximum for one in columns}
            shown = list(columns)
            for spare in (rate, bar, title, left):
                room = self.console.width - sum(width[one] + 1 for one in shown if one is not bar)
                if room >= (_LEAST_BAR if bar in shown else -1):
                    break
                shown.remove(spare)
            bar.bar_width = min(room, _WIDEST_BAR)
            return tuple(shown)

    class CursorStays(Console):
        def show_cursor(self, show: bool = True) -> bool:
            """Never hide the cursor: a process that is killed or stopped could not show it again."""
            return False

    # Without a refresh thread: a process that has threads must not fork workers.
    # rich believes these two whatever they say, and draws nothing in 0 columns
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {"COLUMNS", "LINES"} or re.fullmatch("[1-9][0-9]{0,3}", value)
    }
    console = CursorStays(file=cast("TextIO", _Terminal(sys.stderr)), _environ=environment)
    with OneLine(*columns, console=console, auto_refresh=False) as progress:
        progress.add_task(description, total=None)
        try:
            yield progress
        finally:
            # a bar that showed no step is removed from the terminal
            progress.live.transient = not any(task.completed for task in progress.tasks)
