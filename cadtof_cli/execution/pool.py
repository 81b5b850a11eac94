"""Worker processes that are handed tasks one by one, so that one that is lost or hangs costs no task but its own."""

import pickle
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Generic, TypeVar, cast

from cadtof_cli.errors import WorkersError
from cadtof_cli.execution.finisher import LATER_AT_ONCE
from cadtof_cli.execution.outcome import Outcome, Work, WorkerDied
from cadtof_cli.execution.serve import Said, serve
from cadtof_cli.execution.workers import Workers, signals_held_back

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext

Task = TypeVar("Task")
Result = TypeVar("Result")

TASKS_PER_WORKER = 3 + LATER_AT_ONCE
"""Tasks in flight for each worker: one computed, one waiting so that no worker idles, some on their way to the disk, and one
finished and not yet reported."""

ATTEMPTS = 2
"""How often a task is tried whose worker is lost."""

AHEAD_BYTES = 16 * 2**10
"""A task up to this size goes to a busy worker ahead of time: the connection holds it, so handing it over makes nobody wait."""

FAREWELL_S = 2.0
"""How long a worker that has nothing to do, or was killed, is waited for."""


@dataclass(eq=False)
class _Job(Generic[Task, Result]):
    """A task, how often its worker was lost, whether only waiting is left of it, and what has come of it."""

    task: Task
    losses: int = 0
    computed: bool = False
    outcome: Outcome[Task, Result] | None = None
    error: BaseException | None = None

    @property
    def done(self) -> bool:
        return self.outcome is not None or self.error is not None


@dataclass(eq=False)
class _Worker(Generic[Task, Result]):
    """A process, our end of its connection, the jobs that it was given, and when we last heard of them."""

    process: BaseProcess
    connection: Connection
    jobs: deque[_Job[Task, Result]] = field(default_factory=deque)
    since: float = 0.0

    def at(self) -> _Job[Task, Result]:
        """Return the job that the process is at."""
        return next((job for job in self.jobs if not job.computed), self.jobs[0])


