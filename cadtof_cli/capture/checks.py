"""Checks of the values of `capture.toml`, and what messages say where one fails."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

MOST_LETTERS = 200
"""Letters of a value that a message shows."""


class Check(NamedTuple):
    """A condition that values must meet, what a message then expects, and what it shows as found."""

    holds: Callable[[Any], bool]
    expected: str
    found: Callable[[Any], object] = lambda value: value


def above(least: float, /) -> Check:
    """Return the check that a number is finite and above another."""
    return Check(lambda value: math.isfinite(value) and value > least, f"a finite number above {least}")


def within(least: float, most: float, /) -> Check:
    """Return the check that a magnitude lies between two limits."""
    return Check(lambda value: least <= abs(value) <= most, f"a number from {least:g} to {most:g}")


POSITIVE = above(0)

COUNT, LENGTH, PERIOD, VOLTS, SCALE = (
    within(*limits) for limits in ((0.0, 1e15), (1e-3, 1e9), (1e-3, 1e9), (1e-6, 1e6), (1e-15, 1e6))
)
"""Limits far beyond what any camera has; squares of numbers outside may overflow."""


def each(check: Check, /) -> Check:
    """Return the check that all items of a list pass another."""
    return Check(
        lambda values: all(map(check.holds, values)),
        check.expected,
        lambda values: next(value for value in values if not check.holds(value)),
    )
