"""Grids of numbers as they are written on a command line."""

import math

import numpy as np

from cadtof_cli.errors import SettingsError

MOST_VALUES = 10_000

_FORMS = "1,2,5 or start:stop:n or log:start:stop:n"


def grid_from_text(text: str, /, *, name: str) -> tuple[float, ...]:
    """Return the numbers of `1,2,5` (a list), `1:6:11` (11 even steps) or `log:1e3:1e5:5` (5 even ratios).

    Args:
        text: as typed.
        name: of the option, for messages.

    Raises:
        SettingsError: the text is none of these, or stands for no numbers.
    """
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
