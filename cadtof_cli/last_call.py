"""What a function returned last, where it is asked the same for every frame."""

from collections.abc import Callable
from functools import update_wrapper
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def same_as_last(function: Callable[Parameters, Result], /) -> Callable[Parameters, Result]:
    """Return a function that returns once more what it returned last, where its arguments, by place, are equal.

    Nothing is hashed, which for a large record may take longer than what is remembered; that an argument is the very same object
    is seen at once.
    """
    last: list[tuple[tuple[object, ...], Result]] = []

    def remembered(*arguments: Parameters.args, **named: Parameters.kwargs) -> Result:
        # one list element is replaced at once, so threads see a whole pair
        for known, result in last:
            if known == arguments and not named:
                return result
        result = function(*arguments, **named)
        if not named:
            last[:] = [(arguments, result)]
        return result

    update_wrapper(remembered, function)
    return remembered
