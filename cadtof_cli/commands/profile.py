"""`cadtof profile`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import RecordOptions, note_given
from cadtof_cli.commands.terminal import Bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.workflows.inspect.profile import ProfileSettings, profile_table, read_profile, write_profile


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof profile maps --row 120 --truth sample_data/corner/truth.exr -o profile.png",
    ),
)
@click.argument("maps", nargs=-1, required=True, type=PATH, metavar="MAPS...")
@click.option(
    "-o",
    "--out",
    type=PATH,
    help="Picture (.png, .svg, .pdf, .jpg) or table (.csv) to write.  [default: a table on stdout]",
)
@RecordOptions("settings", ProfileSettings)
def profile(*, maps: tuple[Path, ...], settings: ProfileSettings, out: Path | None) -> None:
    """Show the cross-section of maps along a line, with ± 1 predicted sigma, the first phasor and truth.

    MAPS are map files or folders that `cadtof resolve` wrote; one map of each folder is shown. All maps are drawn into
    one picture; they must show the same pixels of their frames.
    """
    if settings.layer != DIRECT_DEPTH:
        note_given({"first_phasor"}, f"with --layer {settings.layer}")
    if out is None:
        note_given({"overwrite"}, "without -o")
    found = read_profile(maps, settings=settings, progress=Bar())
    if out is None:
        tell(*profile_table(found).rstrip("\n").split("\n"))
        return
    write_profile(found, out, overwrite=settings.overwrite)
    tell(out)
