"""Worker processes that get their tasks one by one: a worker that is lost or hangs costs only its current task."""

import errno
import itertools
import math
import pickle
import time
from collections import deque
from collections.abc import Generator, Iterable, Sequence
from contextlib import suppress
from dataclasses import field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any, Generic, cast

from cadtof_cli.errors import WorkersError
from cadtof_cli.execution.messages import COMPUTED, NO_MORE, Incoming, TaskMessages
from cadtof_cli.execution.outcome import ATTEMPTS, LATER_AT_ONCE, Job, Outcome, Result, Task, Work, WorkerDied
from cadtof_cli.execution.serve import serve
from cadtof_cli.execution.starting import cores_for, current_folder_left_out, signals_held_back
from cadtof_cli.execution.workers import Workers
from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext

SHORT_S = 0.01
"""Mean time per task, in s, below which tasks count as short. Then each worker has more tasks ahead, and this process serves them
only now and then: each time it may displace a worker from its core, and the worker's data from the cache of that core."""

TASKS_IN_MEAN = 8
"""Length of the running mean of the time per task: a new time counts for 1/8."""

PAUSE_S, PAUSE_TASKS = 0.01, 4
"""Longest pause before workers with short tasks are served again: so many seconds, or the time of so many of their tasks,
whichever is shorter."""

AHEAD, SHORT_AHEAD = 2, 8
"""How many uncomputed tasks a worker has, so that it never idles: the usual number, and the most when tasks are short."""

TASKS_PER_WORKER = 1 + SHORT_AHEAD + LATER_AT_ONCE
"""Most tasks in flight per worker: some to be computed, some on their way to the disk, and one finished but not yet reported."""

AHEAD_BYTES = 16 * 2**10
"""Largest message with which a task goes to a busy worker ahead of time. The connection buffers a message of this size, so
sending it makes no process wait."""

JOIN_S = 2.0
"""Longest wait for the end of a worker process that has nothing left to do, or was killed."""


@dataclass(eq=False)
class _Worker(Generic[Task, Result]):
    """A worker process.

    Attributes:
        process: the process.
        connection: our end of the connection to it.
        core: the core that it stays on; None if the system may move it.
        jobs: the jobs that it was given and has not answered for, in order.
        computed: how many of the first jobs are computed and only wait, as for a disk.
        since: when its last message came, or when it was given a job while it had none.
        answered: when its last result or exception came; before the first one, when it was started.
    """

    process: BaseProcess
    connection: Connection
    core: int | None
    jobs: deque[Job[Task, Result]] = field(default_factory=deque)
    computed: int = 0
    since: float = 0.0
    answered: float = field(default_factory=time.monotonic)

    def current_job(self) -> Job[Task, Result]:
        """Return the job that the process is computing; if all jobs are computed, the first one, which is waited for."""
        return self.jobs[self.computed if self.uncomputed() else 0]

    def uncomputed(self) -> int:
        """Return how many of the jobs are not computed yet."""
        return len(self.jobs) - self.computed


