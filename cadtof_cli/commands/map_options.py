"""The options that decide what maps are: those of `cadtof resolve` that other commands take too."""

from typing import Any

from cadtof_cli.commands.options import Decorator, RecordOptions, declared_options
from cadtof_cli.frame_plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.resolve.settings import ResolveSettings

_RESOLVER, _MAPS = declared_options(ResolverSettings), declared_options(MapSettings)

PATH_OPTIONS = tuple(option for name, option in _RESOLVER.items() if name not in {"mpi_model", "seed"})
"""How the phasors of a pixel become its paths: of recorded pixels and of simulated ones."""


def map_options(*without: str) -> RecordOptions:
    """Return the options that decide what maps are, but for some; they arrive as `maps`."""
    own = (option for name, option in _MAPS.items() if name not in without)
    return RecordOptions("maps", MapSettings, RecordOptions("resolver", ResolverSettings), *own)


def calibration_option() -> Decorator[Any]:
    """Return the option that names a calibration."""
    return declared_options(ResolveSettings)["calibration"]
