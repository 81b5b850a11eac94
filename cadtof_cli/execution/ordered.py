"""Tasks → results in the order of the tasks, on one core or many, with a bounded number of tasks in flight."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from cadtof_cli.execution.workers import LOCAL, Workers, signals_held_back, worker_pool

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
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    /,
    *,
    workers: Workers,
    probe: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Generator[Outcome[Task, Result], None, None]:
    """Return a generator of the outcomes of function(task) for every task, in the order of the tasks.

    With one job everything runs in this process. With more, or on a cluster, `function` must be importable from a module, and
    tasks and results must pickle; tasks are drawn from the iterable only as places come free, so memory does not grow with
    their number. A task whose process dies is tried once more, alone; the others in flight are not lost. Exceptions of
    `function` are raised by the generator. Closing it, or an exception such as KeyboardInterrupt, abandons what is in flight.

    Args:
        function: what is done.
        tasks: what it is done to.
        workers: what it is done by.
        probe: a file that workers of a cluster must see, or they share no file system with this process.
        say: told of what a user should know of a cluster.

    Raises:
        SettingsError: no scheduler answers where `workers` says there is one.
        ClusterError: it has workers that would not do the same; or, from the generator, it is lost.
    """
    if workers.scheduler == LOCAL:
        return _run_here(function, tasks, workers)
    from cadtof_cli.execution.cluster.ordered import run_on_cluster

    return run_on_cluster(function, tasks, scheduler=workers.scheduler, probe=probe, say=say)


def _run_here(
    function: Callable[[Task], Result], tasks: Iterable[Task], workers: Workers
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield outcomes from this process alone, or from a pool of processes."""
    if workers.jobs == 1:
        for task in tasks:
            yield Outcome(task, function(task))
        return
    waiting = iter(tasks)
    in_flight: deque[tuple[Task, Future[Result]]] = deque()
    while True:
        yield from _until_broken(function, waiting, in_flight, workers)
        if not in_flight:
            return
        while in_flight:
            task, future = in_flight.popleft()
            try:
                result: Result | WorkerDied = future.result()
            except BrokenProcessPool:
                result = _alone(function, task, workers)
            yield Outcome(task, result)


def _until_broken(
    function: Callable[[Task], Result],
    waiting: Iterator[Task],
    in_flight: deque[tuple[Task, Future[Result]]],
    workers: Workers,
) -> Iterator[Outcome[Task, Result]]:
    """Run tasks until there are no more, or a worker dies: then `in_flight` holds those not yet reported, in order.

    Some of those may have finished before the worker died; the futures know.
    """
    with worker_pool(workers) as pool:
        while True:
            while len(in_flight) < workers.jobs * TASKS_PER_WORKER:
                task = next(waiting, None)
                if task is None:
                    break
                in_flight.append((task, _submitted(pool, function, task)))
            if not in_flight:
                return
            task, future = in_flight[0]
            try:
                result = future.result()
            except BrokenProcessPool:
                return
            in_flight.popleft()
            yield Outcome(task, result)


def _submitted(pool: ProcessPoolExecutor, function: Callable[[Task], Result], task: Task) -> Future[Result]:
    """Hand a task to the pool; a pool that is broken gives a future that says so."""
    try:
        with signals_held_back():
            return pool.submit(function, task)
    except BrokenProcessPool as broken:
        future: Future[Result] = Future()
        future.set_exception(broken)
        return future


def _alone(function: Callable[[Task], Result], task: Task, workers: Workers) -> Result | WorkerDied:
    with worker_pool(workers.at_most(1)) as pool:
        try:
            return _submitted(pool, function, task).result()
        except BrokenProcessPool:
            return WorkerDied()
