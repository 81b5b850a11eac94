"""What comes of a task, and threads that wait for what is left of it while the next one is computed."""

import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Generic, TypeVar, cast

from cadtof_cli.records import dataclass

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class WorkerDied:
    """What takes the place of a result where a task's process ended without giving one (killed, or out of memory).

    `after_s` is the time that the task was given, where it was ended for taking longer.
    """

    after_s: float | None = None


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """A task with what its function returned."""

    task: Task
    result: Result | WorkerDied


@dataclass(frozen=True)
class Later(Generic[Result]):
    """What a task's function returns where nothing but waiting is left, as for a disk: `finish` waits, and gives the result.

    That is done in a thread while the next task is computed. It is told what to call as soon as it has let go of what it holds
    much memory for.
    """

    finish: Callable[[Callable[[], None]], Result]


Work = Callable[[Task], Result | Later[Result]]
"""What is done to tasks."""


LATER_AT_ONCE = 4
"""Results of one process that may be waited for at once: a disk takes several files in about the time of one."""

HELD_AT_ONCE = 2
"""Of those, as many may hold much memory, such as maps that are still to be written: more do not make the disk faster."""


class Pending(Generic[Result]):
    """A result that is there, or comes from a thread: what a `Future` is, in a tenth of its calls, as every frame has one.

    Once it is `there`, `error` is what was raised in its place, if anything was.
    """

    __slots__ = ("_finish", "_held", "_result", "error", "there")

    def __init__(self, finish: Callable[[], Result]) -> None:
        self._finish: Callable[[], Result] | None = finish
        self._result: Result
        self.error: Exception | None = None
        self.there, self._held = False, threading.Lock()
        self._held.acquire()

    def finish(self) -> None:
        """Get the result, or what is raised in its place; afterwards nothing is kept of what it was made from."""
        assert self._finish is not None
        try:
            self._result = self._finish()
        except Exception as error:  # noqa: BLE001  (it is raised where the result is asked for)
            self.error = error
        self._finish, self.there = None, True
        self._held.release()

    def result(self) -> Result:
        """Wait for the result and return it; raises what was raised in its place."""
        if not self.there:
            with self._held:
                pass
        if self.error is not None:
            raise self.error
        return self._result


class Finisher:
    """Finishes results in threads, `LATER_AT_ONCE` at a time; leaving waits for all that were begun, after an error only for
    those at it.

    No thread is started before a result is to be waited for: a process that has threads must not fork.

    Args:
        then: called by a thread when it has finished a result.
    """

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        self._then = then
        self._waiting = SimpleQueue[Pending[Any] | None]()
        self._threads: list[threading.Thread] = []
        self._room = threading.Semaphore(HELD_AT_ONCE)

    def begin(self, result: Result | Later[Result], /) -> Pending[Result]:
        """Return where the result will be; one that needs no waiting is there. While too many hold much memory, this waits."""
        if not isinstance(result, Later):
            return _there(lambda: result)
        self._room.acquire()
        pending = Pending(partial(_finished, result, self._room.release))
        self._waiting.put(pending)
        if len(self._threads) < LATER_AT_ONCE:
            self._threads.append(threading.Thread(target=self._work))
            self._threads[-1].start()
        return pending

    def attempt(self, function: Work[Task, Result], task: Task, /) -> Pending[Result]:
        """Do a task; return where its result will be, or the exception that it raised."""
        found: Pending[Result | Later[Result]] = _there(lambda: function(task))
        return cast("Pending[Result]", found) if found.error else self.begin(found.result())

    def _work(self) -> None:
        while (pending := self._waiting.get()) is not None:
            pending.finish()
            # while the next one is waited for, nothing is kept of this one
            del pending
            self._then()

    def __enter__(self) -> "Finisher":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            with suppress(Empty):
                while True:
                    self._waiting.get_nowait()
        for _ in self._threads:
            self._waiting.put(None)
        for thread in self._threads:
            # a signal may have come before the last one was started
            if thread.is_alive():
                thread.join()


def _finished(later: Later[Result], let_go: Callable[[], None]) -> Result:
    """Return what comes of waiting; by then at the latest it has let go."""
    with ExitStack() as held:
        held.callback(let_go)
        return later.finish(held.close)


def _there(finish: Callable[[], Result]) -> Pending[Result]:
    pending = Pending(finish)
    pending.finish()
    return pending
