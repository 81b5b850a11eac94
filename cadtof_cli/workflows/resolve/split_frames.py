"""A slow frame's pixels, spread over processes: parts of its maps go to the workers, and the whole is written here."""

import math
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass

from cadtof_cli.arrays import Float32, Status
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.execution.ordered import Outcome, WorkerDied, run_ordered
from cadtof_cli.execution.workers import StartMethod
from cadtof_cli.maps.layers import empty_maps
from cadtof_cli.pipeline import ResolvedFrame, resolve_pixels
from cadtof_cli.workflows.resolve.frame_task import (
    FrameReport,
    FrameTask,
    attempted,
    read_frame,
    reused_maps,
    written,
)

WORTH_SPLITTING_S = 0.5
"""Expected seconds a frame above which its parts are worth a process each: every part reads the whole frame."""


@dataclass(frozen=True)
class FramePart:
    """Part `index` of `count` of a frame's pixels."""

    task: FrameTask
    index: int
    count: int

    def pixels(self, size: tuple[int, int], /) -> range:
        """Return the part's flat indices in maps of the given (Y, X)."""
        total = math.prod(size)
        return range(self.index * total // self.count, (self.index + 1) * total // self.count)


@dataclass(frozen=True)
class PartMaps:
    """The maps of a part: layers, float32 (layer, n), status, (n,), and what goes into the frame's report."""

    size: tuple[int, int]
    values: Float32
    status: Status
    integration_length: float
    noise_estimated: bool
    left_out: str | None


def worth_splitting(tasks: int, jobs: int, seconds_per_frame: float, /) -> bool:
    """Whether frames are so few and so slow that their pixels should be spread over the processes."""
    return tasks < jobs and seconds_per_frame > WORTH_SPLITTING_S


def resolve_part(part: FramePart, /) -> PartMaps | FrameReport:
    """Read a frame and resolve a part of its pixels. Whatever is wrong with it becomes a report, never an exception."""
    keep_freed_memory()
    task = part.task

    def resolve() -> PartMaps:
        frame = read_frame(task)
        height, width = frame.mean.stored.shape[2:]
        pixels = part.pixels((height, width))
        maps = reused_maps(height, width, task.plan.layers)
        noise = resolve_pixels(frame.mean, plan=task.plan, maps=maps, pixels=pixels)
        some = slice(pixels.start, pixels.stop)
        return PartMaps(
            (height, width),
            maps.values.reshape(len(maps.names), -1)[:, some].copy(),
            maps.status.reshape(-1)[some].copy(),
            noise.integration_length,
            noise.estimated,
            frame.left_out,
        )

    return attempted(task, resolve, began=time.monotonic())


def resolve_split(
    tasks: Iterable[FrameTask], /, *, jobs: int, start_method: StartMethod
) -> Generator[Outcome[FrameTask, FrameReport], None, None]:
    """Resolve and write every frame, in the order of the tasks, each by as many parts as there are jobs."""
    parts = (FramePart(task, index, jobs) for task in tasks for index in range(jobs))
    with closing(run_ordered(resolve_part, parts, jobs=jobs, start_method=start_method)) as outcomes:
        while frame := _next_frame(outcomes, jobs):
            yield _whole(frame)


def _next_frame(
    outcomes: Iterator[Outcome[FramePart, PartMaps | FrameReport]], jobs: int
) -> list[Outcome[FramePart, PartMaps | FrameReport]]:
    return [outcome for _, outcome in zip(range(jobs), outcomes, strict=False)]


def _whole(frame: list[Outcome[FramePart, PartMaps | FrameReport]]) -> Outcome[FrameTask, FrameReport]:
    """Write the maps that a frame's parts make up, or report what went wrong with the first that has none."""
    began, task = time.monotonic(), frame[0].task.task
    found: list[PartMaps] = []
    for outcome in frame:
        if isinstance(outcome.result, FrameReport | WorkerDied):
            return Outcome(task, outcome.result)
        found.append(outcome.result)

    def write() -> FrameReport:
        first = found[0]
        maps = empty_maps(*first.size, layers=task.plan.layers)
        for outcome, part in zip(frame, found, strict=True):
            pixels = outcome.task.pixels(first.size)
            some = slice(pixels.start, pixels.stop)
            maps.values.reshape(len(maps.names), -1)[:, some] = part.values
            maps.status.reshape(-1)[some] = part.status
        resolved = ResolvedFrame(maps, first.integration_length, first.noise_estimated)
        return written(task, resolved, left_out=first.left_out, began=began)

    return Outcome(task, attempted(task, write, began=began))
