"""Tasks → results in the order of the tasks, on one core or many, with a bounded number of tasks in flight."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path

from cadtof_cli.execution.outcome import LATER_AT_ONCE, Later, Outcome, Result, Task, Work, finishing, outcome_of
from cadtof_cli.execution.workers import LOCAL, Workers


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

    With one job everything runs in this process, unless tasks have a time limit, which only another process can enforce. With
    more jobs, or on a cluster, `function` must be importable from a module, and tasks and results must pickle. Tasks are drawn
    from the iterable only when places come free, so memory does not grow with their number. A task whose process dies or takes
    too long is tried once more, alone; the other tasks in flight are not lost. The generator raises the exceptions of `function`.
    Closing the generator, or an exception such as KeyboardInterrupt, abandons the tasks in flight.

    Args:
        function: what is done to a task; if it returns a `Later`, the waiting is done while the next task is computed.
        tasks: the tasks.
        workers: who does the work.
        shared: objects that many tasks hold, such as a plan: another process gets these very objects once, not with every task.
        probe: a file that the workers of a cluster must see; if they do not, they share no file system with this process.
        say: called with messages about the cluster that a user should see.

    Raises:
        SettingsError: no scheduler answers at the address in `workers`.
        ClusterError: the cluster has workers that would not give the same results; or, raised by the generator, it is lost.
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
                yield outcome_of(task, later.answer())
        for task, later in begun:
            yield outcome_of(task, later.answer())
