"""`cadtof resolve`: captures in, one map file a frame out, with a record of the run beside them."""

import itertools
import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from cadtof_cli import __version__
from cadtof_cli.capture.discovery import Capture
from cadtof_cli.execution.ordered import Outcome, WorkerDied, run_ordered
from cadtof_cli.execution.workers import LOCAL
from cadtof_cli.files.atomic import PARTIAL_SUFFIX, make_folders, remove_partial_files
from cadtof_cli.resolver.status import MEANING
from cadtof_cli.resolver.two_path.kernel import chosen_kernel, kernel_notes
from cadtof_cli.workflows.progress import UNTOLD, Progress
from cadtof_cli.workflows.resolve import split_frames
from cadtof_cli.workflows.resolve.arrivals import Arrivals, held_back
from cadtof_cli.workflows.resolve.frame_task import FrameTask, resolve_file
from cadtof_cli.workflows.resolve.plans import CapturePlan, found_captures, planned
from cadtof_cli.workflows.resolve.settings import ResolveSettings
from cadtof_cli.workflows.resolve.use_calibration import AppliedCalibration, use_calibration
from cadtof_cli.workflows.run_folder import FrameReport, prepare_output, recorded_run, require_same_maps

DIED = "the worker process died twice on this frame (killed, or out of memory): try fewer --jobs"


@dataclass
class RunTotals:
    """What has become of the frames so far; `diffuse_frames` are those whose MPI was taken for diffuse."""

    frames: int = 0
    ok: int = 0
    failed: int = 0
    skipped: int = 0
    one_path: int = 0
    two_paths: int = 0
    more_paths: int = 0
    diffuse: int = 0
    diffuse_frames: int = 0
    invalid: int = 0
    seconds: float = 0.0

    def add(self, report: FrameReport) -> None:
        """Count one more frame."""
        self.frames += 1
        setattr(self, report.status, getattr(self, report.status) + 1)
        for name in ("one_path", "two_paths", "more_paths", "diffuse", "invalid"):
            setattr(self, name, getattr(self, name) + (getattr(report, name) or 0))
        self.diffuse_frames += bool(report.diffuse)


def resolve_captures(
    inputs: Sequence[Path],
    /,
    *,
    settings: ResolveSettings,
    overrides: Mapping[str, Any],
    arriving: Iterable[tuple[Path, ...]] | None = None,
    progress: Progress = UNTOLD,
    on_frame: Callable[[FrameReport], None] = lambda _: None,
) -> RunTotals:
    """Resolve every frame of the inputs into a file of maps in `settings.out`; frames fail alone.

    Args:
        inputs: folders of frames, and single files.
        arriving: more of them, in batches that come while the run goes on.
        settings: what to do.
        overrides: values by dotted key that replace those of `capture.toml`.
        progress: a step is a file of maps.
        on_frame: called with every report, in the order of the inputs whatever the number of processes.

    Raises:
        CadtofError: nothing can be resolved: an input, the metadata, the settings or the output folder is at fault.
    """
    captures, base = found_captures(inputs, settings, overrides)
    captures, waiting = (captures, []) if arriving is None else held_back(captures, inputs, settings)
    calibration = use_calibration(settings.calibration, captures) if settings.calibration else None
    plans = planned(captures, settings, calibration)
    document = _document(inputs, overrides, settings, plans, calibration)
    prepare_output(captures, settings.out, overwrite=settings.overwrite, resume=settings.resume)
    if settings.resume:
        require_same_maps(settings.out, document)
    of_calibration = calibration.notes if calibration else ()
    for note in (*(note for one in plans for note in one.notes()), *of_calibration, *kernel_notes()):
        progress.say(note)
    totals, began, token = RunTotals(), time.monotonic(), uuid4().hex[:8]
    steps = _Steps(progress)
    try:
        first = _outcomes(plans, settings, steps, token)
        with recorded_run(settings.out, document, resume=settings.resume) as record:

            def tell(report: FrameReport) -> None:
                totals.add(report)
                record.add(report)
                on_frame(report)
                progress.advance()

            arrivals = Arrivals(settings, overrides, calibration, base, tell, waiting)
            arrivals.meet(plans)
            for some in itertools.chain([plans], arrivals.plans(_recorded(arriving or (), document))):
                if some is not plans:
                    _record_captures(document, some)
                with closing(first if some is plans else _outcomes(some, settings, steps, token)) as outcomes:
                    for outcome in outcomes:
                        report = outcome.result
                        tell(outcome.task.report("failed", DIED, 0.0) if isinstance(report, WorkerDied) else report)
            totals.seconds = round(time.monotonic() - began, 3)
            record.finish(asdict(totals))
    finally:
        remove_partial_files(settings.out, token=token)
    return totals


