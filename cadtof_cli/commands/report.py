"""`cadtof report`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import RecordOptions
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.workflows.inspect.report import ReportSettings, write_report


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof report maps -o report.html --truth sample_data/corner/truth.exr",
    ),
)
@click.argument("maps", type=PATH, metavar="OUT")
@click.option("-o", "--out", required=True, type=PATH, metavar="PAGE.html", help="Page to write.")
@RecordOptions("settings", ReportSettings)
def report(maps: Path, out: Path, settings: ReportSettings) -> None:
    """Write an HTML page about a run: one file that needs no network and no other file.

    OUT is the folder that `cadtof resolve` wrote, or one map file. The page shows the settings, totals, failures with their
    reasons, and thumbnails of the frames. Its viewer shows all layers: point at a pixel to read its values, drag a line for a
    profile, drag the ends of the colour scale, show status bits over the map, and slide between the first phasor and the
    resolved depth. A point cloud can be turned with the mouse. Maps are rounded to 16 bits; the page states the rounding error.
    The tables can be read without JavaScript.
    """
    with progress_bar("reading", "maps") as bar:
        write_report(maps, out, settings=settings, progress=bar)
    tell(out)
