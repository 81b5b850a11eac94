"""`cadtof report`."""

from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.options import gathered, setting_option
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.workflows.inspect.report import ReportSettings, write_report


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof report maps -o report.html --truth sample_data/corner/truth.exr",
    )
)
@click.argument("maps", type=click.Path(path_type=Path), metavar="OUT")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), metavar="PAGE.html", help="Page to write.")
@gathered(
    "settings",
    ReportSettings,
    setting_option("--truth", ReportSettings, help="File with a layer direct.depth: truth and errors are shown too."),
    setting_option(
        "--max-size-mb",
        ReportSettings,
        metavar="MB",
        help="Size of the page; where it cannot hold all pixels of all frames, most frames keep every n-th.",
    ),
    setting_option(
        "--full-frames",
        ReportSettings,
        metavar="N",
        help="Frames that keep all pixels, whatever that takes.  [default: as many as half of the size holds]",
    ),
    setting_option(
        "--focal-length-px",
        ReportSettings,
        metavar="F",
        help="Focal length, for the points.  [default: as run.json says]",
    ),
    setting_option(
        "--principal-point-px",
        ReportSettings,
        metavar="X,Y",
        help="Column and row of the optical axis.  [default: as run.json says, else the middle]",
    ),
    setting_option("--overwrite", ReportSettings, help="Replace a page that is there."),
)
def report(maps: Path, out: Path, settings: ReportSettings) -> None:
    """Write the page of a run: one HTML file that needs no network and no other file.

    OUT is the folder that `cadtof resolve` wrote, or one map file. The page holds settings, totals, failures with their reasons
    and a thumbnail of every frame; a viewer of all layers (point at a pixel for its values, drag a line for a profile, drag the
    ends of the colours, lay status bits over the map, slide between the first phasor and what was resolved); and the points in
    space. Maps are rounded to 16 bits, and the page says what that loses. Tables can be read where scripts are off.
    """
    with progress_bar("reading", "maps", quiet=False) as bar:
        write_report(maps, out, settings=settings, progress=bar)
    tell(out)
