"""What must hold for a value of `capture.toml`, and what is said where it does not."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

_MOST_LETTERS = 200
"""Letters of a value that a message shows."""


def shortened(found: object, /) -> str:
    """Return a value as Python writes it, without its middle where it is too long for a message."""
    text = repr(found)
    return text if len(text) <= _MOST_LETTERS else f"{text[: _MOST_LETTERS // 2]} … {text[-_MOST_LETTERS // 2 :]}"


class Check(NamedTuple):
    """What must hold for a value, what is expected where it does not, and what is then said to have been found."""

    holds: Callable[[Any], bool]
    expected: str
    found: Callable[[Any], object] = lambda value: value


def above(least: float, /) -> Check:
    """Return the check of a finite number above another."""
    return Check(lambda value: math.isfinite(value) and value > least, f"a finite number above {least}")


def within(least: float, most: float, /) -> Check:
    """Return the check of a magnitude."""
    return Check(lambda value: least <= abs(value) <= most, f"a number from {least:g} to {most:g}")


POSITIVE = above(0)

COUNT, LENGTH, PERIOD, VOLTS, SCALE = (
    within(*limits) for limits in ((0.0, 1e15), (1e-3, 1e9), (1e-3, 1e9), (1e-6, 1e6), (1e-15, 1e6))
)
"""Limits far beyond what any camera has; squares of numbers outside may overflow."""


def each(check: Check, /) -> Check:
    """Return the check of a list whose items pass one."""
    return Check(
        lambda values: all(map(check.holds, values)),
        check.expected,
        lambda values: next(value for value in values if not check.holds(value)),
    )
