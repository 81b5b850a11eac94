"""`cadtof profile`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import example
from cadtof_cli.commands.options import RecordOptions, setting_option
from cadtof_cli.commands.terminal import Bar, tell
from cadtof_cli.commands.values import Rectangle
from cadtof_cli.workflows.inspect.profile import ProfileSettings, profile_table, read_profile, write_profile


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof profile maps --row 120 --truth sample_data/corner/truth.exr -o profile.png",
    )
)
@click.argument("maps", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MAPS...")
@RecordOptions(
    "settings",
    ProfileSettings,
    setting_option("--row", ProfileSettings, "row", metavar="Y", help="Along this row of pixels; 0 is the top."),
    setting_option("--column", ProfileSettings, "column", metavar="X", help="Along this column; 0 is the left."),
    click.option("--line", type=Rectangle(), help="Along a line from pixel X0,Y0 to pixel X1,Y1, in any direction."),
    setting_option("--layer", ProfileSettings, "layer", metavar="NAME", help="Layer to show."),
    setting_option("--frame", ProfileSettings, "frame", metavar="N", help="Which map of each folder; 0 is the first."),
    click.option(
        "--first-phasor/--no-first-phasor",
        default=True,
        help="Whether to show the depth of the first phasor alone; needs the recorded frames.",
    ),
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    help="File with the true values of the layer; they and the errors are drawn too.",
)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help="Picture (.png, .svg, .pdf, .jpg) or table (.csv) to write.  [default: a table on stdout]",
)
@click.option("--overwrite", is_flag=True, help="Replace the file if it exists.")
def profile(
    *, maps: tuple[Path, ...], settings: ProfileSettings, truth: Path | None, out: Path | None, overwrite: bool
) -> None:
    """Show the cross-section of maps along a line, with ± 1 predicted sigma, the first phasor and truth.

    MAPS are map files or folders that `cadtof resolve` wrote; one map of each folder is shown. All have the same size in pixels
    and are drawn into one picture.
    """
    found = read_profile(maps, settings=settings, truth=truth, progress=Bar())
    if out is None:
        tell(profile_table(found).rstrip("\n"))
        return
    write_profile(found, out, overwrite=overwrite)
    tell(out)
