"""`cadtof resolve`: captures in, one map file a frame out, with a record of the run beside them."""

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal
from uuid import uuid4

from cadtof_cli.capture.discovery import Capture, find_captures
from cadtof_cli.capture.stacks import first_pixels, single_frames
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.ordered import Outcome, WorkerDied, run_ordered
from cadtof_cli.execution.workers import StartMethod, available_cores, default_start_method
from cadtof_cli.files.atomic import remove_partial_files
from cadtof_cli.files.frames import FrameSource
from cadtof_cli.pipeline import DepthKind, FramePlan
from cadtof_cli.resolver.settings import ResolverSettings
from cadtof_cli.workflows.resolve.frame_task import FrameReport, FrameTask, resolve_file
from cadtof_cli.workflows.resolve.plan import require_known_volts
from cadtof_cli.workflows.resolve.run_record import RunRecord, prepare_output
from cadtof_cli.workflows.resolve.split_frames import resolve_split, worth_splitting
from cadtof_cli.workflows.resolve.use_calibration import use_calibration

MapFormat = Literal["exr", "tif", "same"]

MAP_FORMATS: tuple[MapFormat, ...] = ("exr", "tif", "same")


@dataclass(frozen=True, kw_only=True)
class ResolveSettings:
    """Everything that a user can choose about a run, besides the inputs and what overrides `capture.toml`."""

    out: Path
    resolver: ResolverSettings = field(default_factory=ResolverSettings)
    depth: DepthKind = "range"
    pool: int = 1
    average: int = 1
    calibration: Path | None = None
    map_format: MapFormat = "same"
    jobs: int = field(default_factory=available_cores)
    start_method: StartMethod = field(default_factory=default_start_method)
    overwrite: bool = False
    resume: bool = False

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise SettingsError(f"--jobs: found {self.jobs}, expected 1 or more")
        if self.overwrite and self.resume:
            raise SettingsError("--overwrite and --resume exclude each other: replace the old maps, or keep them")
        if self.map_format not in MAP_FORMATS:
            raise SettingsError(f"--format: found {self.map_format!r}, expected one of {', '.join(MAP_FORMATS)}")


@dataclass
class RunTotals:
    """What has become of the frames so far."""

    frames: int = 0
    ok: int = 0
    failed: int = 0
    skipped: int = 0
    one_path: int = 0
    two_paths: int = 0
    more_paths: int = 0
    invalid: int = 0
    seconds: float = 0.0

    def add(self, report: FrameReport) -> None:
        """Count one more frame."""
        self.frames += 1
        setattr(self, report.status, getattr(self, report.status) + 1)
        for name in ("one_path", "two_paths", "more_paths", "invalid"):
            setattr(self, name, getattr(self, name) + (getattr(report, name) or 0))


@dataclass(frozen=True)
class Progress:
    """Callbacks of a run: how many frames are known of, each frame's report as it comes, and notes for the user."""

    on_total: Callable[[int], None]
    on_frame: Callable[[FrameReport], None]
    on_note: Callable[[str], None]


