"""Worker processes that are handed tasks one by one, so that one that is lost or hangs costs no task but its own."""

import math
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Generic, TypeVar, cast

from cadtof_cli.errors import WorkersError
from cadtof_cli.execution.messages import Incoming, Said, TaskMessages, answer_of
from cadtof_cli.execution.outcome import LATER_AT_ONCE, Outcome, Work, WorkerDied
from cadtof_cli.execution.serve import serve
from cadtof_cli.execution.starting import cores_for, current_folder_left_out, signals_held_back
from cadtof_cli.execution.workers import Workers
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext

Task = TypeVar("Task")
Result = TypeVar("Result")

SHORT_S = 0.01
"""Where a worker takes less than this for a task, in the mean of some tasks, it is looked after now and then, and has more ahead.

Each time that this process runs, it may take the place of a worker, and the cache of a core with it.
"""

TASKS_IN_MEAN = 8

NOW_AND_THEN_S, NOW_AND_THEN_TASKS = 0.01, 4
"""After how long workers with short tasks are looked after again, or after how many of their tasks, if that is sooner."""

AHEAD, SHORT_AHEAD = 2, 8
"""Tasks that a worker is given that are still to be computed, so that it never idles; and at most where they are short."""

TASKS_PER_WORKER = 1 + SHORT_AHEAD + LATER_AT_ONCE
"""Tasks in flight for each worker: some to be computed, some on their way to the disk, and one finished and not yet reported."""

ATTEMPTS = 2
"""How often a task is tried whose worker is lost."""

AHEAD_BYTES = 16 * 2**10
"""A task up to this size goes to a busy worker ahead of time: the connection holds it, so handing it over makes nobody wait."""

FAREWELL_S = 2.0
"""How long a worker that has nothing to do, or was killed, is waited for."""


@dataclass(eq=False)
class _Job(Generic[Task, Result]):
    """A task, how often its worker was lost, and what has come of it."""

    task: Task
    losses: int = 0
    outcome: Outcome[Task, Result] | None = None
    error: BaseException | None = None

    @property
    def done(self) -> bool:
        return self.outcome is not None or self.error is not None


@dataclass(eq=False)
class _Worker(Generic[Task, Result]):
    """A process, our end of its connection, the core that it stays on, the jobs that it was given, when we last heard of them,
    and when one was done.

    Of the first of the jobs, as many as are `computed`, only waiting is left.
    """

    process: BaseProcess
    connection: Connection
    core: int | None
    jobs: deque[_Job[Task, Result]] = field(default_factory=deque)
    computed: int = 0
    since: float = 0.0
    answered: float = field(default_factory=time.monotonic)

    def at(self) -> _Job[Task, Result]:
        """Return the job that the process is at."""
        return self.jobs[self.computed if self.left() else 0]

    def left(self) -> int:
        """Return how many of the jobs are still to be computed."""
        return len(self.jobs) - self.computed


