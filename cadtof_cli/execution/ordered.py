"""Tasks → results in the order of the tasks, on one core or many, with a bounded number of tasks in flight."""

from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

from cadtof_cli.execution.outcome import Outcome, WorkerDied
from cadtof_cli.execution.pool import TASKS_PER_WORKER, run_in_pool
from cadtof_cli.execution.workers import Workers

__all__ = ["TASKS_PER_WORKER", "Outcome", "WorkerDied", "run_ordered"]

Task = TypeVar("Task")
Result = TypeVar("Result")


def run_ordered(
    function: Callable[[Task], Result], tasks: Iterable[Task], /, *, workers: Workers
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield the outcome of function(task) for every task, in the order of the tasks.

    With one job everything runs in this process, unless tasks have a time limit, which only another process can keep. With
    more, `function` must be importable from a module, and tasks and results must pickle; tasks are drawn from the iterable
    only as places come free, so memory does not grow with their number. A task whose process dies or takes too long is tried
    once more, alone; the others in flight are not lost. Exceptions of `function` are raised here. Closing the iterator, or
    an exception such as KeyboardInterrupt, abandons what is in flight.
    """
    if workers.jobs == 1 and workers.task_timeout_s is None:
        for task in tasks:
            yield Outcome(task, function(task))
        return
    yield from run_in_pool(function, tasks, workers=workers)
