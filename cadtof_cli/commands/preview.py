"""`cadtof preview`."""

from pathlib import Path

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import RecordOptions, note_given
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.workflows.inspect.preview_settings import PreviewSettings


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof preview maps -o corner.png --truth sample_data/corner/truth.exr",
        "cadtof preview maps -o mpi.png --layer mpi.depth --range 1.5,3",
        "cadtof preview sample_data/corner/frame_0000.tif -o recorded.png",
    ),
)
@click.argument("inputs", nargs=-1, required=True, type=PATH, metavar="MAPS...")
@click.option(
    "-o", "--out", required=True, type=PATH, help="Picture (.png, .pdf, .svg, .jpg) or film (.gif, .mp4) to write."
)
@RecordOptions("settings", PreviewSettings)
def preview(*, inputs: tuple[Path, ...], out: Path, settings: PreviewSettings) -> None:
    """Draw depths, errors, sigma, confidence and the status of each pixel; or a sheet or film of many frames.

    MAPS are map files, truth, recorded frames, folders of them, or a calibration folder. One frame is drawn as a figure.
    Several frames are drawn as a sheet of thumbnails with one colour scale, or as a film if -o is a GIF or MP4 (MP4 needs the
    extra `video`).
    """
    from cadtof_cli.figures.sequence import FILMS
    from cadtof_cli.files.maps import STATUS
    from cadtof_cli.workflows.inspect.preview import preview as draw

    if out.suffix.lower() not in FILMS:
        note_given({"frames_per_second"}, f"with {out.suffix}")
    if settings.layer == STATUS:
        note_given({"limits", "colours"}, f"with --layer {STATUS}")
    with progress_bar("drawing", "frames") as bar:
        draw(inputs, out, settings=settings, progress=bar)
    tell(out)
