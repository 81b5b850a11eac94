"""What comes of a task, and threads that wait for what is left of it while the next one is computed."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import field
from queue import Empty, SimpleQueue
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


@dataclass(eq=False)
class Later(Generic[Result]):
    """What a task's function returns where nothing but waiting is left, as for a disk: `wait` waits, and gives the result.

    That is done in a thread while the next task is computed: what a `Future` is, in a tenth of its calls, as every frame has one.
    `wait` is told what to call as soon as it has let go of what it holds much memory for. Once the result is `there`, `error` is
    what was raised in its place, if anything was.
    """

    wait: Callable[[Callable[[], None]], Result]
    let_go: Callable[[], None] = lambda: None
    there: bool = False
    error: Exception | None = None
    _found: SimpleQueue[Result | None] = field(default_factory=SimpleQueue)

    def finish(self) -> "Later[Result]":
        """Wait, and keep the result or what is raised in its place, but nothing of what it was made from."""
        found = None
        with ExitStack() as held:
            held.callback(self.let_go)
            try:
                found = self.wait(held.close)
            except Exception as error:  # noqa: BLE001  (it is raised where the result is asked for)
                self.error = error
        del self.wait
        self.there = True
        self._found.put(found)
        return self

    def result(self) -> Result:
        """Wait until it is finished, and return the result, once; raises what was raised in its place."""
        found = self._found.get()
        if self.error is not None:
            raise self.error
        return cast("Result", found)


Work = Callable[[Task], Result | Later[Result]]
"""What is done to tasks."""


LATER_AT_ONCE = 4
"""Results of one process that may be waited for at once: a disk takes several files in about the time of one."""

HELD_AT_ONCE = 2
"""Results waited for at once that may hold much memory, such as maps still to be written: more do not make the disk faster."""


@dataclass(eq=False)
class Finisher:
    """Finishes results in threads, `LATER_AT_ONCE` at a time; see `finishing`.

    `then` is called by a thread when it has finished a result.
    """

    then: Callable[[], None]
    waiting: SimpleQueue[Later[Any] | None] = field(default_factory=SimpleQueue)
    threads: list[threading.Thread] = field(default_factory=list)
    room: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(HELD_AT_ONCE))

    def begin(self, result: Result | Later[Result], /) -> Later[Result]:
        """Return where the result will be; one that needs no waiting is there. While too many hold much memory, this waits."""
        if not isinstance(result, Later):
            return Later(lambda _: result).finish()
        self.room.acquire()
        result.let_go = self.room.release
        self.waiting.put(result)
        if len(self.threads) < LATER_AT_ONCE:
            self.threads.append(threading.Thread(target=self._work))
            try:
                self.threads[-1].start()
            except RuntimeError:
                # the system allows no more
                self.threads.pop()
        if not self.threads:
            self.waiting.get()
            result.finish()
        return result

    def attempt(self, function: Work[Task, Result], task: Task, /) -> Later[Result]:
        """Do a task; return where its result will be, or the exception that it raised."""
        found = Later(lambda _: function(task)).finish()
        return cast("Later[Result]", found) if found.error else self.begin(found.result())

    def _work(self) -> None:
        while (later := self.waiting.get()) is not None:
            later.finish()
            # while the next one is waited for, nothing is kept of this one
            del later
            self.then()


@contextmanager
def finishing(then: Callable[[], None] = lambda: None) -> Iterator[Finisher]:
    """Yield what finishes results; leaving waits for all that were begun, after an error only for those at it.

    No thread is started before a result is to be waited for: a process that has threads must not fork. Where the system allows
    none at all (`ulimit -u`, `ulimit -v`), results are finished where they are begun.
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
        for _ in finisher.threads:
            finisher.waiting.put(None)
        for thread in finisher.threads:
            # a signal may have come before the last one was started
            if thread.is_alive():
                thread.join()
