"""The options that determine the values in maps: those of the resolver and the maps, and one for each key of `capture.toml`.

`cadtof resolve` has them; other commands take some of them too.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cadtof_cli.capture.checks import Kind
from cadtof_cli.capture.metadata import KEYS, Key
from cadtof_cli.commands.options import Decorator, RecordOptions, as_typed, declared_options, note_given, plain_option
from cadtof_cli.commands.values import NAMES, NUMBERED_NAMES, NUMBERS, ONE_OR_MORE_NUMBERS, ParamType
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings

_RESOLVER, _MAPS = declared_options(ResolverSettings), declared_options(MapSettings)

_METAVARS = {
    "modulation.periods_ns": "NS,NS…",
    "modulation.waveform": "sine|triangle",
    "voltage.saturated_counts": "LOW,HIGH",
    "optics.principal_point_px": "X,Y",
    "optics.lamp_offset_m": "M,M,M",
}
"""Placeholders in the help for the values of those keys whose placeholder does not follow from kind and unit."""


def path_options(*without: str) -> RecordOptions:
    """Return the options that determine how phasors become paths, except those in `without`; as one record, `resolver`."""
    own = (option for name, option in _RESOLVER.items() if name not in without)

    def settings(**given: Any) -> ResolverSettings:
        made = ResolverSettings(**given)
        for name, where in made.without_effect.items():
            # `seed` of other commands is a seed of something else
            note_given({name}.intersection(given), where)
        return made

    return RecordOptions("resolver", settings, *own)


def map_options(*without: str) -> RecordOptions:
    """Return the options that determine the values in maps, except those in `without`; as one record, `maps`."""
    own = (option for name, option in _MAPS.items() if name not in without)

    def settings(**given: Any) -> MapSettings:
        made = MapSettings(**given)
        for name, where in made.without_effect.items():
            note_given({name}, where)
        note_given({"capture_distance_m"}, "on maps; `cadtof calibrate` uses it")
        return made

    return RecordOptions("maps", settings, path_options(), *own)


MAP_HEADING = {"Resolving options": ("calibration", *map_options().names())}
"""The heading of these options in the help of a command that takes them, and the names of their parameters."""


def capture_options(*without: str) -> RecordOptions:
    """Return a decorator that adds an option for every key of `capture.toml`, except for the dotted keys in `without`.

    The command receives the values that were given as `overrides`, by dotted key.
    """
    keys = tuple(key for key in KEYS.values() if key.path not in without)

    def overrides(**values: Any) -> Mapping[str, Any]:
        return {key.path: value for key, value in zip(keys, values.values(), strict=True) if value is not None}

    return RecordOptions("overrides", overrides, *map(_capture_option, keys))


def _capture_option(key: Key) -> Decorator[Any]:
    """Return the option of a key."""
    types: dict[Kind, ParamType] = {
        "number": click.FLOAT,
        "whole number": click.INT,
        "numbers": NUMBERS,
        "number or numbers": ONE_OR_MORE_NUMBERS,
        "whole numbers": NUMBERS,
        "pair": NUMBERS,
        "text": click.STRING,
        "names": NAMES,
        "numbers by name": NUMBERED_NAMES,
    }
    default = "" if key.default is None else f"  [if not given: {as_typed(key.default)}, the paper's]"
    about, metavar = f"{key.path}: {key.about}.{default}", _METAVARS.get(key.path)
    return plain_option(f"capture_{key.name}", types[key.kind], about, option=key.option, metavar=metavar)


CAPTURE_HEADING = {"Capture options (each overrides a key of capture.toml)": capture_options().names()}
"""The heading of these options in the help of a command that takes them, and the names of their parameters."""


def settings_option() -> Decorator[Any]:
    """Return the option that names a `capture.toml` in any folder."""
    return click.option(
        "--settings",
        "settings_file",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        metavar="FILE",
        help="Use this capture.toml for all captures, instead of the one beside the frames or in a folder above.",
    )
