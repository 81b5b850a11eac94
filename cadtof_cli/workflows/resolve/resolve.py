"""`cadtof resolve`: captures in, one map file a frame out, with a record of the run beside them."""

import itertools
import math
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex
from typing import Any

from cadtof_cli import __version__
from cadtof_cli.capture.discovery import Capture, find_captures
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import first_frames, single_frames
from cadtof_cli.errors import RunStoppedError, SettingsError
from cadtof_cli.execution.ordered import WorkerDied, run_ordered
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.atomic import make_folder, remove_partial_files
from cadtof_cli.files.formats import MAP_FORMATS, format_named, map_suffix_like
from cadtof_cli.files.lock import locked
from cadtof_cli.frame_plan import FramePlan, MapSettings
from cadtof_cli.phasors.voltages import volts_per_count
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.resolver.two_path.kernel import chosen_kernel, kernel_notes
from cadtof_cli.workflows.progress import UNTOLD, Progress
from cadtof_cli.workflows.resolve import split_frames
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from cadtof_cli.workflows.resolve.output import frame_names, prepare_output
from cadtof_cli.workflows.resolve.record import RunRecorder, recorded_run
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration, use_calibration
from cadtof_cli.workflows.run_folder import FrameReport, RunTotals

AS_INPUT = "same"

FORMAT_CHOICES = (*MAP_FORMATS, AS_INPUT)

DIED = "the worker process died twice on this frame (killed, or out of memory): try fewer --jobs"


