"""Tasks → outcomes in the order of the tasks, on workers that come and go."""

import itertools
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from cadtof_cli.errors import ClusterError
from cadtof_cli.execution.cluster.connection import Connection, Finished, News, WorkerJoined, WorkerLost
from cadtof_cli.execution.cluster.worker import BatchResult, Raised, Surroundings, run_batch, surroundings
from cadtof_cli.execution.outcome import Outcome, Work, WorkerDied

Task = TypeVar("Task")
Result = TypeVar("Result")

SHORT_S = 0.05
"""Tasks that are shorter than this go in batches."""

BATCH_S = 0.25
"""How long a batch is to be: a task's way there and back costs some ten milliseconds of work, in four processes."""

MOST_IN_BATCH = 100

BATCHES_PER_WORKER = 3
"""One is computed, the others wait so that the worker does not idle, even where its messages are slow to come."""

TASKS_AHEAD = 10_000
"""Tasks that may be drawn before the first of them is reported: while one is slow, or its worker is gone without a word for
minutes, the others go on. Results are small."""


ANSWER_S = 10
"""How long a run waits for the first answers of all workers that are there: one that is frozen, or paused for its memory, is
there and does nothing."""


class Cluster(Protocol):
    """What is asked of a connection."""

    address: str

    def submit(self, work: int, worker: str, function: Callable[..., Any], /, *arguments: Any) -> None:
        """Have a worker call a function."""

    def forget(self, works: Iterable[int], /) -> None:
        """Take work back."""

    def news(self) -> list[News]:
        """Wait for news, a second or so at most, and return all there is."""

    def close(self) -> None:
        """Take back all work and disconnect."""


@dataclass(eq=False)
class Entry(Generic[Task, Result]):
    """A task that is not reported yet, and what became of it; None while nothing has."""

    task: Task
    ended: Outcome[Task, Result] | Raised | None = None


@dataclass
class Batch(Generic[Task, Result]):
    """Tasks that go to a worker together; `alone` where it is one that may have killed a worker before."""

    entries: list[Entry[Task, Result]]
    alone: bool = False


@dataclass
class Worker(Generic[Task, Result]):
    """A worker that is fit for the run, and the batches it has, by the number of the work."""

    name: str
    batches: dict[int, Batch[Task, Result]] = field(default_factory=dict)


