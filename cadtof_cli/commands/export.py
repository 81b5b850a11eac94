"""`cadtof export`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import RecordOptions, note_given
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.workflows.inspect.export import EXPORTS, ExportSettings, export_maps


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof export maps -o corner.ply",
        "cadtof export maps -o corner.png --depth z",
    ),
)
@click.argument("maps", nargs=-1, required=True, type=PATH, metavar="MAPS...")
@click.option(
    "-o",
    "--out",
    required=True,
    type=PATH,
    metavar=f"OUT{'|'.join(EXPORTS)}",
    help="File to write. With several maps, one file per map is written: the name of the map is added to the name of OUT.",
)
@RecordOptions("settings", ExportSettings)
def export(*, maps: tuple[Path, ...], out: Path, settings: ExportSettings) -> None:
    """Write maps in formats of other software: point clouds, depth images, arrays, tables.

    MAPS are map files and folders of them. The names of the written files are printed on stdout.

    \b
    PLY, PCD  points in metres: camera at the origin, x right, y down, z forward; with
              amplitude, sigma and status; pixels without an answer are left out
    PNG       16 bits, depth in millimetres, 0 where there is no answer
    NPZ, CSV  all layers
    """
    kind = out.suffix.lower()
    if kind in EXPORTS:
        note_given(EXPORTS[kind].without_effect(settings), f"with {kind}")
    with progress_bar("exporting", "maps") as bar:
        outputs = export_maps(maps, out, settings=settings, progress=bar)
    for output in outputs:
        tell(output)
