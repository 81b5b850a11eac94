"""Every task has one outcome, in order, even if workers are lost: a pretended cluster draws by chance what happens."""

import random
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cadtof_cli.errors import ClusterError
from cadtof_cli.execution.cluster import ordered
from cadtof_cli.execution.cluster.connection import Connection, Finished, News, WorkerJoined, WorkerLost
from cadtof_cli.execution.cluster.ordered import BATCHES_PER_WORKER, MOST_IN_BATCH, SHORT_S, TASKS_AHEAD, ClusterRun
from cadtof_cli.execution.cluster.worker import BatchResult, Surroundings, run_batch, surroundings
from cadtof_cli.execution.outcome import Outcome, Raised, WorkerDied

OURS = Surroundings("3.11.2", "0.1.0", "abc", None)


class PretendedCluster(Connection):
    """Workers that do a batch when their turn is drawn, join and leave by chance, and die of deadly tasks."""

    def __init__(self, seed: int, *, deadly: frozenset[int] = frozenset(), seconds: float = 1.0) -> None:
        self.address = "tcp://127.0.0.1:1"
        self.rng = random.Random(seed)
        self.deadly, self.seconds = deadly, seconds
        self.waiting: dict[str, list[tuple[int, Callable[..., Any], tuple[Any, ...]]]] = {}
        self.joined = 0
        self.batches: list[tuple[str, list[int]]] = []
        self.deaths: dict[int, int] = {}
        self.most_waiting = 0
        self.events: frozenset[str] = frozenset()
        self.closed = False
        self.different: dict[str, Surroundings] = {}

    def submit(self, work: int, worker: str, function: Callable[..., Any], /, *arguments: Any) -> None:
        if worker in self.waiting:
            self.waiting[worker].append((work, function, arguments))
            self.most_waiting = max(self.most_waiting, len(self.waiting[worker]))

    def forget(self, works: Iterable[int], /) -> None:
        gone = set(works)
        for worker, waiting in self.waiting.items():
            self.waiting[worker] = [one for one in waiting if one[0] not in gone]

    def close(self) -> None:
        self.closed = True

    def join(self) -> WorkerJoined:
        self.joined += 1
        worker = f"tcp://127.0.0.1:{10000 + self.joined}"
        self.waiting[worker] = []
        return WorkerJoined(worker)

    def lose(self, worker: str, *, expected: bool) -> WorkerLost:
        del self.waiting[worker]
        return WorkerLost(worker, expected)

    def news(self) -> list[News]:
        busy = [worker for worker, waiting in self.waiting.items() if waiting]
        chance = self.rng.random()
        if not self.waiting or ("join" in self.events and chance < 0.05):
            return [self.join()]
        worker = self.rng.choice(busy or list(self.waiting))
        if "leave" in self.events and chance < 0.15:
            return [self.lose(worker, expected=True)]
        if not busy:
            return [self.join()]
        work, function, arguments = self.waiting[worker][0]
        if function is surroundings:
            self.waiting[worker].pop(0)
            return [Finished(work, self.different.get(worker, OURS))]
        tasks: list[int] = arguments[1]
        self.batches.append((worker, tasks))
        for task in (task for task in tasks if task in self.deadly):
            self.deaths[task] = self.deaths.get(task, 0) + 1
            return [self.lose(worker, expected=False)]
        self.waiting[worker].pop(0)
        begun = self.rng.randint(1, len(tasks)) if "time" in self.events else len(tasks)
        results = tuple(_done(arguments[0], task) for task in tasks[:begun])
        return [Finished(work, BatchResult(results, self.seconds * begun))]


def _done(function: Callable[[int], int], task: int) -> int | Raised:
    try:
        return function(task)
    except ZeroDivisionError as error:
        return Raised(error)


def square(number: int) -> int:
    return number * number


def faulty(number: int) -> int:
    if number == 7:
        raise ZeroDivisionError("seven")
    return number


def cluster_run(
    cluster: PretendedCluster,
    tasks: Iterator[int],
    function: Callable[[int], int] = square,
    messages: list[str] | None = None,
) -> ClusterRun[int, int]:
    say = (lambda _: None) if messages is None else messages.append
    return ClusterRun(cluster, function, tasks, OURS, Path("probe"), say)


@settings(max_examples=150)
@given(
    st.integers(0, 2**32), st.integers(0, 60), st.frozensets(st.integers(0, 59), max_size=4),
    st.frozensets(st.sampled_from(["join", "leave", "time"])), st.sampled_from([SHORT_S / 30, 1.0]),
)  # fmt: skip
def test_every_task_has_one_outcome_in_order(
    seed: int, count: int, deadly: frozenset[int], events: frozenset[str], seconds: float
) -> None:
    cluster = PretendedCluster(seed, deadly=deadly, seconds=seconds)
    cluster.events = events
    outcomes = list(cluster_run(cluster, iter(range(count))).outcomes())
    assert outcomes == [Outcome(n, WorkerDied() if n in deadly else n * n) for n in range(count)]
    # A deadly task kills two workers at most, and is alone in its last batch.
    # If two deadly tasks share a batch, the worker dies of the first one.
    assert cluster.deaths.keys() == {task for task in deadly if task < count}
    assert all(times <= 2 for times in cluster.deaths.values())
    last = {task: tasks for _, tasks in cluster.batches for task in tasks}
    assert all(last[task] == [task] for task in cluster.deaths)
    assert cluster.most_waiting <= BATCHES_PER_WORKER
    assert cluster.closed


