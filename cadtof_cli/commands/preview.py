"""`cadtof preview`."""

from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.options import gathered, setting_option
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.workflows.inspect.preview_settings import PreviewSettings


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof preview maps -o corner.png --truth sample_data/corner/truth.exr",
        "cadtof preview maps -o mpi.png --layer mpi.depth --range 1.5,3",
        "cadtof preview sample_data/corner/frame_0000.tif -o recorded.png",
    )
)
@click.argument("inputs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MAPS...")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    help="Picture (.png, .pdf, .svg, .jpg) or film (.gif, .mp4) to write.",
)
@gathered(
    "settings",
    PreviewSettings,
    setting_option(
        "--layer",
        PreviewSettings,
        "layer",
        metavar="NAME",
        help="Draw this layer at full resolution, such as mpi.depth, status or H1.SC1.",
    ),
    setting_option(
        "--range",
        PreviewSettings,
        "limits",
        metavar="LO,HI",
        help="Ends of the scale, in the layer's unit.  [default: as suits the values]",
    ),
    setting_option("--cmap", PreviewSettings, "colours", help="Colours of the scale.  [default: as suits the layer]"),
    setting_option(
        "--truth", PreviewSettings, "truth", help="File with a layer direct.depth: the errors are drawn too."
    ),
    setting_option("--frame", PreviewSettings, "frame", metavar="N", help="Draw this one of the frames, from 0."),
    setting_option(
        "--fps", PreviewSettings, "frames_per_second", metavar="F", help="Frames that a film shows in a second."
    ),
    setting_option("--overwrite", PreviewSettings, "overwrite", help="Replace a file that is there."),
)
def preview(*, inputs: tuple[Path, ...], out: Path, settings: PreviewSettings) -> None:
    """Draw depths, errors against truth, sigma, confidence, and what became of each pixel; or a sheet or a film of many frames.

    MAPS are maps, truth, recorded frames, folders of them, or the folder of a calibration. One frame gets a figure; several get a
    sheet of thumbnails on one scale, or a film where -o is a GIF or MP4 (MP4 needs the extra `video`).
    """
    from cadtof_cli.workflows.inspect.preview import preview as draw

    with progress_bar("drawing", "frames", quiet=False) as bar:
        draw(inputs, out, settings=settings, progress=bar)
    tell(out)