def run_on_cluster(
    function: Work[Task, Result],
    tasks: Iterable[Task],
    /,
    *,
    scheduler: str,
    probe: Path | None,
    say: Callable[[str], None],
) -> Generator[Outcome[Task, Result], None, None]:
    """Connect, make sure that the workers fit, and return a generator of outcomes in the order of the tasks.

    Raises:
        SettingsError: no scheduler answers.
        ClusterError: workers do not fit; raised by the generator: the scheduler is lost.
    """
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

    A worker that is lost takes its batches with it. Which of their tasks killed it, if any did, nobody knows: each of
    them is tried once more, on a worker that has nothing else; one that loses that too has killed twice and fails.
    """

    def __init__(
        self,
        cluster: Cluster,
        function: Work[Task, Result],
        tasks: Iterator[Task],
        expected: Surroundings,
        probe: Path | None,
        say: Callable[[str], None],
    ) -> None:
        self._cluster, self._function, self._waiting, self._say = cluster, function, tasks, say
        self._expected, self._probe, self._folder = expected, probe, Path.cwd()
        self._numbers = itertools.count()
        self._seconds: deque[float] = deque(maxlen=15)
        self._unreported: deque[Entry[Task, Result]] = deque()
        self._again: deque[Entry[Task, Result]] = deque()
        self._suspects: deque[Entry[Task, Result]] = deque()
        self._asked: dict[int, str] = {}
        self._unfit: list[str] = []
        self._workers: dict[str, Worker[Task, Result]] = {}
        self._with_room: dict[str, Worker[Task, Result]] = {}
        self._at: dict[int, Worker[Task, Result]] = {}
        self._told_to_wait = False

    def welcome_workers(self) -> None:
        """Ask all workers that are there what they run, and wait for their answers, for a while.

        Raises:
            ClusterError: some would not make the same results; all of those are named.
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
                yield from self._in_order()
                if not self._unreported and not self._drawn():
                    return
                self._hand_out()
                self._tell()
                self._take_news()
        finally:
            self._cluster.close()

    def _in_order(self) -> Iterator[Outcome[Task, Result]]:
        """Yield what has ended and has nothing before it that has not."""
        while self._unreported and (ended := self._unreported[0].ended) is not None:
            self._unreported.popleft()
            if isinstance(ended, Raised):
                raise ended.error
            yield ended

    def _drawn(self) -> bool:
        """Draw one task more, if there is one."""
        for task in itertools.islice(self._waiting, 1):
            entry: Entry[Task, Result] = Entry(task)
            self._unreported.append(entry)
            self._again.append(entry)
            return True
        return False

    def _hand_out(self) -> None:
        """Give workers what they have room for: each one batch, then each another."""
        kept: dict[str, Worker[Task, Result]] = {}
        while self._with_room:
            name = next(iter(self._with_room))
            worker = self._with_room.pop(name)
            batch = self._next_batch(worker)
            if batch is None:
                kept[name] = worker
                if not self._suspects:
                    break
                continue
            work = next(self._numbers)
            worker.batches[work], self._at[work] = batch, worker
            tasks = [entry.task for entry in batch.entries]
            self._cluster.submit(work, name, run_batch, self._function, tasks, self._folder)
            if not batch.alone and len(worker.batches) < BATCHES_PER_WORKER:
                self._with_room[name] = worker
        self._with_room |= kept

    def _next_batch(self, worker: Worker[Task, Result]) -> Batch[Task, Result] | None:
        """Return a batch for a worker; as long as there are suspects, only workers without any get one: a suspect."""
        if self._suspects:
            return None if worker.batches else Batch([self._suspects.popleft()], alone=True)
        size = self._batch_size()
        while len(self._again) < size and len(self._unreported) < TASKS_AHEAD and self._drawn():
            pass
        entries = [self._again.popleft() for _ in range(min(size, len(self._again)))]
        return Batch(entries) if entries else None

    def _batch_size(self) -> int:
        # the faster ones: on a busy machine the others are long for reasons that larger batches do not mend
        usual = statistics.quantiles(self._seconds)[0] if len(self._seconds) > 1 else SHORT_S
        return 1 if usual >= SHORT_S else min(math.ceil(BATCH_S / max(usual, 1e-9)), MOST_IN_BATCH)

    def _take_news(self) -> None:
        for news in self._cluster.news():
            match news:
                case WorkerJoined(worker):
                    work = next(self._numbers)
                    self._asked[work] = worker
                    self._cluster.submit(work, worker, surroundings, self._folder, self._probe)
                case WorkerLost(worker, expected):
                    self._worker_lost(worker, expected=expected)
                case Finished(work) if work in self._asked:
                    self._answered(self._asked.pop(work), news)
                case Finished(work) if work in self._at:
                    self._batch_finished(work, news)

    def _answered(self, worker: str, news: Finished) -> None:
        """Admit a worker that fits."""
        if news.error is not None:
            differences = [f"cannot run cadtof: {type(news.error).__name__}: {news.error}"]
        else:
            differences = news.result.differences(self._expected)
        if differences:
            self._unfit.append(f"worker {worker} {' and '.join(differences)}")
        else:
            self._workers[worker] = self._with_room[worker] = Worker(worker)

    def _batch_finished(self, work: int, news: Finished) -> None:
        worker = self._at.pop(work)
        batch = worker.batches.pop(work)
        if news.error is not None:
            for entry in batch.entries:
                entry.ended = Raised(news.error)
        else:
            done: BatchResult[Result] = news.result
            for entry, result in zip(batch.entries, done.results, strict=False):
                entry.ended = result if isinstance(result, Raised) else Outcome(entry.task, result)
            self._again.extendleft(reversed(batch.entries[len(done.results) :]))
            self._seconds.append(done.seconds / len(done.results))
        self._with_room[worker.name] = worker

    def _worker_lost(self, name: str, *, expected: bool) -> None:
        """Take back what a worker had: to be done elsewhere, and with care if the worker did not leave on purpose."""
        asked = [work for work, worker in self._asked.items() if worker == name]
        for work in asked:
            del self._asked[work]
        worker = self._workers.pop(name, Worker(name))
        self._with_room.pop(name, None)
        self._cluster.forget((*asked, *worker.batches))
        for work, batch in worker.batches.items():
            del self._at[work]
            if batch.alone and not expected:
                (entry,) = batch.entries
                entry.ended = Outcome(entry.task, WorkerDied())
            elif batch.alone or not expected:
                self._suspects += batch.entries
            else:
                self._again.extendleft(reversed(batch.entries))

    def _tell(self) -> None:
        """Say which workers are left out, and that there is nobody to work, once each."""
        for unfit in self._unfit:
            self._say(f"warning: left out: {unfit}")
        self._unfit.clear()
        nobody = not self._workers and not self._asked
        if nobody and not self._told_to_wait:
            self._say(f"waiting for workers at {self._cluster.address}")
        self._told_to_wait = nobody
