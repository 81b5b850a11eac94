"""The options that determine the values in maps. `cadtof resolve` has them; other commands take some of them too."""

from typing import Any

from cadtof_cli.commands.options import RecordOptions, declared_options, note_given
from cadtof_cli.pipeline.plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings

_RESOLVER, _MAPS = declared_options(ResolverSettings), declared_options(MapSettings)


def path_options(*without: str) -> RecordOptions:
    """Return the options that determine how phasors become paths, except those in `without`; as one record, `resolver`."""
    own = (option for name, option in _RESOLVER.items() if name not in without)

    def settings(**given: Any) -> ResolverSettings:
        made = ResolverSettings(**given)
        if made.solver != "lm":
            note_given({"starts", "seed"}.intersection(given), f"with --solver {made.solver}")
        if not made.may_be_diffuse((1, 2)) and made.mpi_model == "diffuse":
            note_given({"mpi_model"}, "with a --solver, --order, --paths or --return that asks for separate paths")
        if made.returns == "strongest":
            note_given({"min_return_ratio"}, "with --return strongest")
        return made

    return RecordOptions("resolver", settings, *own)


def map_options(*without: str) -> RecordOptions:
    """Return the options that determine the values in maps, except those in `without`; as one record, `maps`."""
    own = (option for name, option in _MAPS.items() if name not in without)
    return RecordOptions("maps", MapSettings, path_options(), *own)


MAP_HEADING = {"Resolving options": ("calibration", *map_options().names())}
"""The heading of these options in the help of a command that takes them, and the names of their parameters."""
