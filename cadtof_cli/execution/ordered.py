"""Tasks → results in the order of the tasks, on one core or many, with a bounded number of tasks in flight."""

import os
import re
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import field
from pathlib import Path
from typing import Literal, TypeVar

from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.cores import available_cores
from cadtof_cli.execution.outcome import LATER_AT_ONCE, Later, Outcome, Work, WorkerDied, finishing
from cadtof_cli.records import dataclass

__all__ = ["Outcome", "WorkerDied", "Workers", "run_ordered"]

Task = TypeVar("Task")
Result = TypeVar("Result")

StartMethod = Literal["fork", "spawn", "forkserver"]

START_METHODS: tuple[StartMethod, ...] = ("fork", "spawn", "forkserver") if hasattr(os, "fork") else ("spawn",)
"""Those of this system."""

START_METHOD: StartMethod = "fork" if sys.platform == "linux" and hasattr(os, "fork") else "spawn"
"""The usual one: `fork` is safe before any thread runs, and starts in milliseconds."""

LOCAL = "local"

_SCHEDULER = r"tcp://[^\s/:]+:\d+|tcp://\[[0-9a-fA-F:]+\]:\d+"

LONGEST_S = 1e8
"""Years; the clocks of systems end somewhere beyond."""

JOBS_PER_CORE = 4
"""Users get no more processes than that a core: each takes memory, and none makes the work faster."""


@dataclass(frozen=True, kw_only=True)
class Workers:
    """What work is done by.

    Attributes:
        jobs: processes; 1 is this one alone.
        start_method: how other processes start.
        task_timeout_s: after how long a task's process is ended; None: it takes the time that it takes.
        scheduler: `local`, or the address of a dask scheduler whose workers do the work instead.
    """

    jobs: int = field(default_factory=available_cores)
    start_method: StartMethod = START_METHOD
    task_timeout_s: float | None = None
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise SettingsError(f"--jobs: found {self.jobs}, expected 1 or more")
        if self.start_method not in START_METHODS:
            raise SettingsError(
                f"--start-method: found {self.start_method}, which this system does not have; expected {', '.join(START_METHODS)}"
            )
        if self.task_timeout_s is not None and not 0 < self.task_timeout_s <= LONGEST_S:
            raise SettingsError(
                f"--frame-timeout: found {self.task_timeout_s:g}, expected seconds above 0, at most {LONGEST_S:g}"
            )
        if self.scheduler != LOCAL and not re.fullmatch(_SCHEDULER, self.scheduler):
            raise SettingsError(f"--scheduler: found {self.scheduler!r}, expected local or tcp://HOST:PORT")
        if self.scheduler != LOCAL and self.task_timeout_s is not None:
            raise SettingsError(
                "--frame-timeout holds for processes of this machine; leave out --scheduler, or the limit"
            )


ALONE = Workers(jobs=1)
"""This process."""


def run_ordered(
    function: Work[Task, Result],
    tasks: Iterable[Task],
    /,
    *,
    workers: Workers,
    shared: Sequence[object] = (),
    probe: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Generator[Outcome[Task, Result], None, None]:
    """Return a generator of the outcomes of function(task) for every task, in the order of the tasks.

    With one job everything runs in this process, unless tasks have a time limit, which only another process can keep. With more,
    or on a cluster, `function` must be importable from a module, and tasks and results must pickle; tasks are drawn from the
    iterable only as places come free, so memory does not grow with their number. A task whose process dies or takes too long is
    tried once more, alone; the others in flight are not lost. Exceptions of `function` are raised by the generator. Closing it,
    or an exception such as KeyboardInterrupt, abandons what is in flight.

    Args:
        function: what is done; of what returns a `Later`, the waiting is done while the next task is.
        tasks: what it is done to.
        workers: what it is done by.
        shared: what many tasks hold, such as a plan: another process is given these very objects once, not with every task.
        probe: a file that workers of a cluster must see, or they share no file system with this process.
        say: told of what a user should know of a cluster.

    Raises:
        SettingsError: no scheduler answers where `workers` says there is one.
        ClusterError: it has workers that would not do the same; or, from the generator, it is lost.
    """
    if workers.scheduler != LOCAL:
        from cadtof_cli.execution.cluster.ordered import run_on_cluster

        return run_on_cluster(function, tasks, scheduler=workers.scheduler, probe=probe, say=say)
    if workers.jobs > 1 or workers.task_timeout_s is not None:
        from cadtof_cli.execution.pool import run_in_pool

        return run_in_pool(function, tasks, workers=workers, shared=shared)
    return _run_here(function, tasks)


def _run_here(function: Work[Task, Result], tasks: Iterable[Task]) -> Generator[Outcome[Task, Result], None, None]:
    """Yield outcomes from this process alone."""
    with finishing() as finisher:
        begun: deque[tuple[Task, Later[Result]]] = deque()
        for task in tasks:
            begun.append((task, finisher.begin(function(task))))
            while begun and (begun[0][1].there or len(begun) > LATER_AT_ONCE):
                task, later = begun.popleft()
                yield Outcome(task, later.result())
        for task, later in begun:
            yield Outcome(task, later.result())
