"""Outcomes come in the order of the tasks, even if processes die or hang, and few tasks wait at a time."""

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import HELD_AT_ONCE, LATER_AT_ONCE, Later, WorkerDied
from cadtof_cli.execution.pool import TASKS_PER_WORKER
from cadtof_cli.execution.workers import ALONE, START_METHODS, StartMethod, Workers

pytestmark = pytest.mark.filterwarnings("ignore:This process.*is multi-threaded, use of fork:DeprecationWarning")


def square(number: int) -> int:
    return number * number


def first_is_slow(number: int) -> int:
    if number == 0:
        time.sleep(0.2)
    return number


def deadly(number: int) -> int:
    if number % 5 == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def deadly_once(task: tuple[int, Path]) -> int:
    number, seen = task
    if number == 4 and not seen.exists():
        seen.touch()
        os._exit(1)
    with (seen.parent / str(number)).open("a") as times:
        times.write("x")
    return number


def deadly_once_for_all(task: tuple[int, Path]) -> int:
    """Task 1 waits until the process of task 0 is idle, and then kills both processes; it does so only once."""
    number, seen = task
    if number == 1 and not seen.exists():
        time.sleep(0.2)
        seen.touch()
        for process in sorted(worker_processes(), key=os.getpid().__eq__):
            os.kill(process, signal.SIGKILL)
    return number


def worker_processes() -> list[int]:
    """Return the processes of all workers, from within one of them."""
    children = Path(f"/proc/{os.getppid()}/task/{os.getppid()}/children").read_text().split()
    ours = Path("/proc/self/cmdline").read_bytes()
    # a helper of spawned workers is a child too, but no worker
    return [int(child) for child in children if Path(f"/proc/{child}/cmdline").read_bytes() == ours]


def deadly_beside_another(number: int) -> int:
    """Task 1 dies if there is another worker, as if their memory together were more than the system gives."""
    if number == 1 and len(worker_processes()) > 1:
        os._exit(1)
    return number


def faulty(number: int) -> int:
    if number == 3:
        raise ZeroDivisionError("three")
    return number