class _Pool(Generic[Task, Result]):
    """Workers, started as tasks come, and the jobs that wait for one."""

    def __init__(self, function: Work[Task, Result], workers: Workers) -> None:
        self._function, self._settings = function, workers
        # each makes processes in the same way; only this one is there on every system
        self._context = cast("SpawnContext", get_context(workers.start_method))
        # the workers hold one end of a pipe whose other end lives here: it closes even when this process is killed
        self._listening, self._held = self._context.Pipe(duplex=False)
        self._workers: list[_Worker[Task, Result]] = []
        self._waiting: deque[_Job[Task, Result]] = deque()
        self._ahead = False

    def add(self, job: _Job[Task, Result]) -> None:
        """Take one more job."""
        self._waiting.append(job)
        self._hand_out()

    def attend(self) -> None:
        """Wait until a worker has answered, was lost or has taken too long, and hand out what waits."""
        busy = {worker.connection: worker for worker in self._workers if worker.jobs}
        limit = self._settings.task_timeout_s
        left = None
        if limit is not None:
            left = max(0.0, min(worker.since for worker in busy.values()) + limit - time.monotonic())
        ready = set(wait(list(busy), left))
        for worker in (worker for connection, worker in busy.items() if connection in ready):
            self._receive(worker)
        if limit is not None:
            for worker in busy.values():
                late = worker.jobs and time.monotonic() >= worker.since + limit
                if late and not worker.connection.poll():
                    self._lose(worker, after_s=limit)
        self._hand_out()

    def dismiss(self) -> None:
        """Let the workers end, which have nothing left to do."""
        for worker in self._workers:
            try:
                worker.connection.send_bytes(b"")
            except OSError:
                continue
        for worker in self._workers:
            worker.process.join(FAREWELL_S)

    def close(self) -> None:
        """End every worker that is left, at once: even one that was stopped."""
        self._held.close()
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join(FAREWELL_S)
            worker.connection.close()
        self._listening.close()

    def _hand_out(self) -> None:
        while self._waiting:
            job, given = self._waiting[0], [job for worker in self._workers for job in worker.jobs]
            # one that lost its worker is tried again alone: memory may have been short
            if (job.losses and given) or any(other.losses for other in given):
                return
            worker = self._started_afresh() if job.losses else self._place()
            if worker is None:
                return
            self._waiting.popleft()
            self._give(worker, job)

    def _place(self) -> _Worker[Task, Result] | None:
        """Return who is to do the next job; None while all have enough to do."""
        idle = next((worker for worker in self._workers if not worker.jobs), None)
        if idle is not None:
            return idle
        if len(self._workers) < self._settings.processes:
            return self._start()
        ready = (worker for worker in self._workers if sum(not job.computed for job in worker.jobs) < 2)
        return next(ready, None) if self._ahead else None

    def _started_afresh(self) -> _Worker[Task, Result]:
        """Return a new process in place of an idle one, which may be dead as well without anybody having asked it since."""
        if len(self._workers) == self._settings.processes:
            self._end(self._workers[-1])
        return self._start()

    def _end(self, worker: _Worker[Task, Result]) -> None:
        worker.process.kill()
        worker.process.join(FAREWELL_S)
        worker.connection.close()
        self._workers.remove(worker)

    def _start(self) -> _Worker[Task, Result]:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=serve, args=(self._function, theirs, ours, self._listening, self._held), daemon=True
        )
        try:
            with signals_held_back():
                process.start()
        except OSError as error:
            raise WorkersError(f"no worker process can be started ({error.strerror}): try fewer --jobs") from error
        finally:
            theirs.close()
        worker = _Worker[Task, Result](process, ours)
        self._workers.append(worker)
        return worker

    def _give(self, worker: _Worker[Task, Result], job: _Job[Task, Result]) -> None:
        message = pickle.dumps(job.task, pickle.HIGHEST_PROTOCOL)
        self._ahead = len(message) <= AHEAD_BYTES
        if not worker.jobs:
            worker.since = time.monotonic()
        worker.jobs.append(job)
        try:
            worker.connection.send_bytes(message)
        except OSError:
            self._lose(worker)

    def _receive(self, worker: _Worker[Task, Result]) -> None:
        try:
            said, answer = worker.connection.recv()
        except (EOFError, OSError):
            self._lose(worker)
            return
        worker.since = time.monotonic()
        if said == Said.COMPUTED:
            worker.at().computed = True
            return
        job = worker.jobs.popleft()
        if said == Said.RESULT:
            job.outcome = Outcome(job.task, answer)
        else:
            job.error = answer

    def _lose(self, worker: _Worker[Task, Result], *, after_s: float | None = None) -> None:
        """Go on without a worker; all its jobs but the one that it was at are as good as new."""
        self._end(worker)
        # what waits for a disk that hangs keeps its place, while other tasks are computed behind it
        lost = worker.at() if after_s is None else worker.jobs[0]
        lost.losses += 1
        if lost.losses == ATTEMPTS:
            lost.outcome = Outcome(lost.task, WorkerDied(after_s))
        for job in worker.jobs:
            job.computed = False
        self._waiting.extendleft(job for job in reversed(worker.jobs) if not job.done)


def run_in_pool(
    function: Work[Task, Result], tasks: Iterable[Task], /, *, workers: Workers
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield the outcome of function(task) for every task, in the order of the tasks, from processes of their own."""
    waiting = iter(tasks)
    in_order: deque[_Job[Task, Result]] = deque()
    with _pool(function, workers) as pool:
        while True:
            while len(in_order) < workers.processes * TASKS_PER_WORKER:
                try:
                    in_order.append(_Job(next(waiting)))
                except StopIteration:
                    break
                pool.add(in_order[-1])
            if not in_order:
                return
            while not in_order[0].done:
                pool.attend()
            job = in_order.popleft()
            if job.error is not None:
                raise job.error
            assert job.outcome is not None
            yield job.outcome


@contextmanager
def _pool(function: Work[Task, Result], workers: Workers) -> Iterator[_Pool[Task, Result]]:
    pool = _Pool(function, workers)
    try:
        yield pool
        pool.dismiss()
    finally:
        pool.close()