@pytest.mark.parametrize(("seconds", "expected"), [(1.0, 1), (SHORT_S, 1), (SHORT_S / 2, 10), (1e-6, MOST_IN_BATCH)])
def test_short_tasks_go_in_batches(seconds: float, expected: int) -> None:
    cluster = PretendedCluster(1, seconds=seconds)
    list(cluster_run(cluster, iter(range(1000))).outcomes())
    assert max(len(tasks) for _, tasks in cluster.batches) == expected
    assert len(cluster.batches[0][1]) == 1


def test_tasks_are_drawn_as_workers_ask_for_them() -> None:
    drawn = 0

    def tasks() -> Iterator[int]:
        nonlocal drawn
        for number in range(300):
            drawn += 1
            yield number

    cluster = PretendedCluster(3)
    for reported, _ in enumerate(cluster_run(cluster, tasks()).outcomes()):
        assert drawn <= reported + 1 + cluster.joined * BATCHES_PER_WORKER
    assert drawn == 300


def test_while_one_task_is_slow_only_so_many_others_run_ahead() -> None:
    class FirstIsStuck(PretendedCluster):
        def news(self) -> list[News]:
            if len(self.waiting) < 2:
                return [self.join()]
            done = sum(len(tasks) for _, tasks in self.batches)
            for worker, waiting in self.waiting.items():
                for place, (work, function, arguments) in enumerate(waiting):
                    if function is surroundings or 0 not in arguments[1] or done > TASKS_AHEAD * 0.9:
                        waiting.pop(place)
                        if function is surroundings:
                            return [Finished(work, OURS)]
                        self.batches.append((worker, arguments[1]))
                        return [Finished(work, BatchResult(tuple(arguments[1]), 1e-3 * len(arguments[1])))]
            raise AssertionError("nothing to do, and the first task is not let go")

    count = int(TASKS_AHEAD * 1.5)
    outcomes = list(cluster_run(FirstIsStuck(5), iter(range(count))).outcomes())
    assert [outcome.task for outcome in outcomes] == list(range(count))


def test_an_exception_is_raised_in_its_turn() -> None:
    cluster = PretendedCluster(4)
    outcomes = cluster_run(cluster, iter(range(20)), faulty).outcomes()
    assert [next(outcomes).result for _ in range(7)] == list(range(7))
    with pytest.raises(ZeroDivisionError, match="seven"):
        next(outcomes)
    assert cluster.closed


def test_a_worker_that_never_answers_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    class FirstIsFrozen(PretendedCluster):
        def news(self) -> list[News]:
            if self.joined < 2:
                return [self.join(), self.join()]
            others = {worker: waiting for worker, waiting in self.waiting.items() if worker != "tcp://127.0.0.1:10001"}
            if not any(others.values()):
                return []
            everybody, self.waiting = self.waiting, others
            found = super().news()
            self.waiting = everybody
            return found

    messages: list[str] = []
    monkeypatch.setattr(ordered, "ANSWER_S", 0.2)
    run = cluster_run(FirstIsFrozen(0), iter(range(3)), messages=messages)
    run.welcome_workers()
    assert [outcome.result for outcome in run.outcomes()] == [0, 1, 4]
    assert messages == [
        "warning: worker tcp://127.0.0.1:10001 has not answered for 0.2 s: it gets no frames until it does"
    ]


def test_a_worker_that_is_lost_before_it_has_answered_takes_no_other_worker_with_it() -> None:
    class FirstIsLost(PretendedCluster):
        def news(self) -> list[News]:
            if self.joined < 2:
                return [self.join(), self.join()]
            first = "tcp://127.0.0.1:10001"
            return [self.lose(first, expected=False)] if first in self.waiting else super().news()

    cluster = FirstIsLost(0)
    run = cluster_run(cluster, iter(range(3)))
    run.welcome_workers()
    assert [outcome.result for outcome in run.outcomes()] == [0, 1, 4]
    # the second has done all of them: nobody else was needed
    assert cluster.joined == 2


def test_a_worker_whose_own_folder_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert run_batch(square, [2, 3], tmp_path).results == (4, 9)


def test_a_batch_whose_tasks_have_become_slow_is_cut_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cadtof_cli.execution.cluster.worker.LONGEST_BATCH_S", 0.0)
    assert run_batch(square, [2, 3], tmp_path).results == (4,)


def test_workers_that_differ_at_the_start_are_all_named() -> None:
    class Other(PretendedCluster):
        def news(self) -> list[News]:
            if self.joined < 2:
                joined = [self.join(), self.join()]
                self.different = {
                    joined[0].worker: Surroundings("3.11.4", "0.0.9", "abc", None),
                    joined[1].worker: Surroundings("3.12.0", "0.1.0", "abd", "seen"),
                }
                return [*joined]
            return super().news()

    with pytest.raises(ClusterError) as refused:
        cluster_run(Other(0), iter(range(3))).welcome_workers()
    assert str(refused.value) == (
        "worker tcp://127.0.0.1:10001 has cadtof 0.0.9, expected 0.1.0 as here; "
        "worker tcp://127.0.0.1:10002 has Python 3.12.0, expected 3.11.2 as here and has cadtof 0.1.0, but of other source code "
        "than here (abd, not abc) and does not see the folders of this run; expected a file system that all workers share"
    )


def test_a_worker_that_differs_and_comes_later_is_left_out_and_named() -> None:
    cluster, messages = PretendedCluster(6), list[str]()
    cluster.events = frozenset({"join"})
    cluster.different = {"tcp://127.0.0.1:10002": Surroundings("3.11.2", "0.2.0", "abc", None)}
    list(cluster_run(cluster, iter(range(100)), messages=messages).outcomes())
    assert (
        messages.count("warning: left out: worker tcp://127.0.0.1:10002 has cadtof 0.2.0, expected 0.1.0 as here") == 1
    )
    assert "tcp://127.0.0.1:10002" not in {worker for worker, _ in cluster.batches}
