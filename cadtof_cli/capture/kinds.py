"""Kinds of values that a key of `capture.toml` may have: what TOML or the command line gives, as the records hold it."""

from collections.abc import Callable, Mapping
from typing import Any, Literal

Kind = Literal["number", "whole number", "numbers", "whole numbers", "pair", "text", "names", "numbers by name"]


def converted(kind: Kind, value: Any, /) -> Any:
    """Return a value as the records hold it; TypeError says what was expected."""
    return _CONVERTERS[kind](value)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("a number")
    try:
        return float(value)
    except OverflowError as error:
        raise TypeError("a number that is not larger than all others") from error


def _whole_number(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError("a whole number")
    return value


def _numbers(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise TypeError("a list of numbers")
    return tuple(_number(item) for item in value)


def _whole_numbers(value: Any) -> tuple[int, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise TypeError("a list of whole numbers")
    return tuple(_whole_number(int(item) if isinstance(item, float) and item.is_integer() else item) for item in value)


def _pair(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise TypeError("a list of two numbers")
    return _numbers(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a string")
    return value


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise TypeError("a list of two names")
    return tuple(map(_text, value))


def _numbers_by_name(value: Any) -> tuple[tuple[str, int], ...]:
    if not isinstance(value, Mapping) or not value:
        raise TypeError('whole numbers by name, such as { "25" = 1, "50" = 2 }')
    return tuple((str(name), _whole_number(number)) for name, number in value.items())


_CONVERTERS: dict[Kind, Callable[[Any], Any]] = {
    "number": _number,
    "whole number": _whole_number,
    "numbers": _numbers,
    "whole numbers": _whole_numbers,
    "pair": _pair,
    "text": _text,
    "names": _names,
    "numbers by name": _numbers_by_name,
}
