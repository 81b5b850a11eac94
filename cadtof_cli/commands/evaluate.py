"""`cadtof evaluate`."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.commands.help import Command, example
from cadtof_cli.commands.options import note_given
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import PATH
from cadtof_cli.errors import require
from cadtof_cli.units import counted

if TYPE_CHECKING:
    from cadtof_cli.maps.evaluation import Evaluation
    from cadtof_cli.workflows.inspect.evaluate import Scatter


@click.command(
    cls=Command,
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof evaluate maps --truth sample_data/corner/truth.exr",
        "cadtof evaluate maps --truth sample_data/corner/truth.exr --max-median 2",
    ),
)
@click.argument("maps", type=PATH, metavar="OUT")
@click.option(
    "--truth",
    type=PATH,
    help="File of the true depths: a layer direct.depth, radial range in metres. Or a folder with such a file, truth.exr, "
    "for each capture, in the same tree as OUT.",
)
@click.option(
    "--layer",
    default="direct.depth",
    show_default=True,
    metavar="NAME",
    help="Layer of depths to compare, such as mpi.depth; the truth must hold it, too.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
@click.option(
    "--max-median",
    type=click.FloatRange(0.0),
    metavar="CM",
    help="End with exit status 1 if the median error of the depth is larger than CM centimetres, or if there is none.",
)
@click.option("--csv", "table", type=PATH, metavar="FILE", help="Write a CSV file with one line per frame.")
@click.option(
    "--over-time",
    type=PATH,
    metavar="EXR",
    help="Write maps of the mean and standard deviation of the depths of each pixel over the frames; needs no truth.",
)
@click.option("--overwrite", is_flag=True, help="Replace the files of --csv and --over-time if they exist.")
def evaluate(
    *,
    maps: Path,
    truth: Path | None,
    layer: str,
    as_json: bool,
    max_median: float | None,
    table: Path | None,
    over_time: Path | None,
    overwrite: bool,
) -> int:
    """Compare the direct depth, and the depth of the first phasor alone, with the true depth; or another layer of depths.

    OUT is the folder that `cadtof resolve` wrote, or one map file. All frames of a capture are compared with the same truth.
    Pixels without truth do not count; `valid` is the share of the others that have an answer. The last two columns are the
    shares of errors within one and two predicted standard deviations: 68 % and 95 % if the prediction is right and errors are
    Gaussian. The first phasor gets the same calibration as the run and is evaluated at the same pixels.

    \b
    Exit status:
      0  done
      1  the median error is larger than --max-median, or a map cannot be read
      2  wrong usage, or nothing to evaluate
    """
    if max_median is not None and math.isnan(max_median):
        raise click.UsageError("--max-median: found nan, expected centimetres, 0 or more")
    if truth is None and (over_time is None or table is not None or max_median is not None):
        raise click.UsageError(
            "--truth is missing: expected a file with the layer direct.depth (only --over-time needs none)"
        )
    path, _, is_depth = layer.rpartition(".")
    require(bool(path) and is_depth == "depth", "--layer", repr(layer), "a layer of depths such as mpi.depth")
    if truth is None:
        note_given({"layer"}, "without --truth")
    if table is None and over_time is None:
        note_given({"overwrite"}, "without --csv or --over-time")
    from cadtof_cli.workflows.inspect.evaluate import evaluate_maps, scatter_over_time

    evaluation, found = None, dict[str, Any]()
    lines: list[str] = []
    with progress_bar("evaluating", "maps") as bar:
        if over_time is not None:
            scatter = scatter_over_time(maps, over_time, progress=bar, overwrite=overwrite)
            found["over_time"], lines = asdict(scatter), [_scatter_line(scatter, over_time)]
        if truth is not None:
            evaluation = evaluate_maps(maps, truth=truth, progress=bar, table=table, overwrite=overwrite, layer=layer)
            figures = asdict(evaluation)
            if path != "direct":
                # the first phasor is compared with the direct depth only
                figures = {"frames": evaluation.frames, path: figures["direct"]}
            found, lines = figures | found, [*_table(evaluation, path), *lines]
    tell(*([json.dumps(found)] if as_json else lines))
    return 1 if evaluation and max_median is not None and _fails(evaluation, max_median) else 0


def _fails(evaluation: "Evaluation", max_median: float) -> bool:
    """Return whether the median error is missing or larger than `max_median`, and say so on stderr."""
    median = evaluation.direct.median_cm
    if median is not None and median <= max_median:
        return False
    found = "found no pixel with truth and an answer"
    if median is not None:
        # the fewest digits that show that it is larger
        shown = next(text for digits in range(3, 18) if float(text := f"{median:.{digits}g}") > max_median)
        found = f"found a median error of {shown} cm"
    tell(f"failed: {found}, expected at most {str(max_median).removesuffix('.0')} cm (--max-median)", err=True)
    return True


def _table(evaluation: "Evaluation", path: str) -> Iterator[str]:
    from cadtof_cli.maps.evaluation import ERROR_TITLES

    yield f"{'error, cm':14}{''.join(f'{title:>9}' for title in ERROR_TITLES)}"
    for title, errors in evaluation.in_words.items():
        title = title if path == "direct" or title != "direct path" else path
        yield f"{title:14}{''.join(f'{shown:>9}' for shown in errors.in_words)}"
    yield f"{counted(evaluation.frames, 'frame')}; median and 90 % are those of |error|"


def _scatter_line(scatter: "Scatter", path: Path) -> str:
    frames, std = counted(scatter.frames, "frame"), scatter.median_std_cm
    sigma = "–" if scatter.median_sigma_cm is None else f"{scatter.median_sigma_cm:.2f} cm"
    seen = "no pixel has depths in two frames" if std is None else f"direct depth scatters by {std:.2f} cm"
    return f"over {frames}: {seen}; predicted sigma of the median pixel: {sigma}; maps in {path}"
