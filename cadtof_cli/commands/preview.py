"""`cadtof preview`."""

from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.progress import Bar
from cadtof_cli.commands.terminal import tell


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof preview maps -o corner.png --truth sample_data/corner/truth.exr",
    )
)
@click.argument("maps", type=click.Path(path_type=Path), metavar="MAPS")
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), help="Picture to write: .png, .pdf, .svg or .jpg."
)
@click.option("--overwrite", is_flag=True, help="Replace a picture that is there.")
@click.option(
    "--truth", type=click.Path(path_type=Path), help="File with a layer direct.depth: the errors are drawn too."
)
def preview(maps: Path, out: Path, overwrite: bool, truth: Path | None) -> None:
    """Draw direct depth, MPI depth, confidence, and predicted sigma or the error against truth.

    MAPS is a map file, or a folder of them, whose first is drawn.
    """
    from cadtof_cli.workflows.inspect.preview import preview_maps

    preview_maps(maps, out=out, truth=truth, overwrite=overwrite, progress=Bar())
    tell(out)
