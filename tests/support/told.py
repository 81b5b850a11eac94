"""Progress that is counted."""


class Told:
    """How many steps there were to be, and how many were told of."""

    expected = steps = 0

    def advance(self, steps: int = 1, /, *, total: int | None = None) -> None:
        self.expected = self.expected if total is None else total
        self.steps += steps

    def say(self, message: str, /) -> None:
        raise AssertionError(message)
