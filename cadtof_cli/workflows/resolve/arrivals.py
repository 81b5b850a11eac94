"""Frames whose paths arrive during a run, such as from a program that watches the folder of a camera."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import field, replace
from pathlib import Path

from cadtof_cli.capture.discovery import is_existing_folder
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CadtofError, CaptureError, OutputError, RunStoppedError
from cadtof_cli.files.reading import absolute, is_folder
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.earlier import earlier_shared_folder
from cadtof_cli.workflows.resolve.output import MapNames
from cadtof_cli.workflows.resolve.plans import AppliedCalibration, CapturePlan, captures_in, plan_captures
from cadtof_cli.workflows.resolve.reports import FrameReport, failed_input
from cadtof_cli.workflows.resolve.run_document import RunDocument
from cadtof_cli.workflows.resolve.run_json import RUN_FILE, RunRecord, resumable
from cadtof_cli.workflows.resolve.settings import ResolveSettings


@dataclass
class Arrivals:
    """The captures of a run that does not know all of its frames beforehand.

    Attributes:
        settings: settings of the run.
        batches: the paths that arrive during the run.
        base: folder whose tree OUT mirrors; None: it is not known yet.
        waiting: files of frames that wait for more files.
        failed: reports on inputs that failed before the run began.
        report: called with the report on each input that cannot be resolved; the run continues.
        calibration: the calibration that is applied; None: none.
        names: names of the maps of all captures that have come so far.
        document: content of `run.json`, to which inputs and captures are added.
        counted: inputs of an earlier run that is continued, with links resolved.
        known: plans of the captures that have come so far, by the folder of the capture.
    """

    settings: ResolveSettings
    batches: Iterable[tuple[Path, ...]]
    base: Path | None = None
    waiting: list[Path] = field(default_factory=list)
    failed: list[FrameReport] = field(default_factory=list)
    calibration: AppliedCalibration | None = None
    names: MapNames = field(init=False)
    document: RunDocument = field(init=False)
    counted: frozenset[str] = frozenset()
    known: dict[Path, CapturePlan] = field(default_factory=dict)
    report: Callable[[FrameReport], None] = field(init=False)

    def __post_init__(self) -> None:
        self.report = self.failed.append

    def first_captures(self, inputs: Sequence[Path], /) -> tuple[tuple[Capture, ...], Path]:
        """Return the captures of the inputs that are there when the run begins, and the folder whose tree OUT mirrors."""
        there = self._existing(inputs)
        self.base = earlier_shared_folder(self.settings.out) if self.settings.resume else None
        captures = self._captures(there or inputs)
        assert self.base is not None
        return captures, self.base

    def begin(
        self,
        plans: Sequence[CapturePlan],
        calibration: AppliedCalibration | None,
        names: MapNames,
        document: RunDocument,
        earlier: RunRecord | None,
        /,
    ) -> None:
        """Remember what is known of the first captures. Add to the `document` what an earlier run, which is continued, recorded.

        Raises:
            OutputError: `earlier` is not the record of a run.
        """
        self.calibration, self.names, self.document = calibration, names, document
        for one in plans:
            self.known.setdefault(one.capture.root, one)
        if earlier is not None:
            with resumable(self.settings.out / RUN_FILE):
                self.counted = document.continue_from(earlier, plans)

    def _existing(self, paths: Iterable[Path]) -> list[Path]:
        """Return the paths that exist; each of the others is a frame that failed.

        A program that watches a folder also names files that are removed or renamed a moment later.
        """
        there = []
        for path in paths:
            try:
                is_existing_folder(path)
                there.append(path)
            except CaptureError as error:
                self.report(failed_input(path, error))
        return there

    def plans(self, report: Callable[[FrameReport], None], /) -> Iterator[list[CapturePlan]]:
        """Yield the plans for each batch of paths, and add the batch to the document. A failure is reported when it is found.

        A frame of several files waits for all of its files.
        """
        self.report = report
        inputs = set(self.document["arguments"]["resolved_inputs"])
        for paths in self.batches:
            self.document.add_inputs(paths, inputs)
            yield self._planned(paths)
        while self.waiting:
            # no more files will come: each frame is tried with the files that are there
            yield self._planned((), last=True)

    def _planned(self, paths: Iterable[Path], *, last: bool = False) -> list[CapturePlan]:
        there = self._existing((*self.waiting, *paths))
        self.waiting = []
        found: list[CapturePlan] = []
        for folder, named in _by_folder(there).items():
            try:
                found += self._known(self._captures(named, last=last))
            except RunStoppedError:
                raise
            except CadtofError as error:
                self.report(failed_input(folder if len(named) > 1 else named[0], error))
        self.document.add_captures(found, self.counted)
        return found

    def _captures(self, paths: Sequence[Path], *, last: bool = False) -> tuple[Capture, ...]:
        """Return the captures of paths. Unless these are the last paths, frames that lack files wait for them."""
        captures, self.base = captures_in(paths, self.settings, self.report, base=self.base)
        if not last:
            captures, waiting = _without_incomplete_frames(captures, paths, self.settings)
            self.waiting += waiting
        return captures

    def _known(self, captures: Sequence[Capture]) -> list[CapturePlan]:
        """Return the plans of captures; a capture that has come before keeps its plan."""
        new = plan_captures([one for one in captures if one.root not in self.known], self.settings, self.calibration)
        plans = [
            replace(known, capture=replace(known.capture, frames=one.frames), typical=None)
            for one in captures
            if (known := self.known.get(one.root))
        ] + new
        own = []
        for one in plans:
            own.append(self._with_own_places(one))
            self.known.setdefault(one.capture.root, own[-1])
        return own

    def _with_own_places(self, plan: CapturePlan) -> CapturePlan:
        """Return a plan without the frames whose maps would replace those of another frame. Each is reported as failed."""
        own = []
        for frame in plan.capture.frames:
            first = frame.paths[0]
            other = self.names.take(frame.name, first)
            if other == first or absolute(other) == absolute(first):
                own.append(frame)
                continue
            error = OutputError(f"{first} would be written as {self.settings.out}/{frame.name}, as {other} was")
            self.report(failed_input(frame, error))
        if len(own) == len(plan.capture.frames):
            return plan
        return replace(plan, capture=replace(plan.capture, frames=tuple(own)))


def _without_incomplete_frames(
    captures: Sequence[Capture], paths: Sequence[Path], settings: ResolveSettings
) -> tuple[tuple[Capture, ...], list[Path]]:
    """Return captures without the frames that have to wait, and the files of the frames that wait.

    A frame of several files waits until all of them are named. Frames that are averaged wait until there are enough of them.
    A capture that was named as a folder is complete.
    """
    given, incomplete, whole = set(map(absolute, paths)), set[Path](), []
    for capture in captures:
        files = {absolute(path) for frame in capture.frames for path in frame.paths} & given
        frames = capture.frames
        if files:
            frames = tuple(one for one in frames if len(one.paths) == 1 or given.issuperset(map(absolute, one.paths)))
            frames = frames[: len(frames) - len(frames) % settings.maps.average]
            incomplete |= files.difference(absolute(path) for frame in frames for path in frame.paths)
        if frames:
            whole.append(replace(capture, frames=frames))
    return tuple(whole), [path for path in paths if absolute(path) in incomplete] if incomplete else []


def _by_folder(paths: Iterable[Path]) -> dict[Path, list[Path]]:
    """Return paths by the folder that they lie in; a path that is a folder counts as lying in itself."""
    folders: dict[Path, list[Path]] = {}
    for path in dict.fromkeys(paths):
        folders.setdefault(path if is_folder(path) else path.parent, []).append(path)
    return folders
