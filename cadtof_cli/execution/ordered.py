"""Tasks → results in the order of the tasks, on one core or many, with a bounded number of tasks in flight."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Generic, TypeVar

from cadtof_cli.execution.workers import StartMethod, worker_pool

Task = TypeVar("Task")
Result = TypeVar("Result")

TASKS_PER_WORKER = 3
"""Tasks in flight for each worker: one computed, one waiting so that no worker idles, one finished and not yet reported."""


@dataclass(frozen=True)
class WorkerDied:
    """What takes the place of a result where a task's process ended without giving one (killed, or out of memory)."""


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """A task with what its function returned."""

    task: Task
    result: Result | WorkerDied


def run_ordered(
    function: Callable[[Task], Result], tasks: Iterable[Task], /, *, jobs: int, start_method: StartMethod
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield the outcome of function(task) for every task, in the order of the tasks.

    With one job everything runs in this process. With more, `function` must be importable from a module, and tasks and
    results must pickle; tasks are drawn from the iterable only as places come free, so memory does not grow with their
    number. A task whose process dies is tried once more, alone; the others in flight are not lost. Exceptions of `function`
    are raised here. Closing the iterator, or an exception such as KeyboardInterrupt, abandons what is in flight.
    """
    if jobs == 1:
        for task in tasks:
            yield Outcome(task, function(task))
        return
    waiting = iter(tasks)
    unfinished: deque[Task] = deque()
    while True:
        yield from _until_broken(function, waiting, unfinished, jobs, start_method)
        if not unfinished:
            return
        while unfinished:
            yield Outcome(unfinished[0], _alone(function, unfinished[0], start_method))
            unfinished.popleft()


def _until_broken(
    function: Callable[[Task], Result],
    waiting: Iterator[Task],
    unfinished: deque[Task],
    jobs: int,
    start_method: StartMethod,
) -> Iterator[Outcome[Task, Result]]:
    """Run tasks until there are no more, or a worker dies: then `unfinished` holds the ones without a result, in order."""
    futures: deque[Future[Result]] = deque()
    with worker_pool(jobs, start_method) as pool:
        try:
            while True:
                while len(futures) < jobs * TASKS_PER_WORKER:
                    task = next(waiting, None)
                    if task is None:
                        break
                    unfinished.append(task)
                    futures.append(pool.submit(function, task))
                if not futures:
                    return
                result = futures[0].result()
                futures.popleft()
                yield Outcome(unfinished.popleft(), result)
        except BrokenProcessPool:
            return


def _alone(function: Callable[[Task], Result], task: Task, start_method: StartMethod) -> Result | WorkerDied:
    with worker_pool(1, start_method) as pool:
        try:
            return pool.submit(function, task).result()
        except BrokenProcessPool:
            return WorkerDied()
