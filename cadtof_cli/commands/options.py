"""Options, made from settings records, which hold types, defaults and choices; and the paths that are the INPUT of a command."""

import functools
import itertools
import os
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import click
from click.core import ParameterSource

from cadtof_cli.commands.terminal import note
from cadtof_cli.commands.values import (
    FRAME_RANGE,
    PATH,
    TWO_PIXELS,
    NumberTuple,
    ParamType,
)
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.cores import available_cores
from cadtof_cli.execution.workers import JOBS_PER_CORE, Workers

Function = TypeVar("Function", bound=Callable[..., Any])

Decorator = Callable[[Function], Function]

STDIN = "-"
"""The argument that stands for paths on stdin."""

_UNITS = {"-ns": "NS", "-v": "V", "-px": "PX", "-m": "M", "-deg": "DEG", "-hz": "HZ"}
"""Endings of option names that say a unit, each with the placeholder of such a value in the help."""

_TYPES: dict[Any, ParamType] = {
    bool: click.BOOL,
    int: click.INT,
    float: click.FLOAT,
    str: click.STRING,
    slice: FRAME_RANGE,
    Path: PATH,
    tuple[int, int, int, int]: TWO_PIXELS,
}


_type_hints = functools.cache(get_type_hints)


def _names_of(option: str) -> tuple[str, ...]:
    """Return the names of an option: first with its unit, as in the settings record, then without the unit."""
    plain = next((option.removesuffix(unit) for unit in _UNITS if option.endswith(unit)), option)
    return tuple(dict.fromkeys((option, plain)))


def metavar_of(name: str, kind: ParamType, /) -> str | None:
    """Return the placeholder of an option's value in the help, or None if click's own is good.

    It is the unit, N for a whole number, or X for another number. For several numbers, it is repeated once per number.
    """
    if kind is click.INT:
        return "N"
    unit = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "X")
    if isinstance(kind, NumberTuple):
        return f"{unit},{unit}…" if kind.count is None else ",".join([unit] * kind.count)
    return unit if kind is click.FLOAT else None


def setting_option(
    record: Any,
    name: str,
    /,
    help: str,
    *,
    option: str = "",
    choices: Sequence[str] = (),
    show_default: bool = True,
    **more: Any,
) -> Decorator[Any]:
    """Return the option for one field of a settings record, with the type, choices and default of the field.

    Args:
        record: dataclass of the settings.
        name: of the field, and of the parameter that the command receives.
        help: what the option does.
        option: names as typed, such as `-j --jobs`. If empty, the name of the field, with its unit and without.
        choices: allowed values, if the type of the field does not list them.
        show_default: whether the help shows the default, if there is one.
        more: other arguments of `click.option`, such as `metavar`; they override what follows from the record.
    """
    field = record.__dataclass_fields__[name]
    default = field.default if field.default_factory is MISSING else field.default_factory
    kind = _type_of(_type_hints(record)[name])
    dashed = name.replace("_", "-")
    derived = {
        "type": click.Choice(choices) if choices else kind,
        "metavar": metavar_of(f"-{dashed}", kind),
        "show_default": show_default and not callable(default) and default not in {None, MISSING},
        # None instead of False: with False, click would accept the option without its value
        "is_flag": isinstance(default, bool) or None,
        "help": help,
    }
    # click would take None as the default, and would not ask for the required option
    derived |= {"required": True} if default is MISSING else {"default": as_typed(default)}
    names = option.split() or _names_of(f"--{dashed}")
    return click.option(*names, name, **(derived | more))


def plain_option(
    name: str, kind: ParamType, help: str, /, *, option: str = "", metavar: str | None = None
) -> Decorator[Any]:
    """Return an option whose type is not taken from a settings record.

    Args:
        name: of the parameter that the command receives.
        kind: type of the value.
        help: what the option does.
        option: name as typed. If it ends with a unit, such as `--distance-m`, the option has a second name without the unit. If
            empty, it follows from `name`.
        metavar: placeholder of the value in the help; None: it follows from option and type.
    """
    option = option or f"--{name.replace('_', '-')}"
    return click.option(*_names_of(option), name, type=kind, metavar=metavar or metavar_of(option, kind), help=help)


def jobs_option(help: str, /) -> Decorator[Any]:
    """Return the option `--jobs`. If a user asks for more processes than are ever started, it says so and lowers the number."""

    def limited(_ctx: click.Context, _param: click.Parameter, jobs: int) -> int:
        # a small number is allowed on every machine, so the cores need not be counted
        most = JOBS_PER_CORE * available_cores() if jobs > JOBS_PER_CORE else jobs
        if jobs > most:
            note(f"--jobs {jobs}: at most {most} processes are started, {JOBS_PER_CORE} per core")
        return min(jobs, most)

    help = f"{help}, never more than {JOBS_PER_CORE} per core.  [default: one for each core that cadtof may use]"
    return setting_option(Workers, "jobs", help, option="-j --jobs", callback=limited)


