"""A slow frame's pixels, spread over processes: it is read, prepared and written here, its parts are resolved by workers."""

import itertools
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing

from cadtof_cli.execution.ordered import Outcome, WorkerDied, Workers, run_ordered
from cadtof_cli.execution.workers import keep_freed_memory
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.frame_pixels import FramePixels
from cadtof_cli.pipeline import joined_parts, prepare_frame, resolve_pixels
from cadtof_cli.records import dataclass
from cadtof_cli.workflows.resolve.frame_task import FrameTask, Recording, attempted, kept_maps, read_frame, written
from cadtof_cli.workflows.resolve.record import FrameReport


@dataclass(frozen=True)
class FramePart:
    """A part of a frame's pixels, or a report of why the frame has none; and what it was read from."""

    task: FrameTask
    pixels: FramePixels | FrameReport
    recording: Recording | None


def resolve_part(part: FramePart, /) -> DepthMaps | FrameReport:
    """Resolve a part of a frame's pixels. Whatever is wrong with it becomes a report, never an exception."""
    keep_freed_memory()
    pixels, task = part.pixels, part.task
    if isinstance(pixels, FrameReport):
        return pixels
    return attempted(
        task,
        lambda: resolve_pixels(pixels, plan=task.plan, calibration=task.calibration()),
        began=time.monotonic(),
    )


def resolve_split(
    tasks: Iterable[FrameTask], /, *, workers: Workers
) -> Generator[Outcome[FrameTask, FrameReport], None, None]:
    """Resolve and write every frame, in the order of the tasks, each by as many parts as there are jobs."""
    parts = (part for task in tasks for part in _parts(task, workers.jobs))
    resolved: Generator[Outcome[FramePart, DepthMaps | FrameReport], None, None]
    resolved = run_ordered(resolve_part, parts, workers=workers)
    with closing(resolved) as outcomes:
        while frame := list(itertools.islice(outcomes, workers.jobs)):
            yield _whole(frame)


def _parts(task: FrameTask, count: int) -> Iterator[FramePart]:
    """Yield the parts of a frame after all that couples its pixels has been done, once."""

    began = time.monotonic()

    def prepared() -> FrameReport | list[FramePart]:
        kept = kept_maps(task, began=began) if task.resume else None
        if kept is not None:
            return kept
        frame, recording = read_frame(task)
        pixels = prepare_frame(frame, plan=task.plan, calibration=task.calibration())
        return [FramePart(task, part, recording) for part in pixels.parts(count)]

    parts = attempted(task, prepared, began=began)
    yield from [FramePart(task, parts, None)] * count if isinstance(parts, FrameReport) else parts


def _whole(frame: list[Outcome[FramePart, DepthMaps | FrameReport]]) -> Outcome[FrameTask, FrameReport]:
    """Write the maps that a frame's parts make up, or report what went wrong with the first that has none."""
    began, first = time.monotonic(), frame[0].task
    found: list[DepthMaps] = []
    for outcome in frame:
        if isinstance(outcome.result, FrameReport | WorkerDied):
            return Outcome(first.task, outcome.result)
        found.append(outcome.result)

    def write() -> FrameReport:
        assert isinstance(first.pixels, FramePixels)
        assert first.recording is not None
        resolved = joined_parts(first.pixels, found)
        return written(first.task, resolved, first.recording, began=began).wait(lambda: None)

    return Outcome(first.task, attempted(first.task, write, began=began))
