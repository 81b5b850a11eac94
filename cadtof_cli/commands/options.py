"""Options that several commands share: inputs, and what overrides `capture.toml`."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from cadtof_cli.capture.metadata import KEYS, Key, Kind

if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    # generic at run time only in the newest releases of click
    ParamType = click.ParamType

Function = TypeVar("Function", bound=Callable[..., Any])

CAPTURE_SECTION = "Capture options (each overrides a key of capture.toml)"

_UNITS = ("-ns", "-v", "-px", "-m")


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


class SectionedCommand(click.Command):
    """A command whose help shows the options that override `capture.toml` apart from its own."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command's own options, then the capture options."""
        own: list[tuple[str, str]] = []
        capture: list[tuple[str, str]] = []
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                (capture if isinstance(param, CaptureOption) else own).append(record)
        for title, records in (("Options", own), (CAPTURE_SECTION, capture)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class CaptureOption(click.Option):
    """An option that overrides one key of `capture.toml`."""


def capture_options(function: Function) -> Function:
    """Add an option for every key of `capture.toml`; they arrive as one mapping by dotted key, `overrides`."""
    return _with_options(function, KEYS)


def capture_options_without(*paths: str) -> Callable[[Function], Function]:
    """Add the same options but for keys, by dotted name, that a command has an option of its own for."""
    keys = tuple(key for key in KEYS if key.path not in paths)
    return lambda function: _with_options(function, keys)


def _with_options(function: Function, keys: Sequence[Key]) -> Function:
    def gathered(**arguments: Any) -> Any:
        overrides = {key.path: arguments.pop(_parameter(key)) for key in keys}
        return function(overrides={path: value for path, value in overrides.items() if value is not None}, **arguments)

    gathered.__doc__, gathered.__name__ = function.__doc__, function.__name__
    gathered.__click_params__ = getattr(function, "__click_params__", [])  # type: ignore[attr-defined]
    for key in reversed(keys):
        gathered = click.option(*_names(key), _parameter(key), cls=CaptureOption, type=_type(key), help=_help(key))(
            gathered
        )
    return gathered  # type: ignore[return-value]


def _names(key: Key) -> tuple[str, ...]:
    """Return the option with its unit, as the key has it, and without."""
    plain = next((key.option.removesuffix(unit) for unit in _UNITS if key.option.endswith(unit)), key.option)
    return (key.option,) if plain == key.option else (key.option, plain)


def _parameter(key: Key) -> str:
    return f"capture_{key.name}"


def _type(key: Key) -> ParamType:
    types: dict[Kind, ParamType] = {
        "number": click.FLOAT,
        "whole number": click.INT,
        "numbers": NumberList(),
        "pair": NumberList(),
        "text": click.STRING,
    }
    return types[key.kind]


def _help(key: Key) -> str:
    default = "" if key.default is None else f"  [if not given: {_shown(key.default)}, the paper's]"
    return f"{key.path}: {key.about}.{default}"


def _shown(value: Any) -> str:
    return ",".join(f"{item:g}" for item in value) if isinstance(value, tuple) else str(value)


def input_paths(values: tuple[str, ...]) -> tuple[Path, ...]:
    """Return the paths that the arguments name; `-` stands for paths on stdin, a line each."""
    paths: list[Path] = []
    for value in values:
        if value == "-":
            paths += [Path(line) for line in sys.stdin.read().splitlines() if line.strip()]
        else:
            paths.append(Path(value))
    if not paths:
        raise click.UsageError("no paths arrived on stdin; expected one a line")
    return tuple(paths)