class _Pool(Generic[Task, Result]):
    """Workers, which are started when tasks come, and the queue of jobs that wait for a worker."""

    def __init__(self, function: Work[Task, Result], workers: Workers, shared: Sequence[object]) -> None:
        self._function, self._messages = function, TaskMessages(shared)
        self._max_workers, self._limit_s = workers.jobs, workers.task_timeout_s
        self._cores = cores_for(self._max_workers)
        # the contexts of all start methods have the same methods; SpawnContext is the only type that every system has
        self._context = cast("SpawnContext", get_context(workers.start_method))
        # the workers listen at one end of a pipe; this process holds the other end, which closes even when the process is killed
        self._listening, self._held = self._context.Pipe(duplex=False)
        self._workers: list[_Worker[Task, Result]] = []
        self._incoming = Incoming[_Worker[Task, Result]]()
        self._waiting: deque[Job[Task, Result]] = deque()
        self._fits_ahead, self._task_s = False, SHORT_S

    def add(self, job: Job[Task, Result]) -> None:
        """Take one more job."""
        self._waiting.append(job)
        self._hand_out()

    def attend(self) -> None:
        """Wait until a worker answers, is lost or exceeds the time limit; then hand out waiting jobs."""
        if self._task_s < SHORT_S:
            # no pause if a worker has nothing left to compute, as at the end
            fewest = min(map(_Worker.uncomputed, self._workers), default=0)
            time.sleep(min(PAUSE_S, min(fewest, PAUSE_TASKS) * self._task_s))
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
        """Tell the workers to end, because nothing is left to do, and wait for their end."""
        for worker in self._workers:
            with suppress(OSError):
                worker.connection.send_bytes(NO_MORE)
        for worker in self._workers:
            worker.process.join(JOIN_S)

    def close(self) -> None:
        """Kill every worker that is left, at once. This ends even a worker that is stopped (SIGSTOP)."""
        self._held.close()
        self._incoming.close()
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join(JOIN_S)
            worker.connection.close()
        self._listening.close()

    def _hand_out(self) -> None:
        while self._waiting:
            job = self._waiting[0]
            # a job that lost its worker is tried again while no other job runs: memory may have been short
            if any(worker.jobs and (job.losses or worker.jobs[0].losses) for worker in self._workers):
                return
            worker = self._start_fresh() if job.losses else self._place()
            if worker is None:
                return
            self._waiting.popleft()
            self._give(worker, job)

    def _place(self) -> _Worker[Task, Result] | None:
        """Return the worker for the next job; None if all workers have enough to do."""
        idle = next((worker for worker in self._workers if not worker.jobs), None)
        if idle is not None:
            return idle
        if len(self._workers) < self._max_workers:
            return self._start()
        least = min(self._workers, key=_Worker.uncomputed)
        return least if self._fits_ahead and least.uncomputed() < self._tasks_ahead() else None

    def _tasks_ahead(self) -> int:
        """Return how many uncomputed tasks a worker should have: just enough, because no other worker can take them from it."""
        if self._task_s >= SHORT_S:
            return AHEAD
        # twice as many as are done during a pause: this process may come late
        return min(AHEAD + math.ceil(2.0 * PAUSE_S / max(self._task_s, 1e-4)), SHORT_AHEAD)

    def _start_fresh(self) -> _Worker[Task, Result]:
        """Return a new worker after the end of all others, which are idle or dead, and may hold memory that it needs."""
        for worker in tuple(self._workers):
            self._end(worker)
        return self._start()

    def _end(self, worker: _Worker[Task, Result]) -> None:
        worker.process.kill()
        worker.process.join(JOIN_S)
        self._incoming.remove(worker.connection)
        worker.connection.close()
        self._workers.remove(worker)

    def _start(self) -> _Worker[Task, Result]:
        ours, theirs = self._context.Pipe()
        taken = {worker.core for worker in self._workers}
        core = next((core for core in self._cores if core not in taken), None)
        forked = self._context.get_start_method() == "fork"
        messages = self._messages if forked else None
        arguments = (self._function, messages, theirs, ours, self._listening, self._held, core)
        process = self._context.Process(target=serve, args=arguments, daemon=True)
        try:
            with current_folder_left_out(), signals_held_back(self._context.get_start_method()):
                process.start()
        except (OSError, EOFError) as error:
            # EOFError: the fork server has ended
            why = (isinstance(error, OSError) and error.strerror) or error
            too_many_files = isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}
            cure = "allow more open files (ulimit -n)" if too_many_files else "try fewer --jobs"
            if "AF_UNIX" in str(why):
                # the fork server has a socket in the temporary folder
                cure = "set TMPDIR to a folder with a shorter path"
            raise WorkersError(f"no worker process can be started ({why}): {cure}") from error
        finally:
            theirs.close()
        if not forked:
            # among the arguments, they could fill a pipe of which this process holds both ends until the worker has read it: if
            # the worker died at once, the wait would never end
            with suppress(OSError):
                ours.send_bytes(pickle.dumps(self._messages, pickle.HIGHEST_PROTOCOL))
        worker = _Worker[Task, Result](process, ours, core)
        self._workers.append(worker)
        self._incoming.add(ours, worker)
        return worker

    def _give(self, worker: _Worker[Task, Result], job: Job[Task, Result]) -> None:
        message = self._messages.message(job.task)
        self._fits_ahead = len(message) <= AHEAD_BYTES
        if not worker.jobs:
            worker.since = time.monotonic()
        worker.jobs.append(job)
        try:
            worker.connection.send_bytes(message)
        except OSError:
            self._lose(worker)

    def _receive(self, worker: _Worker[Task, Result]) -> None:
        try:
            message = worker.connection.recv_bytes()
            answer: Any = None if message == COMPUTED else pickle.loads(message)
        except (EOFError, OSError):
            self._lose(worker)
            return
        worker.since = time.monotonic()
        if message == COMPUTED:
            worker.computed += 1
            return
        self._task_s += (worker.since - worker.answered - self._task_s) / TASKS_IN_MEAN
        worker.answered = worker.since
        worker.jobs.popleft().end(answer)
        worker.computed = max(worker.computed - 1, 0)

    def _lose(self, worker: _Worker[Task, Result], *, after_s: float | None = None) -> None:
        """Go on without a worker: one of its jobs counts a loss, the others wait again; `after_s`: the limit that it exceeded."""
        self._end(worker)
        if not worker.jobs:
            return
        # a job that waits for a hanging disk stays the first, while the jobs behind it are computed
        lost = worker.current_job() if after_s is None else worker.jobs[0]
        lost.losses += 1
        if lost.losses == ATTEMPTS:
            lost.end(WorkerDied(after_s))
        self._waiting.extendleft(job for job in reversed(worker.jobs) if not job.ended)


def run_in_pool(
    function: Work[Task, Result], tasks: Iterable[Task], /, *, workers: Workers, shared: Sequence[object] = ()
) -> Generator[Outcome[Task, Result], None, None]:
    """Yield the outcome of function(task) for every task, in order; raise what the function raised in a worker process."""
    waiting, most = iter(tasks), workers.jobs * TASKS_PER_WORKER
    in_order: deque[Job[Task, Result]] = deque()
    pool = _Pool(function, workers, shared)
    try:
        while True:
            for task in itertools.islice(waiting, most - len(in_order)):
                in_order.append(Job(task))
                pool.add(in_order[-1])
            if not in_order:
                pool.dismiss()
                return
            while not in_order[0].ended:
                pool.attend()
            yield in_order.popleft().outcome()
    finally:
        pool.close()
