"""Tasks → outcomes in the order of the tasks, on workers that come and go."""

import itertools
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic

from cadtof_cli.errors import ClusterError
from cadtof_cli.execution.cluster.connection import Connection, Finished, WorkerJoined, WorkerLost
from cadtof_cli.execution.cluster.worker import BatchResult, Surroundings, run_batch, surroundings
from cadtof_cli.execution.outcome import ATTEMPTS, Job, Outcome, Raised, Result, Task, Work, WorkerDied

SHORT_S = 0.05
"""Tasks that take less time than this are sent in batches."""

BATCH_S = 0.25
"""How long a batch should take. To send one task and get its result costs some ten milliseconds of work in four processes."""

MOST_IN_BATCH = 100

BATCHES_PER_WORKER = 3
"""The worker computes one batch. The others wait at the worker, so that it does not idle even if messages to it are slow."""

TASKS_AHEAD = 10_000
"""How many tasks may be drawn before the first of them is reported. The other tasks go on while one task is slow, or while its
worker is silent for minutes. Results are small."""

ANSWER_S = 10
"""How long a run waits for the first answers of all workers that are there. A worker that is frozen, or that is paused because
of its memory, is there but does not answer."""


@dataclass
class Worker(Generic[Task, Result]):
    """A worker that is fit for the run, and the batches of tasks that it has, by their number of work."""

    name: str
    batches: dict[int, list[Job[Task, Result]]] = field(default_factory=dict)


def run_on_cluster(
    function: Work[Task, Result],
    tasks: Iterable[Task],
    /,
    *,
    scheduler: str,
    probe: Path | None,
    say: Callable[[str], None],
) -> Generator[Outcome[Task, Result], None, None]:
    """Connect, check that the workers fit, and return a generator of outcomes in order; for errors see `run_ordered`."""
    connection = Connection(scheduler)
    for note in connection.notes:
        say(f"warning: {note}")
    run = ClusterRun(connection, function, iter(tasks), surroundings(Path.cwd(), probe), probe, say)
    try:
        run.welcome_workers()
    except BaseException:
        connection.close()
        raise
    return run.outcomes()


