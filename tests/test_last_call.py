"""What a function returned last is returned once more for equal arguments, and for no others."""

import math
import threading

import pytest

from cadtof_cli.errors import SettingsError
from cadtof_cli.last_call import same_as_last


def test_the_same_question_is_answered_once() -> None:
    asked: list[tuple[int, ...]] = []

    @same_as_last
    def total(*numbers: int, start: int = 0) -> int:
        asked.append(numbers)
        return sum(numbers, start)

    assert [total(1, 2), total(1, 2), total(2, 1), total(1, 2), total(1, 2)] == [3] * 5
    assert asked == [(1, 2), (2, 1), (1, 2)]
    assert [total(1, 2, start=4), total(1, 2, start=5), total(1, 2)] == [7, 8, 3]
    assert len(asked) == 5
    assert total.__name__ == "total"


def test_the_very_same_object_is_not_compared() -> None:
    class Unlike:
        def __eq__(self, other: object) -> bool:
            raise AssertionError("compared")

        def __hash__(self) -> int:
            raise AssertionError("hashed")

    one = Unlike()
    kept = same_as_last(lambda thing, number: (thing, number))
    assert kept(one, math.nan) is kept(one, math.nan)


def test_an_error_is_not_an_answer() -> None:
    ways = iter([SettingsError("not yet"), None, SettingsError("never asked")])

    @same_as_last
    def answer(_: str) -> str:
        error = next(ways)
        if error is not None:
            raise error
        return "here"

    with pytest.raises(SettingsError):
        answer("a")
    assert answer("a") == answer("a") == "here"


def test_threads_that_ask_in_turns_get_their_own_answers() -> None:
    squared, wrong = same_as_last(lambda number: number * number), list[int]()

    def ask(number: int) -> None:
        wrong.extend(number for _ in range(3000) if squared(number) != number * number)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
