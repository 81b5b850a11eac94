"""What comes of a task, and threads that wait for what is left of it while the next one is computed."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Generic, TypeVar

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

    That is done in a thread while the next task is computed.
    """

    finish: Callable[[], Result]


Work = Callable[[Task], Result | Later[Result]]
"""What is done to tasks."""


LATER_AT_ONCE = 4
"""Results of one process that may be waited for at once: a disk takes several files in about the time of one."""


class Finisher(ThreadPoolExecutor):
    """Finishes results, `LATER_AT_ONCE` at a time; leaving waits for all that were begun, after an error only for those at it.

    No thread is started before a result is to be waited for: a process that has threads must not fork.
    """

    def begin(self, result: Result | Later[Result], /) -> Future[Result]:
        """Return where the result will be; one that needs no waiting is there."""
        if isinstance(result, Later):
            return self.submit(result.finish)
        future = Future[Result]()
        future.set_result(result)
        return future

    def attempt(self, function: Work[Task, Result], task: Task, /) -> Future[Result]:
        """Do a task; return where its result will be, or the exception that it raised."""
        try:
            return self.begin(function(task))
        except Exception as error:  # noqa: BLE001  (it is raised where the result is asked for)
            future = Future[Result]()
            future.set_exception(error)
            return future

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shutdown(cancel_futures=kind is not None)
