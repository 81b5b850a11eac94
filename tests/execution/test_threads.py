"""Threads that cannot begin: results are finished without them, and nothing waits for them."""

import _thread
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

from cadtof_cli.execution import outcome
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import Later, Work, finishing
from cadtof_cli.execution.workers import Workers

resource = pytest.importorskip("resource")

pytestmark = pytest.mark.filterwarnings("ignore:This process.*is multi-threaded, use of fork:DeprecationWarning")


def half_later(number: int) -> Later[float]:
    return Later(lambda _: 0.5 * number)


@pytest.mark.parametrize("allowed", [0, 1])
@pytest.mark.parametrize("jobs", [1, 2])
def test_results_are_finished_even_if_no_more_threads_can_start(
    jobs: int, allowed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As under `ulimit -u` or `ulimit -v`: results are finished by the threads that could start, or without threads."""
    start, started = _thread.start_new_thread, list[int]()

    def refused(work: Callable[[], None], arguments: tuple[()]) -> None:
        if len(started) >= allowed:
            raise RuntimeError("can't start new thread")
        started.append(start(work, arguments))

    monkeypatch.setattr(_thread, "start_new_thread", refused)
    half: Work[int, float] = half_later
    outcomes = run_ordered(half, range(20), workers=Workers(jobs=jobs, start_method="fork"))
    assert [outcome.result for outcome in outcomes] == [0.5 * task for task in range(20)]


def test_an_interrupt_while_a_thread_starts_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(work: Callable[[], None], arguments: tuple[()]) -> None:
        raise KeyboardInterrupt

    def begun() -> Later[int]:
        with finishing() as finisher:
            return finisher.begin(Later(lambda _: 9))

    monkeypatch.setattr(_thread, "start_new_thread", interrupted)
    with pytest.raises(KeyboardInterrupt):
        begun()


def test_a_thread_that_comes_too_late_does_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    late, calls = list[Callable[[], None]](), list[str]()
    monkeypatch.setattr(outcome, "BEGINS_S", 0.01)
    monkeypatch.setattr(_thread, "start_new_thread", lambda work, _: late.append(work))
    ends = list[_thread.LockType]()
    assert not outcome.begin_thread(lambda: calls.append("worked"), ends)
    late[0]()
    assert not calls
    assert not ends


@pytest.mark.parametrize("begins", [False, True])
def test_an_interrupt_after_a_thread_has_started_leaves_no_thread(
    begins: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One thread works already. If the other one were not known, it would take the end that is meant for the first."""
    start, waiting = _thread.start_new_thread, list[Callable[[], None]]()

    def interrupted(work: Callable[[], None], arguments: tuple[()]) -> None:
        if begins:
            start(work, arguments)
            time.sleep(0.2)
        else:
            waiting.append(work)
        raise KeyboardInterrupt

    def begun() -> Later[int]:
        with finishing() as finisher:
            first: Later[int] = finisher.begin(Later(lambda _: 9))
            assert first.answer() == 9
            monkeypatch.setattr(_thread, "start_new_thread", interrupted)
            return finisher.begin(Later(lambda _: 9))

    before = _thread._count()
    with pytest.raises(KeyboardInterrupt):
        begun()
    for work in waiting:
        work()
    until = time.monotonic() + 60
    while _thread._count() != before and time.monotonic() < until:
        time.sleep(0.01)
    assert _thread._count() == before


ONE_RESULT = """
import resource, sys
from pathlib import Path
from cadtof_cli.execution.outcome import Later, finishing

pages = int(Path("/proc/self/statm").read_text().split()[0])
room = pages * resource.getpagesize() + int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_AS, (room, room))
with finishing() as finisher:
    print(finisher.begin(Later(lambda _: 9)).answer())
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="the limit counts from the memory of the process, which Linux tells"
)
def test_a_thread_that_lacks_the_memory_to_begin_is_not_waited_for() -> None:
    """The system has room for the stack of the thread, but not for what Python makes before its first step."""
    stack = resource.getrlimit(resource.RLIMIT_STACK)[0]
    stack = stack if 0 < stack < 2**30 else 8 * 2**20
    for more in range(0, 40 * 2**10, 4 * 2**10):
        words = [sys.executable, "-c", ONE_RESULT, str(stack + more)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout == "9\n"
