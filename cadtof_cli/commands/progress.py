"""A progress bar on stderr, where stderr is a terminal; nothing where it is not."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import click

REDRAW_SECONDS = 0.1
"""Drawing takes about a millisecond, frames come every few."""


class Bar(Protocol):
    """What a command tells of its progress."""

    def total(self, count: int) -> None:
        """There are `count` steps, as far as is known."""

    def advance(self) -> None:
        """One step is done."""

    def say(self, message: str) -> None:
        """Show a line above the bar."""


class _Plain:
    def total(self, count: int) -> None:
        pass

    def advance(self) -> None:
        pass

    def say(self, message: str) -> None:
        click.echo(message, err=True)


@contextmanager
def progress_bar(description: str, unit: str, *, quiet: bool) -> Iterator[Bar]:
    """Yield a bar that shows steps, steps a second and the time left; rich is imported only where it can be seen."""
    if quiet or not sys.stderr.isatty():
        yield _Plain()
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:.1f} {unit}/s", style="progress.data.speed")

    # Without a refresh thread: a process that has threads must not fork workers.
    progress = Progress(
        TextColumn(description),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        auto_refresh=False,
    )
    with progress:
        task = progress.add_task(description, total=None)

        class Rich:
            drawn = 0.0

            def total(self, count: int) -> None:
                progress.update(task, total=count)
                self._draw()

            def advance(self) -> None:
                progress.advance(task)
                self._draw()

            def _draw(self) -> None:
                now = time.monotonic()
                if now - self.drawn >= REDRAW_SECONDS:
                    self.drawn = now
                    progress.refresh()

            def say(self, message: str) -> None:
                progress.console.print(message, markup=False, highlight=False)

        yield Rich()
