"""The progress of a workflow, which a command shows and a caller in Python may ignore; and tasks done with progress."""

from collections.abc import Callable, Generator, Sequence
from typing import Protocol, TypeVar

from cadtof_cli.errors import CadtofError
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import WorkerDied
from cadtof_cli.execution.workers import Workers

Task = TypeVar("Task")
Result = TypeVar("Result")


class Progress(Protocol):
    """Receives the progress and the messages of a workflow."""

    def advance(self, steps: int = 1, /, *, total: int | None = None) -> None:
        """Count some more steps as done; `total`, if given, is the number of all steps as far as it is known."""

    def say(self, message: str, /) -> None:
        """Tell the user something."""


class _NoProgress:
    """Progress that nobody receives."""

    def advance(self, steps: int = 1, /, *, total: int | None = None) -> None:
        """Do nothing."""

    def say(self, message: str, /) -> None:
        """Do nothing."""


NO_PROGRESS: Progress = _NoProgress()


def results(
    function: Callable[[Task], Result], tasks: Sequence[Task], /, *, workers: Workers, progress: Progress
) -> Generator[Result, None, None]:
    """Yield function(task) for every task, in order, by no more processes than tasks.

    Raise CadtofError if the process of a task ended without a result, twice.
    """
    for outcome in run_ordered(function, tasks, workers=workers.at_most(len(tasks))):
        if isinstance(outcome.result, WorkerDied):
            raise CadtofError("a worker process ended without a result, twice; was it killed, or out of memory?")
        progress.advance()
        yield outcome.result
