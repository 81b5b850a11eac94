"""`cadtof resolve`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cadtof_cli.commands.options import SectionedCommand, capture_options, input_paths
from cadtof_cli.commands.progress import Bar, progress_bar
from cadtof_cli.resolver.settings import RETURNS, SOLVERS, ResolverSettings


@click.command(cls=SectionedCommand, short_help="Recorded frames → depth maps without multi-path interference.")
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), help="Folder that the maps are written into."
)
@click.option(
    "--solver",
    type=click.Choice(SOLVERS),
    default="two-path",
    show_default=True,
    help="How paths are found: two-path in closed form (with more than two periods, or --paths, by maximum likelihood), "
    "one-path, or lm, the paper's Levenberg–Marquardt from random starts.",
)
@click.option(
    "--paths",
    type=int,
    default=2,
    show_default=True,
    metavar="K",
    help="Most paths a pixel; more than 2 need as many periods, and give layers path3.depth and so on.",
)
@click.option(
    "--order",
    default="auto",
    show_default=True,
    metavar="auto|1|…|K",
    help="Paths a pixel, whatever the solver: auto tests each pixel, a number is taken as it is "
    "(--solver lm --order 2 is the paper's method as published).",
)
@click.option("--starts", type=int, default=10, show_default=True, metavar="N", help="Random starts of --solver lm.")
@click.option(
    "--seed", type=int, default=0, show_default=True, metavar="S", help="Seed of the random starts of --solver lm."
)
@click.option(
    "--false-alarm",
    type=float,
    default=0.01,
    show_default=True,
    metavar="P",
    help="Probability that noise alone passes for a signal, or for a second path.",
)
@click.option(
    "--return",
    "returns",
    type=click.Choice(RETURNS),
    default="first",
    show_default=True,
    help="Which of two paths is called direct.",
)
@click.option(
    "--min-return-ratio",
    type=float,
    default=0.1,
    show_default=True,
    metavar="R",
    help="Least amplitude of a direct path, as a share of the strongest.",
)
@click.option(
    "--min-confidence",
    type=float,
    metavar="V",
    help="Least confidence of a pixel with an answer, in volts.  [default: what noise alone reaches with --false-alarm]",
)
@click.option(
    "--depth",
    type=click.Choice(["range", "z"]),
    default="range",
    show_default=True,
    help="Radial range, or planar depth (needs the optics).",
)
@click.option(
    "--pool",
    type=int,
    default=1,
    show_default=True,
    metavar="N",
    help="Pool the noise of N × N neighbours that show the same light, N odd; adds the layer effective_pixels.",
)
@click.option(
    "--average",
    type=int,
    default=1,
    show_default=True,
    metavar="N",
    help="Average every N consecutive frames of a capture into one, named after the first; the last one takes those left.",
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder made by `cadtof calibrate`; what is in it is applied.",
)
@click.option(
    "--format",
    "map_format",
    type=click.Choice(["exr", "tif", "same"]),
    default="same",
    show_default=True,
    help="Format of the maps; same as the input's.",
)
@click.option("-j", "--jobs", type=int, metavar="N", help="Worker processes.  [default: all cores]")
@click.option(
    "--start-method",
    type=click.Choice(["fork", "spawn", "forkserver"]),
    help="How worker processes start.  [default: fork on Linux, else spawn]",
)
@click.option("--overwrite", is_flag=True, help="Replace the files of an earlier run.")
@click.option(
    "--resume", is_flag=True, help="Keep the maps of an earlier run with the same options; do what is missing."
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print a JSON line on stdout for every frame, as in frames.jsonl."
)
@click.option("-q", "--quiet", is_flag=True, help="No progress, notes or summary on stderr; errors only.")
@capture_options
def resolve(
    inputs: tuple[str, ...],
    out: Path,
    jobs: int | None,
    start_method: str | None,
    as_json: bool,
    quiet: bool,
    overrides: Mapping[str, Any],
    **options: Any,
) -> int:
    """Resolve the direct and the MPI path in every pixel of recorded frames, and write their maps.

    INPUT is a capture folder, a file, or - for paths on stdin. OUT gets a file a frame, run.json and frames.jsonl.

    \b
    Exit status: 0 all frames resolved; 1 some failed, the others are written;
    2 wrong usage, settings or capture; 130 interrupted.
    """
    from cadtof_cli.workflows.resolve.resolve import Progress, ResolveSettings, resolve_captures

    paths = input_paths(inputs)
    arguments = {"inputs": [str(path) for path in paths], "out": str(out), **options, "overrides": dict(overrides)}
    arguments["calibration"] = options["calibration"] and str(options["calibration"])
    running: dict[str, Any] = {
        name: value for name, value in {"jobs": jobs, "start_method": start_method}.items() if value is not None
    }
    settings = ResolveSettings(
        out=out,
        resolver=ResolverSettings(
            solver=options["solver"],
            paths=options["paths"],
            starts=options["starts"],
            seed=options["seed"],
            order=options["order"],
            false_alarm=options["false_alarm"],
            returns=options["returns"],
            min_return_ratio=options["min_return_ratio"],
            min_confidence_v=options["min_confidence"],
        ),
        depth=options["depth"],
        pool=options["pool"],
        average=options["average"],
        calibration=options["calibration"],
        map_format=options["map_format"],
        overwrite=options["overwrite"],
        resume=options["resume"],
        **running,
    )
    with progress_bar("resolving", "frames", quiet=quiet) as bar:
        totals = resolve_captures(
            paths,
            settings=settings,
            overrides=overrides,
            arguments=arguments,
            progress=Progress(bar.total, _frame_reporter(bar, as_json=as_json), (lambda _: None) if quiet else bar.say),
        )
    if not quiet:
        click.echo(_summary(totals, out), err=True)
    return 1 if totals.failed else 0


def _frame_reporter(bar: Bar, *, as_json: bool) -> Any:
    def on_frame(report: Any) -> None:
        if as_json:
            click.echo(json.dumps(report.as_json()))
        if report.status == "failed":
            bar.say(f"failed: {report.reason}")
        bar.advance()

    return on_frame


def _summary(totals: Any, out: Path) -> str:
    pixels = totals.one_path + totals.two_paths + totals.more_paths + totals.invalid
    line = f"resolved {totals.ok} of {totals.frames} frames in {totals.seconds:.1f} s"
    if totals.ok:
        more = f"{totals.more_paths / pixels:.1%} of pixels have more than two paths, " if totals.more_paths else ""
        line += (
            f" ({totals.ok / totals.seconds:.0f} frames/s): {more}{totals.two_paths / pixels:.1%} of pixels have two paths, "
            f"{totals.one_path / pixels:.1%} one, {totals.invalid / pixels:.1%} no answer"
        )
    for what in ("failed", "skipped"):
        if getattr(totals, what):
            line += f"; {getattr(totals, what)} {what}, see {out / 'frames.jsonl'}"
    return f"{line}; maps in {out}"
