"""Values of options as they are typed: numbers, names, frames, pixels, paths of light, grids."""

import math
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.errors import SettingsError, require

if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    # generic at run time only in the newest releases of click
    ParamType = click.ParamType

MOST_VALUES = 10_000
"""Largest number of values in a grid."""

_FORMS = "1,2,5 or start:stop:n or log:start:stop:n"


PATH = click.Path(path_type=Path)
"""A file or folder that need not exist."""

INPUT = click.Path(readable=False)
"""A path as it was typed, so that `-` may stand for stdin; whether it can be read is seen when its turn comes."""


class Typed(ParamType):
    """The type of an option whose typed text `parse` turns into a value. A value that is no text, such as a default, stays.

    `name` is the placeholder in the help; `what` describes a value by an example, for the message if `parse` raises ValueError.
    """

    def __init__(self, name: str, what: str, parse: Callable[[str], Any]) -> None:
        self.name, self._what, self._parse = name, what, parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value of a typed text."""
        try:
            return self._parse(value) if isinstance(value, str) else value
        except ValueError:
            self.fail(f"{value!r} is not {self._what}", param, ctx)


def _parted(text: str, separator: str, kind: Callable[[str], Any], count: int) -> tuple[Any, ...]:
    parts = tuple(map(kind, text.split(separator)))
    if len(parts) != count:
        raise ValueError(f"{len(parts)} parts")
    return parts


def _frames(text: str) -> slice:
    first, colon, last = text.partition(":")
    # no capture has more frames than numpy can count
    start, end = (min(int(part or 0), sys.maxsize - 1) for part in (first, last))
    stop = start + 1 if not colon else end if last else None
    if start < 0 or (stop is not None and stop <= start):
        raise ValueError("no such frames")
    return slice(start, stop)


NUMBERS = Typed("N,N…", "a list of numbers such as 40,20", lambda text: list(map(float, text.split(","))))

ONE_OR_MORE_NUMBERS = Typed(
    "N|N,N…",
    "a number, or a list of numbers such as 1e5,5e4",
    lambda text: list(map(float, text.split(","))) if "," in text else float(text),
)

FRAME_RANGE = Typed("A:B", "a range of frames such as 10:20, 10: or 7, counted from 0", _frames)
"""A range of frames counted from 0, such as 10:20, whose end is not part of it; or a single frame."""

TWO_PIXELS = Typed(
    "X0,Y0,X1,Y1", "two pixels X0,Y0,X1,Y1 such as 40,30,280,210", lambda text: _parted(text, ",", int, 4)
)
"""Two corners of a rectangle of pixels, or the ends of a line."""

PIXEL_PLACE = Typed("X,Y", "a column and a row such as 160,120", lambda text: _parted(text, ",", int, 2))

FURTHER_PATH = Typed("RATIO@NS", "a ratio and a time in ns such as 0.2@27", lambda text: _parted(text, "@", float, 2))
"""Photons of a path over the laser photons, and its arrival time in ns."""

# no message is needed: every text is such a list
NAMES = Typed("NAME,NAME", "", lambda text: text.split(","))

NUMBERED_NAMES = Typed(
    "NAME=N,NAME=N…",
    "a list of names with numbers such as 25=1,50=2",
    lambda text: {name: int(number) for name, number in (word.rsplit("=", 1) for word in text.split(","))},
)


class NumberTuple(Typed):
    """The type of an option that takes `count` numbers; with None, any number of them."""

    def __init__(self, count: int | None = None) -> None:
        super().__init__("N,N…", "a list of numbers such as 40,20", lambda text: tuple(map(float, text.split(","))))
        self.count = count

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of numbers; raises SettingsError if there are more or fewer than `count`."""
        numbers = super().convert(value, param, ctx)
        if self.count not in {None, len(numbers)}:
            told = f" ({param.metavar})" if param is not None and param.metavar else ""
            option = param.opts[-1] if param is not None else self.name
            raise SettingsError(f"{option}: found {len(numbers)}, expected {self.count} values{told}")
        return numbers


def grid_from_text(text: str, /, *, name: str) -> tuple[float, ...]:
    """Return the numbers of `1,2,5` (a list), `1:6:11` (11 even steps) or `log:1e3:1e5:5` (5 even ratios).

    Raises:
        SettingsError: the text is none of these, or stands for no numbers; the message begins with `name`, the option.
    """
    # imported here, so that printing the help does not load numpy
    import numpy as np

    def number(part: str) -> float:
        value = math.nan
        with suppress(ValueError):
            value = float(part)
        if not math.isfinite(value):
            raise SettingsError(f"{name}: found {part!r} in {text!r}, expected a number in {_FORMS}")
        return value

    kind, _, rest = text.partition(":") if text.startswith("log:") else ("", "", text)
    parts = rest.split(":")
    if len(parts) == 1 and not kind:
        values = tuple(map(number, rest.split(",")))
        if len(set(values)) != len(values):
            raise SettingsError(f"{name}: found {text!r}, which contains a value twice, expected each once")
        return values
    require(len(parts) == 3, name, repr(text), _FORMS)
    start, stop = map(number, parts[:2])
    count = 0
    with suppress(ValueError):
        count = int(parts[2])
    if not 1 <= count <= MOST_VALUES:
        raise SettingsError(f"{name}: found {parts[2]!r} steps in {text!r}, expected 1 to {MOST_VALUES}")
    require((count == 1) == (start == stop), name, repr(text), "two ends that differ and 2 steps or more")
    require(not kind or (start > 0 and stop > 0), name, repr(text), "ends above 0 for a log grid")
    spaced = np.geomspace if kind else np.linspace
    return tuple(float(value) for value in spaced(start, stop, count))