def resolve_captures(
    inputs: Sequence[Path],
    /,
    *,
    settings: ResolveSettings,
    overrides: Mapping[str, Any],
    arguments: Mapping[str, Any],
    progress: Progress,
) -> RunTotals:
    """Resolve every frame of the inputs into a file of maps in `settings.out`; frames fail alone.

    Args:
        inputs: folders of frames, and single files.
        settings: what to do.
        overrides: values by dotted key that replace those of `capture.toml`.
        arguments: what the user asked for, as it goes into `run.json`.
        progress: told of every frame, in the order of the inputs whatever the number of processes.

    Raises:
        CadtofError: nothing can be resolved: an input, the metadata, the settings or the output folder is at fault.
    """
    captures = find_captures(inputs, overrides=overrides)
    calibration = use_calibration(settings.calibration, captures) if settings.calibration else None
    plans = [
        FramePlan(
            metadata=capture.source.metadata,
            resolver=settings.resolver,
            depth=settings.depth,
            pool=settings.pool,
            average=settings.average,
            calibration=calibration.use if calibration else None,
        )
        for capture in captures
    ]
    for capture in captures:
        require_known_volts(capture)
    layers = {name: unit for plan in plans for name, unit in plan.layers.units.items()}
    record = RunRecord(settings.out, arguments=arguments, captures=captures, layers=layers, calibration=calibration)
    prepare_output(captures, settings.out, overwrite=settings.overwrite, resume=settings.resume)
    if settings.resume:
        record.require_same_settings()
    for capture in captures:
        _note_defaults(capture, progress.on_note)
    for note in calibration.notes if calibration else ():
        progress.on_note(note)
    totals, began, token = RunTotals(), time.monotonic(), uuid4().hex[:8]
    tasks = _tasks(captures, plans, settings, progress, token)
    jobs, start_method = settings.jobs, settings.start_method
    if _are_worth_splitting(captures, plans, settings):
        outcomes = resolve_split(tasks, jobs=jobs, start_method=start_method)
    else:
        outcomes = run_ordered(resolve_file, tasks, jobs=jobs, start_method=start_method)
    try:
        with record.opened(append=settings.resume), closing(outcomes):
            for outcome in outcomes:
                report = _report(outcome)
                totals.add(report)
                record.add(report)
                progress.on_frame(report)
            totals.seconds = round(time.monotonic() - began, 3)
            record.finish(asdict(totals))
    finally:
        remove_partial_files(settings.out, token=token)
    return totals


def _tasks(
    captures: Sequence[Capture], plans: Sequence[FramePlan], settings: ResolveSettings, progress: Progress, token: str
) -> Iterator[FrameTask]:
    """Yield the run's tasks; they are drawn as places for them come free."""
    total = _task_count(captures, settings)
    progress.on_total(total)
    for capture, plan in zip(captures, plans, strict=True):
        layout, pixels = capture.layout, first_pixels(capture)
        known = -(-len(capture.frames) // settings.average)
        for count, sources in enumerate(_groups(single_frames(capture), settings.average), start=1):
            if count > known:
                known, total = count, total + 1
                progress.on_total(total)
            yield FrameTask(
                sources,
                layout,
                plan,
                pixels,
                settings.out / f"{sources[0].name}{_suffix(sources[0], settings.map_format)}",
                keep_existing=settings.resume,
                token=token,
            )


def _groups(sources: Iterable[FrameSource], size: int) -> Iterator[tuple[FrameSource, ...]]:
    """Yield consecutive frames by `size`; the last group holds what is left."""
    waiting = iter(sources)
    while group := tuple(itertools.islice(waiting, size)):
        yield group


def _task_count(captures: Iterable[Capture], settings: ResolveSettings) -> int:
    """Return how many maps there will be, as far as the files' names tell."""
    return sum(-(-len(capture.frames) // settings.average) for capture in captures)


def _are_worth_splitting(captures: Sequence[Capture], plans: Sequence[FramePlan], settings: ResolveSettings) -> bool:
    tasks = _task_count(captures, settings)
    if tasks >= settings.jobs:
        return False
    seconds = [
        plan.expected_seconds(math.prod(first_pixels(capture) or (0,)))
        for capture, plan in zip(captures, plans, strict=True)
    ]
    return worth_splitting(tasks, settings.jobs, max(seconds))


def _suffix(source: FrameSource, map_format: MapFormat) -> str:
    if map_format == "same":
        return ".exr" if source.paths[0].suffix.lower() == ".exr" else ".tif"
    return f".{map_format}"


def _report(outcome: Outcome[FrameTask, FrameReport]) -> FrameReport:
    if isinstance(outcome.result, WorkerDied):
        reason = "the worker process died twice on this frame (killed, or out of memory): try fewer --jobs"
        return FrameReport(str(outcome.task.sources[0]), None, "failed", reason, 0.0)
    return outcome.result


def _note_defaults(capture: Capture, on_note: Callable[[str], None]) -> None:
    taken = [f"{key} = {value}" for key, value in capture.source.defaulted.items()]
    if taken:
        on_note(f"{capture.root}: not given, so taken from the paper: {', '.join(taken)}")
    if capture.source.metadata.pixel.integration_length is None:
        on_note(f"{capture.root}: pixel.integration_length is not given, so the noise is estimated from each frame")
