"""Kinds and checks of the values in `capture.toml`, and the messages for values that fail them."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from cadtof_cli.errors import MetadataError
from cadtof_cli.units import shortened

Kind = Literal[
    "number",
    "whole number",
    "numbers",
    "number or numbers",
    "whole numbers",
    "pair",
    "text",
    "names",
    "numbers by name",
]

MOST_LETTERS = 200
"""Most letters of a value that a message shows."""


_BEYOND_FLOAT = 2**1023
"""Whole numbers of this size or more may be too large for a float."""

_EXPECTED: dict[Kind, str] = {
    "number": "a number",
    "whole number": "a whole number",
    "text": "a string",
    "numbers": "a list of numbers",
    "number or numbers": "a number, or a list of numbers",
    "whole numbers": "a list of whole numbers",
    "pair": "a list of two numbers",
    "names": "a list of two names",
    "numbers by name": 'whole numbers by name, such as { "25" = 1, "50" = 2 }',
}


class InvalidValueError(MetadataError):
    """A value that its key cannot have, and the values that are allowed, in words.

    `where` is the file or option that gave the value; empty: not known. A caller that knows it raises the error again
    with it.
    """

    def __init__(self, key: str, found: object, expected: str, where: str = "") -> None:
        super().__init__(key, found, expected, where)
        self.key, self.found, self.expected, self.where = key, found, expected, where

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{place}{self.key}: found {shortened(shown(self.found), MOST_LETTERS)}, expected {self.expected}"


def shown(value: object, /) -> str:
    """Return a value as text: true, false and lists as in `capture.toml`, numbers by name in braces."""
    match value:
        case bool():
            return repr(value).lower()
        case (tuple(), *_) if isinstance(value, tuple):
            return repr(dict(value))
        case tuple():
            return repr(list(value))
    return repr(value)


def converted(kind: Kind, value: Any, /) -> Any:
    """Return a value from TOML or the command line in the type that the records hold.

    Raises:
        TypeError: the value is not of this kind; the message is the expected kind, in words.
    """
    match kind, value:
        case ("number" | "number or numbers", int() | float()) if not isinstance(value, bool) and (
            type(value) is float or abs(value) < _BEYOND_FLOAT
        ):
            return float(value)
        case ("whole number", int()) | ("text", str()) if not isinstance(value, bool):
            return value
        case ("whole numbers", [_, *_]):
            whole = (int(item) if isinstance(item, float) and item.is_integer() else item for item in value)
            return tuple(converted("whole number", item) for item in whole)
        case ("numbers" | "number or numbers", [_, *_]) | ("pair", [_, _]):
            return tuple(converted("number", item) for item in value)
        case ("names", [_, _]):
            return tuple(converted("text", item) for item in value)
        case ("numbers by name", Mapping()) if value:
            return tuple((str(name), converted("whole number", number)) for name, number in value.items())
    raise TypeError(_EXPECTED[kind])


class Check(NamedTuple):
    """A condition on a value.

    Attributes:
        holds: whether a value meets the condition.
        expected: the condition in words, for a message.
        found: the part of a bad value that a message shows.
    """

    holds: Callable[[Any], bool]
    expected: str
    found: Callable[[Any], object] = lambda value: value


def above(least: float, /) -> Check:
    """Return the check that a number is finite and greater than `least`."""
    return Check(lambda value: math.isfinite(value) and value > least, f"a finite number above {least}")


def within(least: float, most: float, /) -> Check:
    """Return the check that the magnitude of a number lies between two limits, limits included."""
    return Check(lambda value: least <= abs(value) <= most, f"a number from {least:g} to {most:g}")


POSITIVE = above(0)

COUNT = within(0.0, 1e15)
LENGTH = within(1e-3, 1e9)
PERIOD = within(1e-3, 1e9)
VOLTS = within(1e-6, 1e6)
SCALE = within(1e-15, 1e6)
"""Checks with limits far beyond the values of any camera; outside them, squares of numbers may overflow."""


def each(check: Check, /) -> Check:
    """Return the check that all items of a list pass `check`."""
    return Check(
        lambda values: all(map(check.holds, values)),
        check.expected,
        lambda values: next(value for value in values if not check.holds(value)),
    )


def one_or_each(check: Check, /) -> Check:
    """Return the check that a number passes `check`, or that all numbers of a list do."""
    several = each(check)
    return Check(
        lambda value: several.holds(value) if isinstance(value, tuple) else check.holds(value),
        check.expected,
        lambda value: several.found(value) if isinstance(value, tuple) else value,
    )


def _is_sample_type(dtype: str) -> bool:
    # imported here, because commands that only print their options do not need numpy
    import numpy as np

    from cadtof_cli.files.frames import SAMPLE_TYPES

    try:
        return np.dtype(dtype).name in SAMPLE_TYPES
    except (TypeError, ValueError, SyntaxError):
        # SyntaxError: numpy parses texts with commas and brackets as structured types
        return False


def _names_planes(pattern: str) -> bool:
    parts = sorted(re.findall(r"\{(.*?)\}", pattern))
    return parts in (["channel", "harmonic"], ["channel", "frame", "harmonic"]) and not pattern.startswith("/")


SAMPLE_TYPE = Check(_is_sample_type, "a type such as uint16, >u2 or float32")

PLANE_PATTERN = Check(
    _names_planes,
    "a file name with {frame}, {harmonic} and {channel} once each and nothing else in braces; a lone frame needs no {frame}",
)
