"""`cadtof profile`."""

from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.options import Corners, gathered, setting_option
from cadtof_cli.commands.terminal import Bar, tell
from cadtof_cli.workflows.inspect.profile import ProfileSettings, profile_table, read_profile, write_profile


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof profile maps --row 120 --truth sample_data/corner/truth.exr -o profile.png",
    )
)
@click.argument("maps", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MAPS...")
@gathered(
    "settings",
    ProfileSettings,
    setting_option("--row", ProfileSettings, "row", metavar="Y", help="Along a row of pixels, from 0 at the top."),
    setting_option("--column", ProfileSettings, "column", metavar="X", help="Along a column, from 0 at the left."),
    click.option("--line", type=Corners(), help="From one pixel to another, whichever way the line runs."),
    setting_option("--layer", ProfileSettings, "layer", metavar="NAME", help="Layer of the maps."),
    setting_option("--frame", ProfileSettings, "frame", metavar="N", help="Which map of each folder; 0 is the first."),
    click.option(
        "--first-phasor/--no-first-phasor",
        default=True,
        help="Whether to show the depth of the first phasor alone, where the recorded frames are there.",
    ),
)
@click.option("--truth", type=click.Path(path_type=Path), help="File with the same layer: drawn too, with the errors.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help="Picture (.png, .svg, .pdf, .jpg) or table (.csv) to write.  [default: a table on stdout]",
)
@click.option("--overwrite", is_flag=True, help="Replace a file that is there.")
def profile(
    *, maps: tuple[Path, ...], settings: ProfileSettings, truth: Path | None, out: Path | None, overwrite: bool
) -> None:
    """Draw the cross-section of maps: runs overlaid, the band of ± 1 predicted sigma, the first phasor, truth.

    MAPS are folders that `cadtof resolve` wrote, of which one map each is drawn, and map files, all of the same size.
    """
    found = read_profile(maps, settings=settings, truth=truth, progress=Bar())
    if out is None:
        tell(profile_table(found).rstrip("\n"))
        return
    write_profile(found, out, overwrite=overwrite)
    tell(out)
