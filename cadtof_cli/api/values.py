"""Values from a caller in Python → values for the fields of a settings record. Numbers of numpy count as numbers."""

import numbers
import operator
from collections.abc import Mapping
from types import NoneType
from typing import Any, get_args, get_origin

from cadtof_cli.errors import SettingsError


def as_declared(given: Mapping[str, Any], hints: Mapping[str, Any], /, *, of: str) -> dict[str, Any]:
    """Return values as the fields of a record declare them.

    Numbers and tuples of numbers are converted. All other values are left as they are, and the record checks them.

    Args:
        given: values by field name.
        hints: types of the fields by name.
        of: name of the record or function, for messages.

    Raises:
        SettingsError: a value is not of the declared type.
    """
    found = {}
    for name, value in given.items():
        kinds = get_args(hints[name]) if NoneType in get_args(hints[name]) else (hints[name],)
        kind = next(one for one in kinds if one is not NoneType)
        try:
            found[name] = None if value is None and NoneType in kinds else _converted(value, kind)
        except (TypeError, ValueError):
            raise SettingsError(f"{of}: found {name}={value!r}, expected {_in_words(kind)}") from None
    return found


def _converted(value: Any, kind: Any) -> Any:
    if kind in _NUMBERS and (isinstance(value, bool) or not isinstance(value, numbers.Real)):
        raise TypeError
    if kind is int:
        return operator.index(value)
    if kind is float:
        return float(value)
    if get_origin(kind) is tuple:
        first, *others = get_args(kind)
        items = tuple(_converted(item, first) for item in value)
        if ... not in others and len(items) != len(others) + 1:
            raise ValueError
        return items
    return value


_NUMBERS: dict[Any, tuple[str, str]] = {int: ("a whole number", "whole numbers"), float: ("a number", "numbers")}
"""Types of numbers in words: one value, and several values."""


def _in_words(kind: Any) -> str:
    if kind in _NUMBERS:
        return _NUMBERS[kind][0]
    first, *others = get_args(kind)
    return f"{'a list of' if ... in others else len(others) + 1} {_NUMBERS[first][1]}"
