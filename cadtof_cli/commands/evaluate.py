"""`cadtof evaluate`."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from cadtof_cli.commands.progress import Bar
from cadtof_cli.commands.terminal import tell


@click.command()
@click.argument("maps", type=click.Path(path_type=Path), metavar="OUT")
@click.option(
    "--truth", required=True, type=click.Path(path_type=Path), help="File with a layer direct.depth, in metres."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
def evaluate(maps: Path, truth: Path, as_json: bool) -> None:
    """Compare the direct depth of maps with truth, beside the depth of the first phasor alone.

    OUT is the folder that `cadtof resolve` wrote, or one map file. All frames are held against the same truth; pixels
    without truth do not count, and `valid` is the share of the others that have an answer.
    """
    from cadtof_cli.workflows.inspect.evaluate import evaluate_maps

    evaluation = evaluate_maps(maps, truth=truth, progress=Bar())
    if as_json:
        tell(json.dumps(asdict(evaluation)))
        return
    titles = "".join(f"{title:>10}" for title in ("median", "90 %", "RMSE", "bias", "valid"))
    tell(f"{'error, cm':14}{titles}   (median and 90 % of |error|; {evaluation.frames} frames)")
    for title, errors in (("first phasor", evaluation.first_phasor), ("direct path", evaluation.direct)):
        if errors is not None:
            figures = (errors.median_cm, errors.p90_cm, errors.rmse_cm, errors.bias_cm)
            shown = "".join(f"{'–' if figure is None else f'{figure:.2f}':>10}" for figure in figures)
            tell(f"{title:14}{shown}{errors.valid:>10.1%}")
