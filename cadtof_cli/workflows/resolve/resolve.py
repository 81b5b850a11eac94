"""`cadtof resolve`: captures in, one file of maps per frame out, with a record of the run beside them."""

import math
import os
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.capture.discovery import find_captures, placed_captures
from cadtof_cli.capture.frames import Capture, FrameSource
from cadtof_cli.errors import CaptureError, OutputError, RunStoppedError
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import Outcome, WorkerDied
from cadtof_cli.execution.workers import LOCAL
from cadtof_cli.files.atomic import PARTIAL_SUFFIX, make_folder, remove_partial_files, writing
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.kernels import NUMPY, numpy_note
from cadtof_cli.units import counted
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.resolve.earlier import earlier_run, remove_run
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from cadtof_cli.workflows.resolve.lock import locked
from cadtof_cli.workflows.resolve.output import MapNames, map_names, require_inside
from cadtof_cli.workflows.resolve.plans import (
    AppliedCalibration,
    CapturePlan,
    plan_captures,
    pooling_notes,
    use_calibration,
)
from cadtof_cli.workflows.resolve.record import RunRecorder, recorded_run
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals, failed_input
from cadtof_cli.workflows.resolve.run_json import run_document
from cadtof_cli.workflows.resolve.settings import ResolveSettings

if TYPE_CHECKING:
    from cadtof_cli.workflows.resolve.arrivals import Arrivals

Outcomes = Generator[Outcome[FrameTask, FrameReport], None, None]

Batch = tuple[Sequence[FrameReport], Sequence[CapturePlan]]
"""Reports on inputs that failed, and the plans of captures: of one batch of paths that arrive during a run."""

WORTH_SPLITTING_S = 0.5
"""Expected seconds per frame above which each part of a frame is worth a process: its pixels have to go there and back."""

MOST_PIXELS = 2**22
"""Pixels per frame above which one process resolves the whole frame all the same: parts would be in memory three times."""

_NOTES_OF_A_KIND = 3
"""How many frames are named with the same note; further frames are only counted."""