def _outcomes(
    plans: Sequence[CapturePlan], settings: ResolveSettings, steps: "_Steps", token: str
) -> Generator[Outcome[FrameTask, FrameReport], None, None]:
    """Return a generator of what becomes of the frames of some captures; a cluster that is meant to do it is connected to."""
    tasks = _tasks(plans, settings, steps, token)
    if _are_worth_splitting(plans, settings):
        return split_frames.resolve_split(tasks, workers=settings.workers)
    probe = _probe(settings, token)
    return run_ordered(resolve_file, tasks, workers=settings.workers, probe=probe, say=steps.progress.say)


def _probe(settings: ResolveSettings, token: str) -> Path | None:
    """Make a file in the run's folder that is removed with what is half-written, for workers of a cluster to look for."""
    if settings.workers.scheduler == LOCAL:
        return None
    probe = settings.out / f".cluster.{token}{PARTIAL_SUFFIX}"
    probe.write_text(token)
    return probe


def _recorded(batches: Iterable[tuple[Path, ...]], document: Mapping[str, Any]) -> Iterator[tuple[Path, ...]]:
    """Yield the batches of paths, each added to the inputs that `run.json` will name."""
    for paths in batches:
        document["arguments"]["inputs"] += map(str, paths)
        document["arguments"]["absolute_inputs"] += (str(path.absolute()) for path in paths)
        yield paths


def _record_captures(document: Mapping[str, Any], plans: Iterable[CapturePlan]) -> None:
    """Add captures, or their further files, to those that `run.json` names."""
    for capture in (one.capture for one in plans):
        known = next((one for one in document["captures"] if one["root"] == str(capture.root)), None)
        if known is None:
            document["captures"].append(_as_json(capture))
        else:
            known["files"] += len(capture.frames)


def _as_json(capture: Capture) -> dict[str, Any]:
    return {
        "root": str(capture.root),
        "files": len(capture.frames),
        "metadata": asdict(capture.source.metadata),
        "origins": dict(capture.source.origins),
    }


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
            "recursive": settings.recursive,
            "settings": settings.settings_file and str(settings.settings_file.absolute()),
            "frames": settings.frames and [settings.frames.start, settings.frames.stop],
            "overwrite": settings.overwrite,
            "resume": settings.resume,
            "overrides": dict(overrides),
        },
        "captures": [_as_json(one.capture) for one in plans],
        "calibration": calibration and calibration.as_json(),
        "layers": {layer.name: layer.unit for one in plans for layer in one.plan.layers},
        "status_bits": {bit.name: int(bit) for bit in MEANING},
    }


class _Steps:
    """How many files of maps there will be, as far as is known."""

    def __init__(self, progress: Progress) -> None:
        self.progress, self._total = progress, 0

    def expect(self, more: int) -> None:
        """There are so many more, or fewer."""
        self._total += more
        self.progress.total(self._total)


def _tasks(plans: Sequence[CapturePlan], settings: ResolveSettings, steps: _Steps, token: str) -> Iterator[FrameTask]:
    """Yield the run's tasks; they are drawn as places for them come free."""
    expected = [one.expected_maps(settings) for one in plans]
    steps.expect(sum(expected))
    for one, count in zip(plans, expected, strict=True):
        layout, waiting = one.capture.layout, one.frames(settings)
        for number in itertools.count(1):
            sources = tuple(itertools.islice(waiting, settings.maps.average))
            if not sources:
                steps.expect(min(number - 1 - count, 0))
                break
            if number > count:
                steps.expect(1)
            output = one.output(sources[0], settings)
            if "/" in sources[0].name:
                make_folders(output.parent)
            yield FrameTask(sources, layout, one.plan, one.pixels, output, keep_existing=settings.resume, token=token)


def _are_worth_splitting(plans: Sequence[CapturePlan], settings: ResolveSettings) -> bool:
    """Whether frames are so few and so slow that their pixels should be spread over the processes."""
    workers = settings.workers
    if workers.scheduler != LOCAL or sum(one.expected_maps(settings) for one in plans) >= workers.jobs:
        return False
    seconds = (one.plan.expected_seconds(math.prod(one.pixels or (0,))) for one in plans)
    return max(seconds, default=0.0) > split_frames.WORTH_SPLITTING_S