class _Pool(Generic[Task, Result]):
    """Workers, started as tasks come, and the jobs that wait for one."""

    def __init__(self, function: Work[Task, Result], workers: Workers, shared: Sequence[object]) -> None:
        self._function, self._messages = function, TaskMessages(shared)
        self._most, self._limit_s = workers.jobs, workers.task_timeout_s
        self._cores = cores_for(self._most)
        # each makes processes in the same way; only this one is there on every system
        self._context = cast("SpawnContext", get_context(workers.start_method))
        # the workers hold one end of a pipe whose other end lives here: it closes even when this process is killed
        self._listening, self._held = self._context.Pipe(duplex=False)
        self._workers: list[_Worker[Task, Result]] = []
        self._incoming = Incoming[_Worker[Task, Result]]()
        self._waiting: deque[_Job[Task, Result]] = deque()
        self._ahead, self._task_s = False, SHORT_S

    def add(self, job: _Job[Task, Result]) -> None:
        """Take one more job."""
        self._waiting.append(job)
        self._hand_out()

    def attend(self) -> None:
        """Wait until a worker has answered, was lost or has taken too long, and hand out what waits."""
        if self._task_s < SHORT_S:
            # who has nothing left to compute, as at the end, is waited for
            left = min(map(_Worker.left, self._workers), default=0)
            time.sleep(min(NOW_AND_THEN_S, min(left, NOW_AND_THEN_TASKS) * self._task_s))
        limit, left_s = self._limit_s, None
        if limit is not None:
            since = min(worker.since for worker in self._workers if worker.jobs)
            left_s = max(0.0, since + limit - time.monotonic())
        while ready := self._incoming.ready(left_s):
            for worker in ready:
                self._receive(worker)
            left_s = 0.0
        if limit is not None:
            for worker in tuple(self._workers):
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
        self._incoming.close()
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join(FAREWELL_S)
            worker.connection.close()
        self._listening.close()

    def _hand_out(self) -> None:
        while self._waiting:
            job = self._waiting[0]
            # one that lost its worker is tried again alone: memory may have been short
            if any(worker.jobs and (job.losses or worker.jobs[0].losses) for worker in self._workers):
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
        if len(self._workers) < self._most:
            return self._start()
        least = min(self._workers, key=_Worker.left)
        return least if self._ahead and least.left() < self._enough() else None

    def _enough(self) -> int:
        """Return how many tasks a worker should have ahead: no more than it takes, since what it has no other can take."""
        if self._task_s >= SHORT_S:
            return AHEAD
        # as many again as are done meanwhile: this process may come late
        return min(AHEAD + math.ceil(2.0 * NOW_AND_THEN_S / max(self._task_s, 1e-4)), SHORT_AHEAD)

    def _started_afresh(self) -> _Worker[Task, Result]:
        """Return a new process in place of an idle one, which may be dead as well without anybody having asked it since."""
        if len(self._workers) == self._most:
            self._end(self._workers[-1])
        return self._start()

    def _end(self, worker: _Worker[Task, Result]) -> None:
        worker.process.kill()
        worker.process.join(FAREWELL_S)
        self._incoming.remove(worker.connection)
        worker.connection.close()
        self._workers.remove(worker)

    def _start(self) -> _Worker[Task, Result]:
        ours, theirs = self._context.Pipe()
        taken = {worker.core for worker in self._workers}
        core = next((core for core in self._cores if core not in taken), None)
        process = self._context.Process(
            target=serve,
            args=(self._function, self._messages, theirs, ours, self._listening, self._held, core),
            daemon=True,
        )
        try:
            with signals_held_back(), current_folder_left_out():
                process.start()
        except (OSError, EOFError) as error:
            # EOFError: what forks workers has ended
            why = error.strerror if isinstance(error, OSError) else error
            raise WorkersError(f"no worker process can be started ({why}): try fewer --jobs") from error
        finally:
            theirs.close()
        worker = _Worker[Task, Result](process, ours, core)
        self._workers.append(worker)
        self._incoming.add(ours, worker)
        return worker

    def _give(self, worker: _Worker[Task, Result], job: _Job[Task, Result]) -> None:
        message = self._messages.message(job.task)
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
            said, answer = answer_of(worker.connection.recv_bytes())
        except (EOFError, OSError):
            self._lose(worker)
            return
        worker.since = time.monotonic()
        if said == Said.COMPUTED:
            worker.computed += 1
            return
        self._task_s += (worker.since - worker.answered - self._task_s) / TASKS_IN_MEAN
        worker.answered = worker.since
        job = worker.jobs.popleft()
        worker.computed = max(worker.computed - 1, 0)
        if said == Said.RESULT:
            job.outcome = Outcome(job.task, answer)
        else:
            job.error = answer

    def _lose(self, worker: _Worker[Task, Result], *, after_s: float | None = None) -> None:
        """Go on without a worker; all its jobs but the one that it was at are as good as new."""
        self._end(worker)
        if not worker.jobs:
            return
        # what waits for a disk that hangs keeps its place, while other tasks are computed behind it
        lost = worker.at() if after_s is None else worker.jobs[0]
        lost.losses += 1
        if lost.losses == ATTEMPTS:
            lost.outcome = Outcome(lost.task, WorkerDied(after_s))
        self._waiting.extendleft(job for job in reversed(worker.jobs) if not job.done)


def run_in_pool(
    function: Work[Task, Result], tasks: Iterable[Task], /, *, workers: Workers, shared: Sequence[object] = ()
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield the outcome of function(task) for every task, in the order of the tasks, from processes of their own.

    Raises:
        BaseException: what the function raised.
    """
    waiting, most = iter(tasks), workers.jobs * TASKS_PER_WORKER
    in_order: deque[_Job[Task, Result]] = deque()
    with _pool(function, workers, shared) as pool:
        while True:
            while len(in_order) < most:
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
def _pool(function: Work[Task, Result], workers: Workers, shared: Sequence[object]) -> Iterator[_Pool[Task, Result]]:
    pool = _Pool(function, workers, shared)
    try:
        yield pool
        pool.dismiss()
    finally:
        pool.close()