@pytest.mark.parametrize("jobs", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_every_task_has_its_result(count: int, jobs: int) -> None:
    outcomes = list(run_ordered(square, range(count), workers=Workers(jobs=jobs, start_method="fork")))
    assert [(outcome.task, outcome.result) for outcome in outcomes] == [(n, n * n) for n in range(count)]


@pytest.mark.parametrize("start_method", START_METHODS)
def test_any_start_method_gives_the_outcomes_in_order(start_method: StartMethod) -> None:
    outcomes = run_ordered(square, range(3), workers=Workers(jobs=2, start_method=start_method))
    assert [outcome.result for outcome in outcomes] == [0, 1, 4]


def test_a_slow_task_keeps_its_place() -> None:
    outcomes = run_ordered(first_is_slow, range(6), workers=Workers(jobs=2, start_method="fork"))
    assert [outcome.result for outcome in outcomes] == list(range(6))


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_drawn_as_places_come_free(jobs: int) -> None:
    drawn = 0

    def tasks() -> Iterator[int]:
        nonlocal drawn
        for number in range(100):
            drawn += 1
            yield number

    for reported, _ in enumerate(
        run_ordered(square, tasks(), workers=Workers(jobs=jobs, start_method="fork")), start=1
    ):
        assert drawn <= reported - 1 + (jobs * TASKS_PER_WORKER if jobs > 1 else 1)
    assert drawn == 100


def test_a_task_that_kills_its_process_fails_alone() -> None:
    outcomes = list(run_ordered(deadly, range(14), workers=Workers(jobs=2, start_method="fork")))
    assert [outcome.task for outcome in outcomes] == list(range(14))
    assert [outcome.result for outcome in outcomes] == [WorkerDied() if n % 5 == 3 else n for n in range(14)]


def test_a_process_that_dies_once_costs_nothing(tmp_path: Path) -> None:
    tasks = [(number, tmp_path / "seen") for number in range(12)]
    outcomes = list(run_ordered(deadly_once, tasks, workers=Workers(jobs=2, start_method="fork")))
    assert [outcome.result for outcome in outcomes] == list(range(12))
    # tasks that had been reported, or came before the task that died, are not done again
    assert [(tmp_path / str(number)).read_text() for number in range(2)] == ["x", "x"]


def test_processes_that_die_together_cost_nothing_even_if_one_was_idle(tmp_path: Path) -> None:
    tasks = [(number, tmp_path / "seen") for number in range(2)]
    outcomes = list(run_ordered(deadly_once_for_all, tasks, workers=Workers(jobs=2, start_method="fork")))
    assert [outcome.result for outcome in outcomes] == [0, 1]


@pytest.mark.parametrize("jobs", [2, 3])
def test_a_task_that_is_tried_again_has_all_memory_for_itself(jobs: int) -> None:
    outcomes = list(run_ordered(deadly_beside_another, range(3), workers=Workers(jobs=jobs, start_method="fork")))
    assert [outcome.result for outcome in outcomes] == [0, 1, 2]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_exception_of_a_task_is_raised_in_the_caller(jobs: int) -> None:
    with pytest.raises(ZeroDivisionError, match="three"):
        list(run_ordered(faulty, range(6), workers=Workers(jobs=jobs, start_method="fork")))


def test_the_signal_mask_of_the_caller_stays_as_it_was() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    outcomes = run_ordered(square, range(30), workers=Workers(jobs=2, start_method="fork"))
    next(outcomes)
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
    outcomes.close()


def waits_for_the_next(task: tuple[int, Path]) -> int | Later[int]:
    """An even task ends only after the next task has begun; an odd task has its result at once."""
    number, folder = task
    (folder / str(number)).touch()
    if number % 2:
        return number

    def finish(let_go: Callable[[], None]) -> int:
        deadline = time.monotonic() + 20
        while number < 8 and not (folder / str(number + 1)).exists():
            assert time.monotonic() < deadline
            time.sleep(0.001)
        if number == 6:
            raise ZeroDivisionError("six")
        return -number

    return Later(finish)


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_next_task_runs_while_a_result_is_waited_for(jobs: int, tmp_path: Path) -> None:
    tasks = [(number, tmp_path) for number in range(9)]
    outcomes = run_ordered(waits_for_the_next, tasks, workers=Workers(jobs=jobs, start_method="fork"))
    assert [next(outcomes).result for _ in range(6)] == [0, 1, -2, 3, -4, 5]
    with pytest.raises(ZeroDivisionError, match="six"):
        next(outcomes)


def test_few_results_hold_memory_while_more_are_waited_for() -> None:
    """Results take long to write, and longer to keep. Memory is held by two of them and by the one that is computed."""
    lock, counts, most = threading.Lock(), Counter[str](), Counter[str]()

    def count(what: str, change: int) -> None:
        with lock:
            counts[what] += change
            most[what] = max(most[what], counts[what])

    def slow(number: int) -> int | Later[int]:
        count("held", 1)

        def finish(let_go: Callable[[], None]) -> int:
            count("waited for", 1)
            time.sleep(0.01)
            count("held", -1)
            if number % 3:
                let_go()
                time.sleep(0.05)
            count("waited for", -1)
            return number

        return Later(finish)

    assert [outcome.result for outcome in run_ordered(slow, range(30), workers=ALONE)] == list(range(30))
    assert most == {"held": HELD_AT_ONCE + 1, "waited for": LATER_AT_ONCE}


def dies_while_it_waits(number: int) -> int | Later[int]:
    def finish(let_go: Callable[[], None]) -> int:
        if number == 3:
            os._exit(1)
        return number

    return Later(finish)


def test_a_process_that_dies_while_it_waits_costs_no_other_task() -> None:
    outcomes = list(run_ordered(dies_while_it_waits, range(8), workers=Workers(jobs=2, start_method="fork")))
    assert [outcome.result for outcome in outcomes] == [WorkerDied() if n == 3 else n for n in range(8)]


def hangs_while_it_waits(number: int) -> int | Later[int]:
    def finish(let_go: Callable[[], None]) -> int:
        if number == 3:
            time.sleep(1000)
        return number

    return Later(finish)


def test_a_task_that_waits_for_ever_fails_alone() -> None:
    workers = Workers(jobs=2, start_method="fork", task_timeout_s=0.5)
    outcomes = list(run_ordered(hangs_while_it_waits, range(12), workers=workers))
    assert [outcome.result for outcome in outcomes] == [WorkerDied(0.5) if n == 3 else n for n in range(12)]


def cores_of_worker(_: int) -> tuple[int, frozenset[int]]:
    time.sleep(0.01)
    return os.getpid(), frozenset(os.sched_getaffinity(0))


def dies_at_five(number: int) -> tuple[int, frozenset[int]]:
    if number == 5:
        os._exit(1)
    return cores_of_worker(number)


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="the system does not say which cores a process may run on"
)
def test_with_as_many_workers_as_cores_each_stays_on_its_own_core() -> None:
    cores = os.sched_getaffinity(0)
    workers = Workers(jobs=len(cores), start_method="fork", task_timeout_s=60)
    outcomes = run_ordered(cores_of_worker, range(10 * len(cores)), workers=workers)
    found = dict(outcome.result for outcome in outcomes if not isinstance(outcome.result, WorkerDied))
    assert sorted(core for (core,) in found.values()) == sorted(cores)[: len(found)]
    assert os.sched_getaffinity(0) == cores


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="the system does not say which cores a process may run on"
)
def test_a_worker_that_replaces_a_dead_one_stays_on_one_core_too() -> None:
    cores = os.sched_getaffinity(0)
    outcomes = run_ordered(
        dies_at_five, range(20), workers=Workers(jobs=len(cores), start_method="fork", task_timeout_s=60)
    )
    for outcome in outcomes:
        assert isinstance(outcome.result, WorkerDied) == (outcome.task == 5)
        if not isinstance(outcome.result, WorkerDied):
            assert len(outcome.result[1]) == 1


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="the system does not say which cores a process may run on"
)
@pytest.mark.parametrize("more", [-1, 1])
def test_with_fewer_or_more_workers_than_cores_each_may_run_on_any_core(more: int) -> None:
    cores = frozenset(os.sched_getaffinity(0))
    workers = Workers(jobs=max(len(cores) + more, 1), start_method="fork")
    outcomes = run_ordered(cores_of_worker, range(10), workers=workers)
    assert all(not isinstance(outcome.result, WorkerDied) and outcome.result[1] == cores for outcome in outcomes)
