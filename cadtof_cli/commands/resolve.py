"""`cadtof resolve`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cadtof_cli.commands.options import (
    STDIN,
    SectionedCommand,
    arriving_paths,
    capture_options,
    gathered,
    setting_option,
    settings_option,
)
from cadtof_cli.commands.progress import progress_bar
from cadtof_cli.execution.workers import Workers
from cadtof_cli.frame_plan import MapSettings
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.resolve.settings import FORMAT_CHOICES, ResolveSettings

if TYPE_CHECKING:
    from cadtof_cli.workflows.resolve.resolve import RunTotals
    from cadtof_cli.workflows.run_folder import FrameReport


@click.command(cls=SectionedCommand)
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@setting_option("-o --out", ResolveSettings, required=True, help="Folder that the maps are written into.")
@setting_option(
    "-r --recursive",
    ResolveSettings,
    help="Look for captures in all folders below each INPUT, too; OUT gets the same tree.",
)
@click.option("-0", "--null", is_flag=True, help="Paths on stdin end with a zero byte, as `find -print0` writes them.")
@settings_option()
@gathered(
    "resolver",
    ResolverSettings,
    setting_option(
        "--mpi-model",
        ResolverSettings,
        help="What MPI is: separate paths (discrete), the tail that the room's geometry predicts (diffuse), or what each frame "
        "says. Another --solver, --order, more --paths or --return last mean discrete.",
    ),
    setting_option(
        "--solver",
        ResolverSettings,
        help="How paths are found: two-path in closed form (with more than two periods, or --paths, by maximum likelihood), "
        "one-path, or lm, the paper's Levenberg–Marquardt from random starts.",
    ),
    setting_option(
        "--paths",
        ResolverSettings,
        metavar="K",
        help="Most paths a pixel; more than 2 need as many periods, and give layers path3.depth and so on.",
    ),
    setting_option(
        "--order",
        ResolverSettings,
        metavar="auto|1|…|K",
        help="Paths a pixel, whatever the solver: auto tests each pixel, a number is taken as it is "
        "(--solver lm --order 2 is the paper's method as published).",
    ),
    setting_option("--starts", ResolverSettings, metavar="N", help="Random starts of --solver lm."),
    setting_option("--seed", ResolverSettings, metavar="S", help="Seed of the random starts of --solver lm."),
    setting_option(
        "--false-alarm",
        ResolverSettings,
        metavar="P",
        help="Probability that noise alone passes for a signal, or for a second path.",
    ),
    setting_option("--return", ResolverSettings, "returns", help="Which of two paths is called direct."),
    setting_option(
        "--min-return-ratio",
        ResolverSettings,
        metavar="R",
        help="Least amplitude of a direct path, as a share of the strongest.",
    ),
)
@setting_option(
    "--min-confidence",
    MapSettings,
    "min_confidence_v",
    metavar="V",
    help="Least confidence of a pixel with an answer, in volts.  [default: what noise alone reaches with --false-alarm]",
)
@setting_option("--depth", MapSettings, help="Radial range, or planar depth (needs the optics).")
@setting_option(
    "--pool",
    MapSettings,
    metavar="N",
    help="Pool the noise of N × N neighbours that show the same light, N odd; adds the layer effective_pixels.",
)
@setting_option(
    "--average",
    MapSettings,
    metavar="N",
    help="Average every N consecutive frames of a capture into one, named after the first; the last one takes those left.",
)
@setting_option(
    "--calibration", ResolveSettings, metavar="DIR", help="Folder made by `cadtof calibrate`; what is in it is applied."
)
@setting_option(
    "--format",
    ResolveSettings,
    "map_format",
    type=click.Choice(FORMAT_CHOICES),
    help="Format of the maps; same as the input's.",
)
@gathered(
    "workers",
    Workers,
    setting_option("-j --jobs", Workers, metavar="N", help="Worker processes.  [default: all cores]"),
    setting_option("--start-method", Workers, help="How worker processes start.  [default: fork on Linux, else spawn]"),
    setting_option(
        "--scheduler",
        Workers,
        metavar="local|tcp://HOST:PORT",
        help="Worker processes here, or the workers of a dask scheduler, which share its files (extra cluster).",
    ),
)
@setting_option("--overwrite", ResolveSettings, help="Replace the files of an earlier run.")
@setting_option(
    "--resume", ResolveSettings, help="Keep the maps of an earlier run with the same options; do what is missing."
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print a JSON line on stdout for every frame, as in frames.jsonl."
)
@click.option("-q", "--quiet", is_flag=True, help="No progress, notes or summary on stderr; errors only.")
@capture_options()
def resolve(
    *,
    inputs: tuple[str, ...],
    out: Path,
    recursive: bool,
    null: bool,
    settings_file: Path | None,
    resolver: ResolverSettings,
    min_confidence_v: float | None,
    depth: Any,
    pool: int,
    average: int,
    calibration: Path | None,
    map_format: str,
    workers: Workers,
    overwrite: bool,
    resume: bool,
    as_json: bool,
    quiet: bool,
    overrides: Mapping[str, Any],
) -> int:
    """Resolve the direct and the MPI path in every pixel of recorded frames, and write their maps.

    INPUT is a capture folder, a file, or - for paths on stdin, a line each, resolved as they arrive. OUT gets a file per
    frame, run.json and frames.jsonl; with several captures, a folder for each as they lie below the folder that they share.

    \b
    Exit status: 0 all frames resolved; 1 some failed, the others are written;
    2 wrong usage, settings or capture; 130 interrupted.
    """
    from cadtof_cli.workflows.resolve.resolve import resolve_captures

    settings = ResolveSettings(
        out=out,
        maps=MapSettings(resolver=resolver, depth=depth, pool=pool, average=average, min_confidence_v=min_confidence_v),
        calibration=calibration,
        map_format=map_format,
        workers=workers,
        overwrite=overwrite,
        resume=resume,
        recursive=recursive,
        settings_file=settings_file,
    )
    paths = arriving_paths(inputs, separator=b"\0" if null else b"\n")
    with progress_bar("resolving", "frames", quiet=quiet) as bar:

        def tell(report: "FrameReport") -> None:
            if as_json:
                click.echo(json.dumps(report.as_json()))
            if report.status == "failed":
                bar.warn(f"failed: {report.reason}")

        totals = resolve_captures(
            next(paths),
            arriving=paths if STDIN in inputs else None,
            settings=settings,
            overrides=overrides,
            progress=bar,
            on_frame=tell,
        )
    if not quiet:
        click.echo(_summary(totals, out), err=True)
    return 1 if totals.failed else 0


def _summary(totals: "RunTotals", out: Path) -> str:
    pixels = totals.one_path + totals.two_paths + totals.more_paths + totals.diffuse + totals.invalid
    line = f"resolved {totals.ok} of {totals.frames} frames in {totals.seconds:.1f} s"
    if totals.ok:
        more = f"{totals.more_paths / pixels:.1%} of pixels have more than two paths, " if totals.more_paths else ""
        more += f"{totals.diffuse / pixels:.1%} of pixels have diffuse MPI, " if totals.diffuse else ""
        line += (
            f" ({totals.ok / totals.seconds:.0f} frames/s): {more}{totals.two_paths / pixels:.1%} of pixels have two paths, "
            f"{totals.one_path / pixels:.1%} one, {totals.invalid / pixels:.1%} no answer"
        )
    for what in ("failed", "skipped"):
        if getattr(totals, what):
            line += f"; {getattr(totals, what)} {what}, see {out / 'frames.jsonl'}"
    return f"{line}; maps in {out}"
