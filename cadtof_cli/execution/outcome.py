"""The outcome of a task, and threads that wait for its end, as for a disk, while the next task is computed."""

import _thread
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import field
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar, cast

from cadtof_cli.records import dataclass

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class WorkerDied:
    """Stands in for the result of a task if its process ended without a result (killed, or out of memory).

    `after_s` is the time limit, if the process was ended because the task exceeded it; else None.
    """

    after_s: float | None = None


@dataclass(frozen=True)
class Raised:
    """Stands in for the result of a task whose function raised an exception."""

    error: BaseException


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """A task with the result of its function."""

    task: Task
    result: Result | WorkerDied


ATTEMPTS = 2
"""How many times a task is tried if its worker is lost each time."""


@dataclass(eq=False)
class Job(Generic[Task, Result]):
    """A task until its outcome is reported.

    `losses` is how many times its worker was lost, perhaps because of this task. When the task has `ended`, `answer` is its
    result, or what stands in for it.
    """

    task: Task
    losses: int = 0
    answer: Result | Raised | WorkerDied | None = None
    ended: bool = False

    def end(self, answer: Result | Raised | WorkerDied, /) -> None:
        """Keep the answer to the task."""
        self.answer, self.ended = answer, True

    def outcome(self) -> Outcome[Task, Result]:
        """Return the outcome of the task, which has ended, or raise what its function raised."""
        return outcome_of(self.task, cast("Result | Raised | WorkerDied", self.answer))


def outcome_of(task: Task, answer: Result | Raised | WorkerDied, /) -> Outcome[Task, Result]:
    """Return the outcome of a task with this answer, or raise what its function raised."""
    if isinstance(answer, Raised):
        raise answer.error
    return Outcome(task, answer)


@dataclass(eq=False)
class Later(Generic[Result]):
    """A result that still has to be waited for. A task's function returns it when only waiting is left, as for a disk.

    A thread calls `wait`, which waits and returns the result, while the next task is computed. The argument of `wait` is a
    function that it calls as soon as it has freed its large memory. When it has returned, the result is `there`. A `Later` does
    the work of a `Future` with a tenth of the function calls, because every frame has one.
    """

    wait: Callable[[Callable[[], None]], Result]
    let_go: Callable[[], None] | None = None
    there: bool = False
    _answer: Result | Raised | None = None
    _ended: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._ended.acquire()

    def finish(self) -> "Later[Result]":
        """Call `wait` and keep its result or exception, but nothing that the result was made from."""
        try:
            self._answer = self.wait(self._free)
            self._free()
        except Exception as error:  # noqa: BLE001  (`outcome_of` raises it)
            self._answer = Raised(error)
            self._free()
        finally:
            # also if memory runs out: a result that is not there would be waited for without end
            del self.wait
            self.there = True
            self._ended.release()
        return self

    def _free(self) -> None:
        let_go, self.let_go = self.let_go, None
        if let_go is not None:
            let_go()

    def answer(self) -> Result | Raised:
        """Wait until the result is there and return it, or the exception in its place. It can be called only once."""
        self._ended.acquire()
        answer, self._answer = self._answer, None
        return cast("Result | Raised", answer)


Work = Callable[[Task], Result | Later[Result]]
"""The function of a run: it takes a task and returns its result, or a `Later` that will have it."""


LATER_AT_ONCE = 4
"""How many results of one process may be waited for at once: a disk writes several files in about the time of one."""

HELD_AT_ONCE = 2
"""How many of these results may hold much memory, such as maps that are still to be written: more do not make the disk faster."""

BEGINS_S = 1.0
"""Longest wait for the first step of a new thread. A thread without memory ends before it, and tells nobody."""


@dataclass(eq=False)
class Finisher:
    """Finishes results in threads, at most `LATER_AT_ONCE` at a time; see `finishing`.

    A thread calls `then` each time that it has finished a result. `ends` are the locks of the threads, see `begin_thread`.
    """

    then: Callable[[], None]
    waiting: SimpleQueue[Later[Any] | None] = field(default_factory=SimpleQueue)
    ends: list[_thread.LockType] = field(default_factory=list)
    most: int = LATER_AT_ONCE
    room: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(HELD_AT_ONCE))

    def begin(self, result: Result | Raised | Later[Result], /) -> Later[Result]:
        """Return the `Later` that will have the result; a result that needs no waiting is there at once.

        This blocks while `HELD_AT_ONCE` results hold much memory.
        """
        if not isinstance(result, Later):
            return cast("Later[Result]", Later(lambda _: result).finish())
        self.room.acquire()
        result.let_go = self.room.release
        self.waiting.put(result)
        if len(self.ends) < self.most and not begin_thread(self._work, self.ends):
            self.most = len(self.ends)
        if not self.ends:
            self.waiting.get()
            result.finish()
        return result

    def attempt(self, function: Work[Task, Result], task: Task, /) -> Later[Result]:
        """Do a task; return the `Later` that will have its result, or that has the exception that the function raised."""
        result: Result | Raised | Later[Result]
        try:
            result = function(task)
        except Exception as error:  # noqa: BLE001  (`outcome_of` raises it)
            result = Raised(error)
        return self.begin(result)

    def _work(self) -> None:
        while (later := self.waiting.get()) is not None:
            later.finish()
            # keep nothing of this result while the next one is waited for
            del later
            self.then()


@contextmanager
def finishing(then: Callable[[], None] = lambda: None) -> Iterator[Finisher]:
    """Yield a `Finisher`; leaving the context waits for all results that were begun, after an error only for those in a thread.

    No thread is started before there is a result to wait for, because a process that has threads must not fork. If the system
    allows no threads at all (`ulimit -u`, `ulimit -v`), `begin` finishes each result itself.
    """
    finisher = Finisher(then)
    try:
        yield finisher
    except BaseException:
        with suppress(Empty):
            while True:
                finisher.waiting.get_nowait()
        raise
    finally:
        for _ in finisher.ends:
            finisher.waiting.put(None)
        for end in finisher.ends:
            end.acquire()


def begin_thread(work: Callable[[], None], ends: list[_thread.LockType], /) -> bool:
    """Call `work` in a new thread, and return whether it began. If the system allows no more threads or memory, it never will.

    `threading.Thread.start` would then wait without end. The end of the process does not wait for the thread. `ends` gets a
    lock, which the thread holds while it works: whoever acquires the lock waits for the end of the work, or keeps it from
    beginning. The lock is in the list before there is a thread, because an exception by a signal may end this function at any
    step.
    """
    begun, end = _thread.allocate_lock(), _thread.allocate_lock()
    begun.acquire()
    trace, profile = threading.gettrace(), threading.getprofile()

    def run() -> None:
        if not end.acquire(blocking=False):
            # it comes too late
            return
        begun.release()
        # what `threading` does for its threads: a debugger or a count of calls may want it
        sys.settrace(trace)
        sys.setprofile(profile)
        try:
            work()
        finally:
            end.release()

    ends.append(end)
    try:
        _thread.start_new_thread(run, ())
        if begun.acquire(timeout=BEGINS_S) or not end.acquire(blocking=False):
            return True
    except RuntimeError:
        pass
    ends.remove(end)
    return False
