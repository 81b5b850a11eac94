"""`cadtof resolve`: captures in, one file of maps per frame out, with a record of the run beside them."""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.capture.frames import Capture
from cadtof_cli.execution.workers import LOCAL
from cadtof_cli.files.atomic import make_folder, remove_partial_files
from cadtof_cli.resolver.kernels import CHOICE, NUMPY, chosen_kernel, numpy_note
from cadtof_cli.workflows.resolve.earlier import earlier_run, remove_run
from cadtof_cli.workflows.resolve.frame_task import FrameTask
from cadtof_cli.workflows.resolve.ongoing_run import Batch, OngoingRun
from cadtof_cli.workflows.resolve.output import MapNames, locked, map_names
from cadtof_cli.workflows.resolve.plans import (
    AppliedCalibration,
    CapturePlan,
    captures_in,
    plan_captures,
    pooling_notes,
    use_calibration,
)
from cadtof_cli.workflows.resolve.record import recorded_run
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals
from cadtof_cli.workflows.resolve.run_document import run_document
from cadtof_cli.workflows.resolve.settings import ResolveSettings

if TYPE_CHECKING:
    from cadtof_cli.workflows.progress import Progress
    from cadtof_cli.workflows.resolve.arrivals import Arrivals


def resolve_captures(
    inputs: Sequence[Path],
    /,
    *,
    settings: ResolveSettings,
    arriving: Iterable[tuple[Path, ...]] | None,
    progress: "Progress",
    on_frame: Callable[[FrameReport], None],
) -> RunTotals:
    """Resolve every frame of the inputs into a file of maps in `settings.out`. A frame that fails does not stop the others.

    Args:
        inputs: folders of frames, and single files.
        settings: settings of the run.
        arriving: more inputs, in batches that come during the run; None: there are no more.
        progress: a step is a file of maps.
        on_frame: called with every report, in the order of the inputs for any number of processes.

    Raises:
        CadtofError: nothing can be resolved: an input, the metadata, the settings or the output folder is at fault.
    """
    captures, base, arrivals, failed = _first_captures(inputs, settings, arriving)
    calibration = use_calibration(settings.calibration, captures) if settings.calibration else None
    plans = plan_captures(captures, settings, calibration)
    names = map_names(captures, settings.out)
    document = run_document(inputs, settings, plans, calibration, base)
    find_earlier = partial(earlier_run, names, document, settings=settings, arriving=arrivals is not None)
    if settings.dry_run:
        find_earlier()
        return _dry_run(plans, names, settings, failed, on_frame)
    make_folder(settings.out)
    with locked(settings.out):
        earlier = find_earlier()
        names.tell_letters_apart()
        if settings.overwrite or settings.resume:
            remove_partial_files(settings.out)
        # files of two folders that are named in turn are many captures of the same folders
        for note in dict.fromkeys(_notes(plans, calibration, settings)):
            progress.say(note)
        run = OngoingRun(settings, progress, on_frame, names)
        try:
            # if a cluster does not answer, this fails before anything is written
            first = run.outcomes(plans)
            if settings.overwrite:
                remove_run(settings.out)
            batches: Iterator[Batch] = iter([(failed, first)])
            if arrivals:
                arrivals.begin(plans, calibration, names, document, earlier)
                later = (((), run.outcomes(more)) for more in arrivals.plans(run.report))
                batches = itertools.chain(batches, later)
            record = recorded_run(
                settings.out, document, earlier=earlier, arriving=arrivals is not None, say=progress.say
            )
            with record as run.record:
                return run.report_all(batches)
        finally:
            # maps bear the token of the run, and the two records bear the number of this process
            remove_partial_files(settings.out, tokens={run.token, str(os.getpid())})


def _first_captures(
    inputs: Sequence[Path], settings: ResolveSettings, arriving: Iterable[tuple[Path, ...]] | None
) -> tuple[Sequence[Capture], Path, "Arrivals | None", Sequence[FrameReport]]:
    """Return the captures that are there, and the folder whose tree OUT mirrors; what meets the captures that arrive during
    the run; and reports on inputs that failed."""
    if arriving is not None:
        # imported only when it is needed: each module takes a third of a millisecond
        from cadtof_cli.workflows.resolve.arrivals import Arrivals

        arrivals = Arrivals(settings, arriving)
        return *arrivals.first_captures(inputs), arrivals, arrivals.failed
    failed = list[FrameReport]()
    return *captures_in(inputs, settings, failed.append), None, failed


def _notes(
    plans: Sequence[CapturePlan], calibration: AppliedCalibration | None, settings: ResolveSettings
) -> Iterator[str]:
    """Yield what the user should know before the run begins."""
    for one in plans:
        yield from one.notes()
    yield from calibration.notes if calibration else ()
    if settings.workers.scheduler != LOCAL:
        if os.environ.get(CHOICE):
            yield f"{CHOICE}: has no effect with --scheduler, whose workers are started elsewhere"
    elif chosen_kernel() == NUMPY:
        yield numpy_note()
    if settings.maps.pool > 1:
        yield from pooling_notes(plans, settings)


def _dry_run(
    plans: Sequence[CapturePlan],
    names: MapNames,
    settings: ResolveSettings,
    failed: Iterable[FrameReport],
    on_frame: Callable[[FrameReport], None],
) -> RunTotals:
    """Report every file that a run would write, after the checks of a run. Nothing is written."""
    totals = RunTotals()
    for report in failed:
        totals.add(report)
        on_frame(report)
    for one in plans:
        for sources in one.groups(taken=names.taken):
            task = FrameTask(sources, one.reader, one.plan, one.output(sources))
            report = task.report("ok", None, 0.0)
            if settings.resume and task.output.exists():
                report = task.kept(report, 0.0)
            totals.add(report)
            on_frame(report)
    return totals