class ClusterRun(Generic[Task, Result]):
    """One run of tasks on a cluster.

    When a worker is lost, its batches are lost too. Nobody knows which of their tasks killed the worker, or whether any task did.
    So each of these tasks is a suspect: it is tried once more, on a worker that has no other task. A suspect that loses this
    worker too has killed twice, and fails.
    """

    def __init__(
        self,
        cluster: Connection,
        function: Work[Task, Result],
        tasks: Iterator[Task],
        expected: Surroundings,
        probe: Path | None,
        say: Callable[[str], None],
    ) -> None:
        self._cluster, self._function, self._tasks, self._say = cluster, function, tasks, say
        self._expected, self._probe, self._folder = expected, probe, Path.cwd()
        self._numbers = itertools.count()
        self._task_times_s: deque[float] = deque(maxlen=15)
        self._unreported: deque[Job[Task, Result]] = deque()
        self._queued: deque[Job[Task, Result]] = deque()
        self._suspects: deque[Job[Task, Result]] = deque()
        self._asked: dict[int, str] = {}
        self._unfit: list[str] = []
        self._workers: dict[str, Worker[Task, Result]] = {}
        self._with_room: dict[str, Worker[Task, Result]] = {}
        self._worker_of: dict[int, Worker[Task, Result]] = {}
        self._told_to_wait = False

    def welcome_workers(self) -> None:
        """Ask all workers that are there for their surroundings, and wait for the answers, `ANSWER_S` at most.

        Raise ClusterError, which names them, if some workers would not give the same results.
        """
        until = time.monotonic() + ANSWER_S
        self._take_news()
        while self._asked and time.monotonic() < until:
            self._take_news()
        if self._unfit:
            raise ClusterError("; ".join(sorted(self._unfit)))
        for worker in self._asked.values():
            self._say(f"warning: worker {worker} has not answered for {ANSWER_S} s: it gets no frames until it does")

    def outcomes(self) -> Generator[Outcome[Task, Result], None, None]:
        """Yield the outcome of every task, in order; exceptions of the function are raised here."""
        try:
            while True:
                while self._unreported and self._unreported[0].ended:
                    yield self._unreported.popleft().outcome()
                if not self._unreported and not self._draw():
                    return
                self._hand_out()
                self._tell()
                self._take_news()
        finally:
            self._cluster.close()

    def _draw(self) -> bool:
        """Draw one more task if there is one, and return whether there was."""
        for task in itertools.islice(self._tasks, 1):
            job: Job[Task, Result] = Job(task)
            self._unreported.append(job)
            self._queued.append(job)
            return True
        return False

    def _hand_out(self) -> None:
        """Give batches to the workers that have room: one to each worker, then another one to each, and so on."""
        kept: dict[str, Worker[Task, Result]] = {}
        while self._with_room:
            name = next(iter(self._with_room))
            worker = self._with_room.pop(name)
            batch = self._next_batch(worker)
            if not batch:
                kept[name] = worker
                if not self._suspects:
                    break
                continue
            work = next(self._numbers)
            worker.batches[work], self._worker_of[work] = batch, worker
            tasks = [job.task for job in batch]
            self._cluster.submit(work, name, run_batch, self._function, tasks, self._folder)
            if not batch[0].losses and len(worker.batches) < BATCHES_PER_WORKER:
                self._with_room[name] = worker
        self._with_room |= kept

    def _next_batch(self, worker: Worker[Task, Result]) -> list[Job[Task, Result]]:
        """Return a batch for a worker, or an empty list. As long as there are suspects, only an idle worker gets one."""
        if self._suspects:
            return [] if worker.batches else [self._suspects.popleft()]
        # the lower quartile: on a busy machine, slower tasks are slow for reasons that larger batches do not mend
        usual = statistics.quantiles(self._task_times_s)[0] if len(self._task_times_s) > 1 else SHORT_S
        size = 1 if usual >= SHORT_S else min(math.ceil(BATCH_S / max(usual, 1e-9)), MOST_IN_BATCH)
        while len(self._queued) < size and len(self._unreported) < TASKS_AHEAD and self._draw():
            pass
        return [self._queued.popleft() for _ in range(min(size, len(self._queued)))]

    def _take_news(self) -> None:
        for news in self._cluster.news():
            match news:
                case WorkerJoined(worker):
                    work = next(self._numbers)
                    self._asked[work] = worker
                    self._cluster.submit(work, worker, surroundings, self._folder, self._probe)
                case WorkerLost(worker, expected):
                    self._worker_lost(worker, expected=expected)
                case Finished(work, answer) if work in self._asked:
                    self._answered(self._asked.pop(work), answer)
                case Finished(work, answer) if work in self._worker_of:
                    self._batch_finished(work, answer)

    def _answered(self, worker: str, answer: Surroundings | Raised) -> None:
        """Admit a worker if it fits; else note why it does not."""
        if isinstance(answer, Raised):
            differences = [f"cannot run cadtof: {type(answer.error).__name__}: {answer.error}"]
        else:
            differences = answer.differences(self._expected)
        if differences:
            self._unfit.append(f"worker {worker} {' and '.join(differences)}")
        else:
            self._workers[worker] = self._with_room[worker] = Worker(worker)

    def _batch_finished(self, work: int, answer: BatchResult[Result] | Raised) -> None:
        worker = self._worker_of.pop(work)
        batch = worker.batches.pop(work)
        if isinstance(answer, Raised):
            for job in batch:
                job.end(answer)
        else:
            for job, result in zip(batch, answer.results, strict=False):
                job.end(result)
            self._queued.extendleft(reversed(batch[len(answer.results) :]))
            self._task_times_s.append(answer.seconds / len(answer.results))
        self._with_room[worker.name] = worker

    def _worker_lost(self, name: str, *, expected: bool) -> None:
        """Take back the work of a worker. Its tasks are done elsewhere, as suspects if the worker did not leave on purpose."""
        asked = [work for work, worker in self._asked.items() if worker == name]
        for work in asked:
            del self._asked[work]
        worker = self._workers.pop(name, Worker(name))
        self._with_room.pop(name, None)
        self._cluster.forget((*asked, *worker.batches))
        for work, batch in worker.batches.items():
            del self._worker_of[work]
            for job in batch:
                job.losses += not expected
            if batch[0].losses == ATTEMPTS:
                batch[0].end(WorkerDied())
            elif batch[0].losses:
                self._suspects += batch
            else:
                self._queued.extendleft(reversed(batch))

    def _tell(self) -> None:
        """Say which workers are left out, and that there is no worker; say each only once."""
        for unfit in self._unfit:
            self._say(f"warning: left out: {unfit}")
        self._unfit.clear()
        nobody = not self._workers and not self._asked
        if nobody and not self._told_to_wait:
            self._say(f"waiting for workers at {self._cluster.address}")
        self._told_to_wait = nobody
