"""Values of options as they are typed: numbers, names, frames, pixels, paths of light, grids."""

import math
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.errors import SettingsError

if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    # generic at run time only in the newest releases of click
    ParamType = click.ParamType

MOST_VALUES = 10_000
"""Of a grid."""

_FORMS = "1,2,5 or start:stop:n or log:start:stop:n"


class NumberList(ParamType):
    """Numbers with commas between them, such as 40,20."""

    name = "N,N…"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a list of numbers."""
        if not isinstance(value, str):
            return value
        try:
            return [float(part) for part in value.split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 40,20", param, ctx)


NUMBERS = NumberList()


class NumberTuple(NumberList):
    """As many numbers as a setting has, or, with None, any number of them."""

    def __init__(self, count: int | None = None) -> None:
        self.count = count

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of numbers."""
        numbers = tuple(super().convert(value, param, ctx))
        if self.count not in {None, len(numbers)}:
            told = f" ({param.metavar})" if param is not None and param.metavar else ""
            option = param.opts[-1] if param is not None else self.name
            raise SettingsError(f"{option}: found {len(numbers)} values, expected {self.count}{told}")
        return numbers


class FrameRange(ParamType):
    """Frames from 0, such as 10:20, with an end that does not count any more; or one place."""

    name = "A:B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a slice."""
        first, colon, last = value.partition(":")
        try:
            start, stop = int(first or 0), int(last) if last else None
        except ValueError:
            start, stop = -1, None
        if not colon:
            stop = start + 1
        if start < 0 or (stop is not None and stop <= start):
            self.fail(f"{value!r} is not a range of frames such as 10:20, 10: or 7, counted from 0", param, ctx)
        return slice(start, stop)


class Rectangle(ParamType):
    """Two corners of a rectangle of pixels: X0,Y0,X1,Y1."""

    name = "X0,Y0,X1,Y1"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return four whole numbers."""
        try:
            x0, y0, x1, y1 = map(int, value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not a rectangle of pixels such as 40,30,280,210", param, ctx)
        return x0, y0, x1, y1


class NameList(ParamType):
    """Words with commas between them, such as A,B; with `numbered`, each with its number, such as 25=1,50=2."""

    def __init__(self, *, numbered: bool) -> None:
        self.numbered, self.name = numbered, "NAME=N,NAME=N…" if numbered else "NAME,NAME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a list of names, or numbers by name."""
        if not isinstance(value, str):
            return value
        words = value.split(",")
        if not self.numbered:
            return words
        try:
            return {name: int(number) for name, number in (word.rsplit("=", 1) for word in words)}
        except ValueError:
            self.fail(f"{value!r} is not a list of names with numbers such as 25=1,50=2", param, ctx)


class PixelPlace(ParamType):
    """A column and a row, such as 160,120."""

    name = "X,Y"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the column and the row."""
        try:
            x, y = (int(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a column and a row such as 160,120", param, ctx)
        return x, y


class FurtherPath(ParamType):
    """Photons of a path over the laser's, and its arrival in ns, such as 0.2@27."""

    name = "RATIO@NS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return both numbers."""
        try:
            ratio, time_ns = map(float, value.split("@"))
        except ValueError:
            self.fail(f"{value!r} is not a ratio and a time in ns such as 0.2@27", param, ctx)
        return ratio, time_ns


def grid_from_text(text: str, /, *, name: str) -> tuple[float, ...]:
    """Return the numbers of `1,2,5` (a list), `1:6:11` (11 even steps) or `log:1e3:1e5:5` (5 even ratios).

    Args:
        text: as typed.
        name: of the option, for messages.

    Raises:
        SettingsError: the text is none of these, or stands for no numbers.
    """
    # numpy, which options that are only printed need not load
    import numpy as np

    kind, _, rest = text.partition(":") if text.startswith("log:") else ("", "", text)
    parts = rest.split(":")
    if len(parts) == 1 and not kind:
        values = [_number(part, text, name) for part in rest.split(",")]
        if len(set(values)) != len(values):
            raise SettingsError(f"{name}: found {text!r}, which contains a value twice, expected each once")
        return tuple(values)
    if len(parts) != 3:
        raise SettingsError(f"{name}: found {text!r}, expected {_FORMS}")
    start, stop = (_number(part, text, name) for part in parts[:2])
    count = _count(parts[2], text, name)
    if (count == 1) != (start == stop):
        raise SettingsError(f"{name}: found {text!r}, expected two ends that differ and 2 steps or more")
    if kind:
        if start <= 0 or stop <= 0:
            raise SettingsError(f"{name}: found {text!r}, expected ends above 0 for a log grid")
        return tuple(float(value) for value in np.geomspace(start, stop, count))
    return tuple(float(value) for value in np.linspace(start, stop, count))


def _number(part: str, text: str, name: str) -> float:
    try:
        value = float(part)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SettingsError(f"{name}: found {part!r} in {text!r}, expected a number in {_FORMS}")
    return value


def _count(part: str, text: str, name: str) -> int:
    try:
        count = int(part)
    except ValueError:
        count = 0
    if not 1 <= count <= MOST_VALUES:
        raise SettingsError(f"{name}: found {part!r} steps in {text!r}, expected 1 to {MOST_VALUES}")
    return count
