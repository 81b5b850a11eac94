"""Share simulation work among processes; what comes back is the same for any number of them."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from cadtof_cli.errors import CadtofError
from cadtof_cli.execution.ordered import WorkerDied, run_ordered
from cadtof_cli.execution.workers import default_start_method

Task = TypeVar("Task")
Result = TypeVar("Result")

Advance = Callable[[], None]
"""Called as each step of a run is done."""


def no_advance() -> None:
    """Tell nobody."""


def results(
    function: Callable[[Task], Result], tasks: Iterable[Task], /, *, jobs: int, advance: Advance
) -> Iterator[Result]:
    """Yield function(task) for every task, in order; raises CadtofError if a task's process ends without a result."""
    for outcome in run_ordered(function, tasks, jobs=jobs, start_method=default_start_method()):
        if isinstance(outcome.result, WorkerDied):
            raise CadtofError("a worker process ended without a result, twice; was it killed, or out of memory?")
        yield outcome.result
        advance()