def _type_of(hint: Any) -> ParamType:
    """Return the type of an option for a field's type hint. `| None`, for an option that is not given, does not change it."""
    (hint,) = [one for one in get_args(hint) if one is not NoneType] if NoneType in get_args(hint) else [hint]
    if get_origin(hint) is Literal:
        return click.Choice(get_args(hint))
    if hint in _TYPES:
        return _TYPES[hint]
    return NumberTuple(None if ... in get_args(hint) else len(get_args(hint)))


def as_typed(default: Any) -> Any:
    """Return a default as it would be typed."""
    if isinstance(default, tuple):
        return ",".join(f"{item:g}" for item in default)
    if isinstance(default, float):
        return f"{default:.15g}"
    return default


class RecordOptions:
    """A decorator that adds options, in their order, and passes their values to the command as one record.

    Args:
        name: of the command's parameter that receives the record.
        record: called with the values of the options as keyword arguments.
        options: made by `click.option` or `setting_option`; or a `RecordOptions`, for a record within the record. If
            there are none, the options are those of the fields declared by `records.setting`.
    """

    def __init__(self, name: str, record: Callable[..., Any], /, *options: Decorator[Any]) -> None:
        self.name, self._record, self._options = name, record, options or tuple(declared_options(record).values())

    def __call__(self, function: Function, /) -> Function:
        """Return the command with the options."""
        taken: list[str] = []

        @functools.wraps(function)
        def command(*arguments: Any, **values: Any) -> Any:
            given = {one: values.pop(one) for one in reversed(taken)}
            return function(*arguments, **{self.name: self._record(**given)}, **values)

        with_options: Any = command
        for option in reversed(self._options):
            with_options = option(with_options)
            within = isinstance(option, RecordOptions)
            taken.append(option.name if within else with_options.__click_params__[-1].name)
        return cast("Function", with_options)

    def names(self) -> tuple[str, ...]:
        """Return the names that click gives the parameters of the options, in their order."""
        return tuple(parameter.name for parameter in reversed(self(lambda: None).__dict__["__click_params__"]))


def declared_options(record: Any, /) -> dict[str, Decorator[Any]]:
    """Return, by name, the options of the fields that `records.setting` declares in a record; inherited fields last."""
    ordered = sorted(fields(record), key=lambda one: one.name not in record.__annotations__)
    return {one.name: setting_option(record, one.name, **one.metadata) for one in ordered if "help" in one.metadata}


def given_options(names: Collection[str], /) -> Iterator[str]:
    """Yield those options that were typed, as the help writes them; only options whose parameters have these names."""
    context = click.get_current_context()
    for param in context.command.params:
        if param.name in names and context.get_parameter_source(param.name) == ParameterSource.COMMANDLINE:
            # a switch that was turned off has another name, such as --no-first-phasor
            is_off = param.secondary_opts and context.params.get(param.name) is False
            yield (param.secondary_opts if is_off else param.opts)[-1]


def note_given(names: Collection[str], where: str, /) -> None:
    """Say on stderr which options with these parameters were typed though they have no effect `where`, as "with --solver lm"."""
    for option in given_options(names):
        note(f"{option}: has no effect {where}")


def refuse_given(names: Collection[str], where: str, /) -> None:
    """Raise SettingsError if an option with these parameters was typed though it has no effect `where`."""
    for option in given_options(names):
        raise SettingsError(f"{option}: has no effect {where}; leave it out")


def null_option() -> Decorator[Any]:
    """Return the option `null` of `arriving_paths`."""
    about = "Paths on stdin are separated by zero bytes, as `find -print0` writes them."
    return click.option("-0", "--null", is_flag=True, help=about)


def input_paths(values: tuple[str, ...], /, *, null: bool) -> tuple[Path, ...]:
    """Return the paths that the arguments name; `-` stands for paths on stdin. `null`: see `arriving_paths`."""
    return tuple(itertools.chain.from_iterable(arriving_paths(values, null=null)))


def arriving_paths(values: tuple[str, ...], /, *, null: bool) -> Iterator[tuple[Path, ...]]:
    """Yield batches of paths: the paths that the arguments name, and those that arrive on stdin if one argument is `-`.

    Paths on stdin end with a new line, or with a zero byte if `null`.

    The first batch holds the named paths and the paths that arrive before the first pause, or, if none of these exists, before
    the pause after one that does: a program that watches a folder also names files that are gone a moment later. The common
    folder of the captures, and so the tree of folders in OUT, follows from this batch.
    """
    named = tuple(Path(value) for value in values if value != STDIN)
    if STDIN not in values:
        note_given({"null"}, f"without {STDIN} as INPUT")
        yield named
        return
    from cadtof_cli.commands.arrival import paths_as_they_arrive

    arriving = paths_as_they_arrive(sys.stdin.fileno(), separator=b"\0" if null else b"\n")
    first = named
    for batch in arriving:
        first += batch
        if any(map(os.path.lexists, first)):
            break
    if not first:
        raise click.UsageError("no paths arrived on stdin; expected one path per line")
    yield first
    yield from arriving
