"""Slow frames in parts: this process reads, prepares and writes each frame, and workers resolve the parts of its pixels."""

import itertools
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from typing import Any

from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.execution.ordered import run_ordered
from cadtof_cli.execution.outcome import Outcome, WorkerDied
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.pipeline.frame import joined_parts, prepare_frame, resolve_pixels, stages_of
from cadtof_cli.pipeline.stages import FramePixels, frame_stages
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.recording import Recording
from cadtof_cli.workflows.resolve.frame_task import FrameTask, kept_maps, reported, written
from cadtof_cli.workflows.resolve.reports import FrameReport


@dataclass(frozen=True)
class FramePart:
    """A part of a frame's pixels, or the report on a frame that is not resolved; of the first part, how the frame was read."""

    task: FrameTask
    pixels: FramePixels | FrameReport
    recording: Recording | None

    def __reduce__(self) -> tuple[type["FramePart"], tuple[Any, ...]]:
        """Return how pickle makes a copy for a worker, which does not need the whole frame."""
        return FramePart, (self.task, self.pixels, None)


def resolve_part(part: FramePart, /) -> DepthMaps | FrameReport:
    """Resolve a part of a frame's pixels. Every error becomes a report."""
    keep_freed_memory()
    return part.pixels if isinstance(part.pixels, FrameReport) else _resolved(part.task, part.pixels)


@reported
def _resolved(task: FrameTask, pixels: FramePixels) -> DepthMaps:
    return resolve_pixels(pixels, frame_stages(task.plan, task.plan.read_calibration(), pixels.dtype, pixels.size))


def resolve_split(
    tasks: Iterable[FrameTask], /, *, workers: Workers
) -> Generator[Outcome[FrameTask, FrameReport], None, None]:
    """Resolve and write every frame, in the order of the tasks. Each frame has as many parts as there are jobs."""
    parts = (part for task in tasks for part in _parts(task, workers.jobs))
    resolved: Generator[Outcome[FramePart, DepthMaps | FrameReport], None, None]
    resolved = run_ordered(resolve_part, parts, workers=workers)
    with closing(resolved) as outcomes:
        while frame := list(itertools.islice(outcomes, workers.jobs)):
            yield _joined(frame)


def _parts(task: FrameTask, count: int) -> Iterator[FramePart]:
    """Yield the parts of a frame; if it has no parts, yield the report on it as many times."""
    parts = _prepared(task, count)
    yield from [FramePart(task, parts, None)] * count if isinstance(parts, FrameReport) else parts


@reported
def _prepared(task: FrameTask, count: int) -> FrameReport | list[FramePart]:
    """Return the parts of a frame, after the stages that couple its pixels were done once for the whole frame."""
    if task.resume and (kept := kept_maps(task)):
        return kept
    recording = task.reader.read(task.sources)
    stages = stages_of(recording.frame, task.plan, task.plan.read_calibration())
    pixels = prepare_frame(recording.frame, stages)
    first, *others = pixels.parts(count)
    return [FramePart(task, first, recording), *(FramePart(task, part, None) for part in others)]


def _joined(frame: list[Outcome[FramePart, DepthMaps | FrameReport]]) -> Outcome[FrameTask, FrameReport]:
    """Write the maps that a frame's parts make up; if parts failed, return the report of the first of these."""
    task = frame[0].task.task
    found: list[DepthMaps] = []
    for outcome in frame:
        if isinstance(outcome.result, FrameReport | WorkerDied):
            return Outcome(task, outcome.result)
        found.append(outcome.result)
    return Outcome(task, _written(task, frame[0].task, found))


@reported
def _written(task: FrameTask, first: FramePart, found: Sequence[DepthMaps]) -> FrameReport:
    """Write the maps that a frame's parts make up. The first part says how the frame was read."""
    assert isinstance(first.pixels, FramePixels)
    assert first.recording is not None
    resolved = joined_parts(first.pixels, found)
    return written(task, resolved, first.recording).wait(lambda: None)