def resolve_captures(
    inputs: Sequence[Path],
    /,
    *,
    settings: ResolveSettings,
    arriving: Iterable[tuple[Path, ...]] | None,
    progress: Progress,
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
        for note in dict.fromkeys(_notes(plans, calibration, settings, kernel=document["kernel"])):
            progress.say(note)
        run = _Run(settings, progress, on_frame, names)
        try:
            # if a cluster does not answer, this fails before anything is written
            first = run.outcomes(plans)
            if settings.overwrite:
                remove_run(settings.out)
            later: Iterable[Batch] = ()
            if arrivals:
                arrivals.begin(plans, calibration, names, document, earlier)
                later = arrivals.plans(document)
            record = recorded_run(
                settings.out, document, earlier=earlier, arriving=arrivals is not None, say=progress.say
            )
            with record as run.record:
                return run.report_all(failed, first, later)
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
    found = find_captures(
        inputs,
        overrides=settings.overrides,
        settings_file=settings.settings_file,
        recursive=settings.recursive,
        on_unlisted=lambda folder, error: failed.append(failed_input(folder, error)),
    )
    return *placed_captures(found, inputs), None, failed


def _notes(
    plans: Sequence[CapturePlan], calibration: AppliedCalibration | None, settings: ResolveSettings, *, kernel: str
) -> Iterator[str]:
    """Yield what the user should know before the run begins."""
    for one in plans:
        yield from one.notes()
    yield from calibration.notes if calibration else ()
    if kernel == NUMPY:
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
        for task in one.tasks(taken=names.taken):
            report = task.report("ok", None, 0.0)
            if settings.resume and task.output.exists():
                report = task.kept(report, 0.0)
            totals.add(report)
            on_frame(report)
    return totals


@dataclass
class _Run:
    """A run in progress, and the outcomes of its frames so far.

    `names` are those of the maps so far. `expected` is how many maps there will be in all. `warned` are
    the folders of captures with the doubts that the user was warned of before the run.
    """

    settings: ResolveSettings
    progress: Progress
    on_frame: Callable[[FrameReport], None]
    names: MapNames
    token: str = field(default_factory=lambda: os.urandom(8).hex())
    record: RunRecorder = field(init=False)
    expected: int = 0
    totals: RunTotals = field(default_factory=RunTotals)
    warned: set[tuple[Path, str]] = field(default_factory=set)
    noted: Counter[str] = field(default_factory=Counter)
    only_counted: Counter[str] = field(default_factory=Counter)
    began: float = field(default_factory=time.monotonic)

    def outcomes(self, plans: Sequence[CapturePlan]) -> Outcomes:
        """Return a generator of the outcomes of some captures' frames. If a cluster is to do the work, connect to it."""
        tasks, workers = self._tasks(plans), self.settings.workers
        self.warned.update((one.capture.root, _why(doubt)) for one in plans for doubt in one.doubts)
        expected = sum(one.expected_maps for one in plans)
        if expected < workers.jobs and _are_worth_splitting(plans, self.settings):
            from cadtof_cli.workflows.resolve.split_frames import resolve_split

            return resolve_split(tasks, workers=workers)
        workers = workers.at_most(expected)
        if workers.jobs > 1:
            # a forked process has the modules already
            for one in plans:
                one.load_map_files()
        probe = None if workers.scheduler == LOCAL else self._probe()
        shared = [part for one in plans for part in (one.plan, one.reader)]
        return run_ordered(resolve_file, tasks, workers=workers, shared=shared, probe=probe, say=self.progress.say)

    def _probe(self) -> Path:
        """Make a file in the run's folder that workers of a cluster must see. It is removed with the half-written files."""
        probe = self.settings.out / f".cluster.{self.token}{PARTIAL_SUFFIX}"
        probe.write_text(self.token)
        return probe

    def report_all(self, failed: Iterable[FrameReport], first: Outcomes, later: Iterable[Batch]) -> RunTotals:
        """Record, count and show the outcomes of all frames; return the totals of this run.

        Raises:
            RunStoppedError: the output folder takes no more maps, or no more lines of the record.
            KeyboardInterrupt: the message says how to continue the run.
        """
        settings, totals = self.settings, self.totals
        try:
            self._report_batch(failed, first)
            for failures, plans in later:
                self._report_batch(failures, self.outcomes(plans))
            for why, count in self.only_counted.items():
                self.progress.say(f"{settings.out}: {counted(count, 'more map')}: {why}")
            totals.seconds = round(time.monotonic() - self.began, 3)
            with self._needed():
                self.record.finish(totals.seconds)
        except KeyboardInterrupt as interrupt:
            again = "the same command"
            if not settings.resume:
                again += " with --resume in place of --overwrite" if settings.overwrite else " with --resume"
            told = f"{totals.ok + totals.already_there} of {self.expected} frames are resolved; {again} goes on"
            raise KeyboardInterrupt(told) from interrupt
        return totals

    def _report_batch(self, failed: Iterable[FrameReport], batch: Outcomes) -> None:
        for report in failed:
            self.report(report)
        with closing(batch) as outcomes:
            for outcome in outcomes:
                found, task = outcome.result, outcome.task
                if isinstance(found, WorkerDied):
                    found = task.report("failed", _lost(task.sources[0], found), 0.0)
                self.report(found)

    def report(self, report: FrameReport) -> None:
        """Record, count and show the report on a frame.

        Raises:
            RunStoppedError: the output folder takes no more maps.
        """
        if report.note is not None:
            why = _why(report.note)
            is_known = any((folder, why) in self.warned for folder in Path(report.source).parents)
            if is_known or self.noted[why] == _NOTES_OF_A_KIND:
                self.only_counted[why] += 1
            else:
                self.noted[why] += 1
                self.progress.say(report.note)
        with self._needed():
            self.record.add(report)
        self.totals.add(report)
        self.on_frame(report)
        if report.stops:
            raise self._stopped(f"{self.settings.out}: no more maps can be written there")
        self.progress.advance(total=self.expected)

    @contextmanager
    def _needed(self) -> Iterator[None]:
        """Stop the run if something cannot be written without which it cannot go on."""
        try:
            yield
        except OutputError as error:
            raise self._stopped(str(error)) from error

    def _stopped(self, why: str) -> RunStoppedError:
        """Return the error for a run that cannot go on."""
        done = counted(self.totals.ok, "frame")
        return RunStoppedError(
            f"{why}, so the run stopped with {done} resolved; remove the cause and continue with --resume"
        )

    def _tasks(self, plans: Sequence[CapturePlan]) -> Iterator[FrameTask]:
        """Yield the tasks of all plans. A task is drawn when a worker has room for it.

        The expected total is corrected when a plan has more or fewer tasks than expected.
        """
        self.expected += sum(one.expected_maps for one in plans)
        self.progress.advance(0, total=self.expected)
        for one in plans:
            number = 0
            tasks = one.tasks(taken=self.names.taken, before=self.record.before, token=self.token)
            try:
                for number, task in enumerate(tasks, start=1):
                    if number > one.expected_maps:
                        self.expected += 1
                    if self.record.resumed:
                        self.record.meet(task)
                    if "/" in task.sources[0].name:
                        require_inside(self.settings.out, task.output.parent)
                        with self._needed(), writing(task.output.parent):
                            task.output.parent.mkdir(parents=True, exist_ok=True)
                    yield task
            except CaptureError as error:
                self.report(failed_input(one.capture.root, error))
            self.expected += min(number - one.expected_maps, 0)
            self.progress.advance(0, total=self.expected)


def _why(note: str) -> str:
    """Return the end of a note, which is the same for all frames that have it."""
    return note.rpartition(": ")[2]


def _lost(source: FrameSource, worker: WorkerDied) -> str:
    """Return the reason why a frame has no maps if its worker was lost twice."""
    if worker.after_s is None:
        return f"{source}: the worker process died twice on this frame (killed, or out of memory): try fewer --jobs"
    return f"{source}: not done within the {worker.after_s:g} s of --frame-timeout, twice: does its disk or network share answer?"


def _are_worth_splitting(plans: Sequence[CapturePlan], settings: ResolveSettings) -> bool:
    """Return whether frames are so slow that the pixels of each should be spread over the processes."""
    if settings.workers.scheduler != LOCAL:
        return False
    sizes = [(math.prod(one.pixels or (0,)), len(one.plan.metadata.modulation.harmonics)) for one in plans]
    per_pixel = settings.maps.resolver.seconds_per_pixel
    seconds = max((pixels * per_pixel(harmonics) for pixels, harmonics in sizes), default=0.0)
    return seconds > WORTH_SPLITTING_S and max(sizes)[0] <= MOST_PIXELS
