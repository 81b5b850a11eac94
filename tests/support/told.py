"""Progress that is counted."""


class Told:
    """How many steps there were to be, and how many were told of."""

    expected = steps = 0

    def total(self, count: int, /) -> None:
        self.expected = count

    def advance(self) -> None:
        self.steps += 1

    def say(self, message: str, /) -> None:
        raise AssertionError(message)
