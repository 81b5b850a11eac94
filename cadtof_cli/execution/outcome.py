"""What comes of a task."""

from collections.abc import Callable
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
