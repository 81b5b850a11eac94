"""A run in progress: tasks are drawn and done, and what became of each frame is recorded, counted and shown."""

import math
import os
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.errors import CaptureError, OutputError, RunStoppedError
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import Outcome, WorkerDied
from cadtof_cli.execution.workers import LOCAL
from cadtof_cli.files.atomic import PARTIAL_SUFFIX, writing
from cadtof_cli.records import dataclass
from cadtof_cli.units import counted
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from cadtof_cli.workflows.resolve.output import MapNames, require_inside
from cadtof_cli.workflows.resolve.plans import CapturePlan
from cadtof_cli.workflows.resolve.record import RunRecorder
from cadtof_cli.workflows.resolve.reports import FrameReport, RunTotals, failed_input
from cadtof_cli.workflows.resolve.settings import ResolveSettings

if TYPE_CHECKING:
    from cadtof_cli.workflows.progress import Progress

Outcomes = Generator[Outcome[FrameTask, FrameReport], None, None]

Batch = tuple[Sequence[FrameReport], Outcomes]
"""Reports on inputs that failed before, and the outcomes of the frames of all others."""

WORTH_SPLITTING_S = 0.5
"""Expected seconds per frame above which each part of a frame is worth a process: its pixels have to go there and back."""

MOST_PIXELS = 2**22
"""Pixels per frame above which one process resolves the whole frame all the same: parts would be in memory three times."""

_NOTES_OF_A_KIND = 3
"""How many frames are named with the same note; further frames are only counted."""


@dataclass
class FrameNotes:
    """Which notes on frames the user was told. Of notes that end alike, only a few are told; further ones are counted.

    `warned` are the folders of captures with the doubts that the user was warned of before their frames were resolved.
    """

    warned: set[tuple[Path, str]] = field(default_factory=set)
    told: Counter[str] = field(default_factory=Counter)
    only_counted: Counter[str] = field(default_factory=Counter)

    def is_worth_telling(self, note: str, source: Path, /) -> bool:
        """Return whether the user should be told a note on a frame, and count it."""
        why = _why(note)
        is_known = any((folder, why) in self.warned for folder in source.parents)
        worth = not is_known and self.told[why] < _NOTES_OF_A_KIND
        (self.told if worth else self.only_counted)[why] += 1
        return worth


@dataclass
class OngoingRun:
    """A run in progress, and the outcomes of its frames so far.

    `names` are those of the maps so far, `expected` is how many maps there will be in all.
    """

    settings: ResolveSettings
    progress: "Progress"
    on_frame: Callable[[FrameReport], None]
    names: MapNames
    token: str = field(default_factory=lambda: os.urandom(8).hex())
    record: RunRecorder = field(init=False)
    expected: int = 0
    totals: RunTotals = field(default_factory=RunTotals)
    notes: FrameNotes = field(default_factory=FrameNotes)
    began: float = field(default_factory=time.monotonic)

    def outcomes(self, plans: Sequence[CapturePlan]) -> Outcomes:
        """Return a generator of the outcomes of some captures' frames. If a cluster is to do the work, connect to it."""
        tasks, workers = self._tasks(plans), self.settings.workers
        self.notes.warned.update((one.capture.root, _why(doubt)) for one in plans for doubt in one.doubts)
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

    def report_all(self, batches: Iterable[Batch]) -> RunTotals:
        """Record, count and show the outcomes of all frames; return the totals of this run.

        Raises:
            RunStoppedError: the output folder takes no more maps, or no more lines of the record.
            KeyboardInterrupt: the message says how to continue the run.
        """
        totals = self.totals
        try:
            for failed, batch in batches:
                with closing(batch) as outcomes:
                    for report in failed:
                        self.report(report)
                    for outcome in outcomes:
                        found, task = outcome.result, outcome.task
                        if isinstance(found, WorkerDied):
                            found = task.report("failed", _lost(task.sources[0], found), 0.0)
                        self.report(found)
            for why, count in self.notes.only_counted.items():
                self.progress.say(f"{self.settings.out}: {counted(count, 'more map')}: {why}")
            totals.seconds = round(time.monotonic() - self.began, 3)
            with self._needed():
                self.record.finish(totals.seconds)
        except KeyboardInterrupt as interrupt:
            done = totals.ok + totals.already_there
            told = f"{done} of {self.expected} frames are resolved; {self._same_command} goes on"
            raise KeyboardInterrupt(told) from interrupt
        return totals

    def report(self, report: FrameReport) -> None:
        """Record, count and show the report on a frame.

        Raises:
            RunStoppedError: the output folder takes no more maps.
        """
        if report.note is not None and self.notes.is_worth_telling(report.note, Path(report.source)):
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
            f"{why}, so the run stopped with {done} resolved; remove the cause, then {self._same_command} goes on"
        )

    @property
    def _same_command(self) -> str:
        """The command that continues this run, in words."""
        if self.settings.resume:
            return "the same command"
        return f"the same command with --resume{' in place of --overwrite' if self.settings.overwrite else ''}"

    def _tasks(self, plans: Sequence[CapturePlan]) -> Iterator[FrameTask]:
        """Yield the tasks of all plans. A task is drawn when a worker has room for it.

        The expected total is corrected when a plan has more or fewer tasks than expected.
        """
        self.expected += sum(one.expected_maps for one in plans)
        self.progress.advance(0, total=self.expected)
        for one in plans:
            number = 0
            try:
                for number, sources in enumerate(one.groups(taken=self.names.taken), start=1):
                    if number > one.expected_maps:
                        self.expected += 1
                    output = one.output(sources)
                    before = self.record.meet(sources, output) if self.record.resumed else None
                    if "/" in sources[0].name:
                        require_inside(self.settings.out, output.parent)
                        with self._needed(), writing(output.parent):
                            output.parent.mkdir(parents=True, exist_ok=True)
                    yield FrameTask(sources, one.reader, one.plan, output, self.settings.resume, before, self.token)
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
    sizes = [(math.prod(one.reader.pixels or (0,)), len(one.plan.metadata.modulation.harmonics)) for one in plans]
    per_pixel = settings.maps.resolver.seconds_per_pixel
    seconds = max((pixels * per_pixel(harmonics) for pixels, harmonics in sizes), default=0.0)
    return seconds > WORTH_SPLITTING_S and max(sizes)[0] <= MOST_PIXELS
