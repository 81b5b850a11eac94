"""Share simulation work among processes; what comes back is the same for any number of them."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from cadtof_cli.errors import CadtofError
from cadtof_cli.execution.ordered import WorkerDied, run_ordered
from cadtof_cli.execution.workers import Workers
from cadtof_cli.workflows.progress import Progress

Task = TypeVar("Task")
Result = TypeVar("Result")


def results(
    function: Callable[[Task], Result], tasks: Iterable[Task], /, *, workers: Workers, progress: Progress
) -> Iterator[Result]:
    """Yield function(task) for every task, in order; raises CadtofError if a task's process ends without a result."""
    for outcome in run_ordered(function, tasks, workers=workers):
        if isinstance(outcome.result, WorkerDied):
            raise CadtofError("a worker process ended without a result, twice; was it killed, or out of memory?")
        progress.advance()
        yield outcome.result
