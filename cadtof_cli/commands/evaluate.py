"""`cadtof evaluate`."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from cadtof_cli.commands.examples import example
from cadtof_cli.commands.progress import Bar
from cadtof_cli.commands.terminal import tell


@click.command(
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof evaluate maps --truth sample_data/corner/truth.exr",
    )
)
@click.argument("maps", type=click.Path(path_type=Path), metavar="OUT")
@click.option(
    "--truth", required=True, type=click.Path(path_type=Path), help="File with a layer direct.depth, in metres."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout instead of the table.")
def evaluate(maps: Path, truth: Path, as_json: bool) -> None:
    """Compare the direct depth of maps with truth, beside the depth of the first phasor alone.

    OUT is the folder that `cadtof resolve` wrote, or one map file. All frames are held against the same truth; pixels
    without truth do not count, and `valid` is the share of the others that have an answer. The last two columns are the
    shares of errors within once and twice the predicted standard deviation: 68 % and 95 % where that is true.
    """
    from cadtof_cli.workflows.inspect.evaluate import evaluate_maps

    evaluation = evaluate_maps(maps, truth=truth, progress=Bar())
    if as_json:
        tell(json.dumps(asdict(evaluation)))
        return
    titles = "".join(f"{title:>10}" for title in ("median", "90 %", "RMSE", "bias", "valid", "in 1 σ", "in 2 σ"))
    tell(f"{'error, cm':14}{titles}   (median and 90 % of |error|; {evaluation.frames} frames)")
    for title, errors in (("first phasor", evaluation.first_phasor), ("direct path", evaluation.direct)):
        if errors is not None:
            figures = (errors.median_cm, errors.p90_cm, errors.rmse_cm, errors.bias_cm)
            shown = "".join(f"{'–' if figure is None else f'{figure:.2f}':>10}" for figure in figures)
            shares = (errors.valid, errors.within_1_sigma, errors.within_2_sigma)
            tell(f"{title:14}{shown}" + "".join(f"{'–' if share is None else f'{share:.1%}':>10}" for share in shares))
