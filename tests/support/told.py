"""Counts the progress that a function reports."""


class Told:
    """The number of steps that were announced, and the number that were reported."""

    expected = steps = 0

    def advance(self, steps: int = 1, /, *, total: int | None = None) -> None:
        self.expected = self.expected if total is None else total
        self.steps += steps

    def say(self, message: str, /) -> None:
        raise AssertionError(message)
