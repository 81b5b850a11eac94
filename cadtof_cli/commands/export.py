"""`cadtof export`."""

from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.options import gathered, setting_option
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.workflows.inspect.export import ExportSettings, export_maps


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof export maps -o corner.ply",
        "cadtof export maps -o corner.png --layer mpi.depth",
    )
)
@click.argument("maps", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MAPS...")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT.ply|.pcd|.png|.npz|.csv",
    help="File to write. Several maps get a file each: the map's name goes behind that of OUT.",
)
@gathered(
    "settings",
    ExportSettings,
    setting_option("--layer", ExportSettings, metavar="NAME", help="Depths that points and pictures are made of."),
    setting_option("--depth", ExportSettings, help="What the depths are.  [default: as run.json says, else range]"),
    setting_option(
        "--focal-length-px",
        ExportSettings,
        metavar="F",
        help="Focal length.  [default: as run.json says]",
    ),
    setting_option(
        "--principal-point-px",
        ExportSettings,
        metavar="X,Y",
        help="Column and row of the optical axis.  [default: as run.json says, else the middle]",
    ),
)
def export(
    maps: tuple[Path, ...],
    out: Path,
    settings: ExportSettings,
) -> None:
    """Write maps as other software reads them: point clouds, pictures of depths, arrays, tables.

    MAPS are map files, and folders of them. PLY and PCD: metres, camera at the origin, x right, y down, z forward; amplitude,
    sigma and status of each point; pixels without an answer are left out. PNG: 16 bits, millimetres, 0 no answer. NPZ and
    CSV: every layer. The files' names go to stdout.

    \b
    """
    with progress_bar("exporting", "maps", quiet=False) as bar:
        outputs = export_maps(maps, out, settings=settings, progress=bar)
    for output in outputs:
        tell(output)
