"""`cadtof resolve`."""

import itertools
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cadtof_cli.commands.help import SectionedCommand, example
from cadtof_cli.commands.map_options import CAPTURE_HEADING, MAP_HEADING, capture_options, map_options, settings_option
from cadtof_cli.commands.options import (
    STDIN,
    RecordOptions,
    arriving_paths,
    declared_options,
    jobs_option,
    note_given,
    null_option,
)
from cadtof_cli.commands.terminal import progress_bar, tell
from cadtof_cli.commands.values import INPUT
from cadtof_cli.execution.workers import LOCAL, Workers
from cadtof_cli.units import counted
from cadtof_cli.workflows.resolve.settings import ResolveSettings

if TYPE_CHECKING:
    from cadtof_cli.commands.terminal import Bar
    from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals


@click.command(
    cls=SectionedCommand,
    headings={
        **MAP_HEADING,
        "Worker options": ("jobs", "start_method", "task_timeout_s", "scheduler"),
        **CAPTURE_HEADING,
    },
    epilog=example(
        "cadtof resolve sample_data/corner -o maps",
        "cadtof resolve --recursive sample_data -o all --depth z --json",
    ),
)
@click.argument("inputs", nargs=-1, type=INPUT, required=True, metavar="INPUT...")
@RecordOptions(
    "settings",
    ResolveSettings,
    *declared_options(ResolveSettings).values(),
    settings_option(),
    map_options(),
    RecordOptions("workers", Workers, jobs_option("Worker processes"), *declared_options(Workers).values()),
    capture_options(),
)
@null_option()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON line per frame on stdout, as in frames.jsonl.")
@click.option(
    "--log",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Append all messages to a file, with the time.",
)
@click.option(
    "-q",
    "--quiet",
    is_flag=True,
    is_eager=True,
    help="Print only errors on stderr: no progress bar, warnings, notes or summary.",
)
def resolve(
    *,
    inputs: tuple[str, ...],
    settings: ResolveSettings,
    null: bool,
    as_json: bool,
    log: Path | None,
    quiet: bool,
) -> int:
    """Resolve the direct path and the MPI in every pixel of recorded frames, and write depth maps.

    INPUT is a capture folder or a frame file. With - as INPUT, paths are read from stdin, one per line, and resolved as they
    arrive. OUT gets one file of maps per frame, run.json and frames.jsonl. With several captures, OUT has the same tree of
    folders as the captures have below the folder that holds all INPUTs.

    \b
    Exit status:
      0    all frames were resolved
      1    some frames failed (the others are written), or no frame was resolved
      2    wrong usage, settings or capture
      130  interrupted
      141  the reader of stdout went away
    """
    from cadtof_cli.workflows.resolve.resolve import resolve_captures

    if settings.workers.scheduler != LOCAL:
        note_given({"jobs", "start_method"}, "with --scheduler, whose workers are started elsewhere")
    elif settings.workers.jobs == 1 and settings.workers.task_timeout_s is None:
        note_given({"start_method"}, "with a single process")
    paths = arriving_paths(inputs, null=null)
    # a list of what would be written is complete only if all paths have arrived
    first = tuple(itertools.chain.from_iterable(paths)) if settings.dry_run else next(paths)
    with progress_bar("resolving", "frames", quiet=quiet, log=log) as bar:
        totals = resolve_captures(
            first,
            arriving=paths if STDIN in inputs else None,
            settings=settings,
            progress=bar,
            on_frame=partial(_tell_of_frame, bar, as_json=as_json, dry_run=settings.dry_run),
        )
        resolver, discrete = settings.maps.resolver, totals.ok - totals.diffuse_frames
        if discrete and resolver.mpi_model == "diffuse" and resolver.may_be_diffuse((1, 2)) and not settings.dry_run:
            dim = f"{counted(discrete, 'frame')} with enough light in too few places"
            bar.say(f"--mpi-model diffuse: has no effect on {dim}; all MPI there is taken for separate paths")
        summary = _summary(totals, settings)
        if bar.log:
            bar.log.note(summary)
    # without a frame, this line alone says why the exit status is 1, so --quiet prints it too
    if not quiet or not totals.frames:
        tell(summary, err=True)
    return 0 if totals.ok + totals.already_there and not totals.failed else 1


def _tell_of_frame(bar: "Bar", report: "FrameReport", /, *, as_json: bool, dry_run: bool) -> None:
    if as_json:
        tell(json.dumps(report.as_json()))
    elif dry_run:
        nothing = "nothing, it is already there" if report.kept else "nothing, it cannot be read"
        tell(f"{report.source} → {report.output or nothing}")
    if report.status == "failed" or (report.status == "skipped" and not report.kept):
        bar.say(f"{report.status}: {report.reason}", warning=True)


def _summary(totals: "RunTotals", settings: ResolveSettings) -> str:
    out = settings.out
    if settings.dry_run:
        kept = f", {totals.already_there} are already there" if totals.already_there else ""
        return f"would write {counted(totals.ok, 'file')} of maps into {out}{kept}; nothing has been written"
    if not totals.frames:
        return "no frame was resolved: no capture has a frame in the range of --frames"
    pixels = totals.one_path + totals.two_paths + totals.more_paths + totals.diffuse + totals.invalid
    line = f"resolved {totals.ok} of {totals.frames} frames in {totals.seconds:.1f} s"
    if totals.ok:
        rare = {"more than two paths": totals.more_paths, "diffuse MPI": totals.diffuse}
        usual = {"two paths": totals.two_paths, "one path": totals.one_path, "no answer": totals.invalid}
        counts = {what: count for what, count in rare.items() if count} | usual
        shares = ", ".join(f"{count / pixels:.1%} {what}" for what, count in counts.items())
        rate = totals.ok / totals.seconds
        line += f" ({rate:{'.0f' if rate >= 10.0 else '.2g'}} frames/s); pixels: {shares}"
    if totals.already_there == totals.frames:
        return f"nothing to do: the maps of {counted(totals.frames, 'frame')} are already in {out}"
    if totals.already_there:
        line += f"; {totals.already_there} already there"
    without = {"failed": totals.failed, "skipped": totals.skipped - totals.already_there}
    if any(without.values()):
        told = ", ".join(f"{count} {what}" for what, count in without.items() if count)
        line += f"; {told}, see {out / 'frames.jsonl'}"
    return f"{line}; maps in {out}" if totals.ok + totals.already_there else line
