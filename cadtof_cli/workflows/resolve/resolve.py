"""`cadtof resolve`: captures in, one map file a frame out, with a record of the run beside them."""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from cadtof_cli import __version__
from cadtof_cli.capture.discovery import Capture, find_captures
from cadtof_cli.capture.frames import first_frames, single_frames
from cadtof_cli.errors import SettingsError
from cadtof_cli.execution.ordered import WorkerDied, run_ordered
from cadtof_cli.files.atomic import remove_partial_files
from cadtof_cli.files.formats import format_named, map_suffix_like
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.phasors.voltages import volts_per_count
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.resolver.two_path.kernel import chosen_kernel, kernel_notes
from cadtof_cli.workflows.progress import UNTOLD, Progress
from cadtof_cli.workflows.resolve import split_frames
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from cadtof_cli.workflows.resolve.settings import AS_INPUT, ResolveSettings
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration, use_calibration
from cadtof_cli.workflows.run_folder import FrameReport, prepare_output, recorded_run, require_same_maps

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
    prepare_output(captures, settings.out, overwrite=settings.overwrite, resume=settings.resume)
    if settings.resume:
        require_same_maps(settings.out, document)
    of_calibration = calibration.notes if calibration else ()
    for note in (*itertools.chain(*map(_notes, captures)), *of_calibration, *kernel_notes()):
        progress.say(note)
    totals, began, token = RunTotals(), time.monotonic(), uuid4().hex[:8]
    tasks = _tasks(plans, settings, progress, token)
    if _are_worth_splitting(plans, settings):
        outcomes = split_frames.resolve_split(tasks, workers=settings.workers)
    else:
        outcomes = run_ordered(resolve_file, tasks, workers=settings.workers)
    try:
        with recorded_run(settings.out, document, resume=settings.resume) as record, closing(outcomes):
            for outcome in outcomes:
                report = outcome.result
                if isinstance(report, WorkerDied):
                    report = outcome.task.report("failed", DIED, 0.0)
                totals.add(report)
                record.add(report)
                on_frame(report)
                progress.advance()
            totals.seconds = round(time.monotonic() - began, 3)
            record.finish(asdict(totals))
    finally:
        remove_partial_files(settings.out, token=token)
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
            "out": str(settings.out),
            **asdict(maps.resolver),
            "min_confidence": maps.min_confidence_v,
            "depth": maps.depth,
            "pool": maps.pool,
            "average": maps.average,
            "calibration": settings.calibration and str(settings.calibration),
            "map_format": settings.map_format,
            "overwrite": settings.overwrite,
            "resume": settings.resume,
            "overrides": dict(overrides),
        },
        "captures": [
            {
                "root": str(capture.root),
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


def _tasks(
    plans: Sequence[CapturePlan], settings: ResolveSettings, progress: Progress, token: str
) -> Iterator[FrameTask]:
    """Yield the run's tasks; they are drawn as places for them come free."""
    total = sum(one.expected_maps for one in plans)
    progress.total(total)
    for one in plans:
        layout, waiting = one.capture.layout, single_frames(one.capture)
        for number in itertools.count(1):
            sources = tuple(itertools.islice(waiting, settings.maps.average))
            if not sources:
                break
            if number > one.expected_maps:
                total += 1
                progress.total(total)
            same = settings.map_format == AS_INPUT
            suffix = map_suffix_like(sources[0].paths[0]) if same else format_named(settings.map_format).suffix
            output = settings.out / f"{sources[0].name}{suffix}"
            yield FrameTask(sources, layout, one.plan, one.pixels, output, keep_existing=settings.resume, token=token)


def _are_worth_splitting(plans: Sequence[CapturePlan], settings: ResolveSettings) -> bool:
    """Whether frames are so few and so slow that their pixels should be spread over the processes."""
    if sum(one.expected_maps for one in plans) >= settings.workers.jobs:
        return False
    seconds = (one.plan.expected_seconds(math.prod(one.pixels or (0,))) for one in plans)
    return max(seconds) > split_frames.WORTH_SPLITTING_S
