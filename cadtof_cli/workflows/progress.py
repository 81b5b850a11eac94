"""What a workflow tells while it goes on; a command shows it, a caller in Python may ignore it."""

from typing import Protocol


class Progress(Protocol):
    """Told of each step of a workflow."""

    def total(self, count: int, /) -> None:
        """There are `count` steps, as far as is known."""

    def advance(self) -> None:
        """One step is done."""

    def say(self, message: str, /) -> None:
        """Something that the user should know."""


class _NoProgress:
    """Progress that nobody is told of."""

    def total(self, count: int, /) -> None:
        """Do nothing."""

    def advance(self) -> None:
        """Do nothing."""

    def say(self, message: str, /) -> None:
        """Do nothing."""


NO_PROGRESS: Progress = _NoProgress()