@dataclass(frozen=True)
class CapturePlan:
    """A capture, what to do with its frames, and their (Y, X); None where no frame can be opened."""

    capture: Capture
    plan: FramePlan
    pixels: tuple[int, int] | None

    @property
    def expected_maps(self) -> int:
        """How many maps there will be, as far as the files' names tell."""
        return -(-len(self.capture.frames) // self.plan.settings.average)


@dataclass(frozen=True, kw_only=True)
class ResolveSettings:
    """Everything that a user can choose about a run, besides the inputs and what overrides `capture.toml`.

    Attributes:
        out: folder of the run.
        maps: what the maps are.
        calibration: folder of the calibration that is applied.
        map_format: of the map files; `same` is that of the frames.
        workers: what the work is done by.
        overwrite: whether the files of an earlier run may be replaced.
        resume: whether the maps of an earlier run are kept, and only those that are missing made.
    """

    out: Path
    maps: MapSettings = field(default_factory=MapSettings)
    calibration: Path | None = None
    map_format: str = AS_INPUT
    workers: Workers = field(default_factory=Workers)
    overwrite: bool = False
    resume: bool = False

    def __post_init__(self) -> None:
        if self.overwrite and self.resume:
            raise SettingsError("--overwrite and --resume exclude each other: replace the old maps, or keep them")
        if self.map_format not in FORMAT_CHOICES:
            raise SettingsError(f"--format: found {self.map_format!r}, expected one of {', '.join(FORMAT_CHOICES)}")


def resolve_captures(
    inputs: Sequence[Path],
    /,
    *,
    settings: ResolveSettings,
    overrides: Mapping[str, Any],
    progress: Progress = UNTOLD,
    on_frame: Callable[[FrameReport], None] = lambda _: None,
) -> RunTotals:
    """Resolve every frame of the inputs into a file of maps in `settings.out`; frames fail alone.

    Args:
        inputs: folders of frames, and single files.
        settings: what to do.
        overrides: values by dotted key that replace those of `capture.toml`.
        progress: a step is a file of maps.
        on_frame: called with every report, in the order of the inputs whatever the number of processes.

    Raises:
        CadtofError: nothing can be resolved: an input, the metadata, the settings or the output folder is at fault.
    """
    captures = find_captures(inputs, overrides=overrides)
    calibration = use_calibration(settings.calibration, captures) if settings.calibration else None
    plans = _plans(captures, settings, calibration)
    document = _document(inputs, overrides, settings, plans, calibration)
    names = frame_names(captures, settings.out)
    make_folder(settings.out)
    with locked(settings.out):
        resumed = prepare_output(settings.out, names, document, overwrite=settings.overwrite, resume=settings.resume)
        of_calibration = calibration.notes if calibration else ()
        for note in (*itertools.chain(*map(_notes, captures)), *of_calibration, *kernel_notes()):
            progress.say(note)
        token = token_hex(8)
        try:
            with recorded_run(settings.out, document, resume=resumed, say=progress.say) as record:
                return _resolve_frames(_Drawn(plans, settings, names, record, token), record, progress, on_frame)
        finally:
            remove_partial_files(settings.out, token=token)


def _resolve_frames(
    drawn: "_Drawn", record: RunRecorder, progress: Progress, on_frame: Callable[[FrameReport], None]
) -> RunTotals:
    """Resolve the frames, and record, count and tell what becomes of each.

    Raises:
        RunStoppedError: the output folder takes no more maps.
    """
    totals, began, settings = RunTotals(), time.monotonic(), drawn.settings
    tasks = drawn.tasks(progress)
    if _are_worth_splitting(drawn.plans, settings):
        outcomes = split_frames.resolve_split(tasks, workers=settings.workers)
    else:
        outcomes = run_ordered(resolve_file, tasks, workers=settings.workers)
    with closing(outcomes):
        for outcome in outcomes:
            report = outcome.result
            if isinstance(report, WorkerDied):
                report = outcome.task.report("failed", _lost(report), 0.0)
            totals.add(report)
            if report.note is not None:
                progress.say(report.note)
            record.add(report)
            on_frame(report)
            if report.stops:
                raise RunStoppedError(
                    f"{settings.out}: takes no more maps, so the run stopped there, {totals.ok} frames resolved; "
                    "mend that and go on with --resume"
                )
            progress.advance()
        totals.seconds = round(time.monotonic() - began, 3)
        record.finish(totals.seconds)
    return totals


def _plans(
    captures: Sequence[Capture], settings: ResolveSettings, calibration: AppliedCalibration | None
) -> list[CapturePlan]:
    """Return what to do with each capture.

    Raises:
        SettingsError: its settings do not allow it; or its values are integers and nothing says how many volts a count is.
    """
    use = calibration.use if calibration else None
    plans: list[CapturePlan] = []
    for capture in captures:
        metadata, first = capture.source.metadata, first_frames(capture)
        plan = FramePlan(metadata=metadata, settings=settings.maps, calibration=use)
        plans.append(CapturePlan(capture, plan, None if first is None else (first.shape[2], first.shape[3])))
        try:
            if first is not None:
                volts_per_count(metadata.voltage, first.dtype)
        except SettingsError as error:
            raise SettingsError(f"{capture.root}: {error}") from error
    return plans


def _document(
    inputs: Sequence[Path],
    overrides: Mapping[str, Any],
    settings: ResolveSettings,
    plans: Sequence[CapturePlan],
    calibration: AppliedCalibration | None,
) -> dict[str, Any]:
    """Return what `run.json` says of a run that begins; its arguments have the names of the options."""
    maps = settings.maps
    return {
        "cadtof": __version__,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "finished": False,
        "kernel": chosen_kernel(),
        "arguments": {
            "inputs": [str(path) for path in inputs],
            "absolute_inputs": [str(path.absolute()) for path in inputs],
            "resolved_inputs": [str(path.resolve()) for path in inputs],
            "out": str(settings.out),
            **asdict(maps.resolver),
            "min_confidence": maps.min_confidence_v,
            "depth": maps.depth,
            "pool": maps.pool,
            "average": maps.average,
            "calibration": settings.calibration and str(settings.calibration),
            "map_format": settings.map_format,
            "overrides": dict(overrides),
        },
        "captures": [
            {
                "root": str(capture.root),
                "resolved_root": str(capture.root.resolve()),
                "files": len(capture.frames),
                "metadata": asdict(capture.source.metadata),
                "origins": dict(capture.source.origins),
            }
            for capture in (one.capture for one in plans)
        ],
        "calibration": calibration and calibration.as_json(),
        "layers": {layer.name: layer.unit for one in plans for layer in one.plan.layers},
        "status_bits": {bit.name: int(bit) for bit in MEANING},
    }


def _notes(capture: Capture) -> Iterator[str]:
    """Yield what is taken for granted about a capture."""
    taken = [f"{key} = {value}" for key, value in capture.source.defaulted.items()]
    if taken:
        yield f"{capture.root}: not given, so taken from the paper: {', '.join(taken)}"
    if capture.source.metadata.pixel.integration_length is None:
        yield f"{capture.root}: pixel.integration_length is not given, so the noise is estimated from each frame"


@dataclass(frozen=True)
class _Drawn:
    """What tasks are drawn from, as places for them come free."""

    plans: Sequence[CapturePlan]
    settings: ResolveSettings
    names: Collection[str]
    record: RunRecorder
    token: str

    def tasks(self, progress: Progress) -> Iterator[FrameTask]:
        """Yield the run's tasks; their number is known when the last stack has been opened."""
        total = sum(one.expected_maps for one in self.plans)
        progress.total(total)
        for one in self.plans:
            waiting = single_frames(one.capture, taken=self.names)
            for number in itertools.count(1):
                sources = tuple(itertools.islice(waiting, self.settings.maps.average))
                if not sources:
                    break
                if number > one.expected_maps:
                    total += 1
                    progress.total(total)
                yield self._task(one, sources)

    def _task(self, one: CapturePlan, sources: tuple[FrameSource, ...]) -> FrameTask:
        same = self.settings.map_format == AS_INPUT
        suffix = map_suffix_like(sources[0].paths[0]) if same else format_named(self.settings.map_format).suffix
        output = self.settings.out / f"{sources[0].name}{suffix}"
        return FrameTask(
            sources,
            one.capture.layout,
            one.plan,
            one.pixels,
            output,
            resume=self.settings.resume,
            before=self.record.before(output),
            token=self.token,
        )


def _lost(worker: WorkerDied) -> str:
    """Return why a frame has no maps whose worker was lost twice."""
    if worker.after_s is None:
        return DIED
    return f"not done in the {worker.after_s:g} s of --frame-timeout, twice: does the place that it lies in answer?"


def _are_worth_splitting(plans: Sequence[CapturePlan], settings: ResolveSettings) -> bool:
    """Whether frames are so few and so slow that their pixels should be spread over the processes."""
    if sum(one.expected_maps for one in plans) >= settings.workers.processes:
        return False
    seconds = (one.plan.expected_seconds(math.prod(one.pixels or (0,))) for one in plans)
    return max(seconds) > split_frames.WORTH_SPLITTING_S
