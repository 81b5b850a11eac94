"""One recorded frame → one file of maps: the unit of work that goes to a worker process."""

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.reader import open_frames
from cadtof_cli.errors import CadtofError, FrameError
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.files.frames import FrameLayout, FrameSource, NotAFrameError
from cadtof_cli.files.maps import write_maps
from cadtof_cli.maps.layers import DepthMaps, LayerChoice, empty_maps
from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean
from cadtof_cli.pipeline import FramePlan, ResolvedFrame, resolve_frame
from cadtof_cli.resolver.status import count_status

Result = TypeVar("Result")

FrameStatus = Literal["ok", "failed", "skipped"]


@dataclass(frozen=True)
class FrameTask:
    """A frame to resolve, or several whose mean is.

    `pixels` is the (Y, X) that the capture's frames have; `token` marks temporary files.
    """

    sources: tuple[FrameSource, ...]
    layout: FrameLayout
    plan: FramePlan
    pixels: tuple[int, int] | None
    output: Path
    keep_existing: bool = False
    token: str = ""


@dataclass(frozen=True)
class FrameReport:
    """A line of `frames.jsonl`; the fields are its keys, `more_paths` only where pixels may have more than two."""

    source: str
    output: str | None
    status: FrameStatus
    reason: str | None
    seconds: float
    one_path: int | None = None
    two_paths: int | None = None
    more_paths: int | None = None
    invalid: int | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        line = asdict(self)
        if self.more_paths is None:
            del line["more_paths"]
        return line


def resolve_file(task: FrameTask, /) -> FrameReport:
    """Read, resolve and write one frame. Whatever is wrong with it becomes a report, never an exception."""
    keep_freed_memory()
    began = time.monotonic()

    def resolve() -> FrameReport:
        frame = read_frame(task)
        maps = reused_maps(*frame.mean.stored.shape[2:], task.plan.layers)
        resolved = resolve_frame(frame.mean, plan=task.plan, maps=maps)
        return written(task, resolved, left_out=frame.left_out, began=began)

    return attempted(task, resolve, began=began)


def attempted(task: FrameTask, work: Callable[[], Result], /, *, began: float) -> Result | FrameReport:
    """Return what `work` on a frame returns, or a report of what kept it from returning."""

    def report(status: FrameStatus, reason: str) -> FrameReport:
        return FrameReport(str(task.sources[0]), None, status, reason, seconds_since(began))

    if task.keep_existing and task.output.exists():
        return report("skipped", f"{task.output} exists already")
    try:
        return work()
    except NotAFrameError as error:
        return report("skipped", str(error))
    except CadtofError as error:
        return report("failed", str(error))
    except MemoryError:
        return report("failed", "not enough memory for a frame of this size: try fewer --jobs")
    except Exception as error:  # noqa: BLE001  (one frame's surprise must not cost the others)
        return report("failed", f"unexpected {type(error).__name__}: {error}; please report it with the frame")


def written(task: FrameTask, resolved: ResolvedFrame, /, *, left_out: str | None, began: float) -> FrameReport:
    """Write a frame's maps and return its report; `left_out` says which frames of a mean could not be read."""
    write_maps(task.output, resolved.maps, token=task.token)
    counts = count_status(resolved.maps.status)
    reasons = [left_out] if left_out else []
    if resolved.noise_estimated:
        reasons.append(f"noise estimated from the frame: integration_length {resolved.integration_length:.4g}")
    return FrameReport(
        str(task.sources[0]),
        str(task.output),
        "ok",
        "; ".join(reasons) or None,
        seconds_since(began),
        counts.one_path,
        counts.two_paths,
        counts.more_paths if task.plan.resolver.max_paths > 2 else None,
        counts.invalid,
    )


@lru_cache(maxsize=1)
def reused_maps(height: int, width: int, layers: LayerChoice) -> DepthMaps:
    """Return this process's maps of that size: a frame's are written before the next frame's are computed."""
    return empty_maps(height, width, layers=layers)


@dataclass(frozen=True)
class ReadFrame:
    """A task's frame, or the mean of its frames, and which of them could not be read (None: all could)."""

    mean: FrameMean
    left_out: str | None


def read_frame(task: FrameTask, /) -> ReadFrame:
    """Read a task's frame, or the mean of those of its frames that can be read.

    Raises:
        FrameError: none of them can be read, or has the size of the capture's first.
    """
    errors: list[FrameError] = []

    def readable() -> Iterator[Stored]:
        for position, source in enumerate(task.sources, start=1):
            try:
                yield _stored(task, source)
            except FrameError as error:
                errors.append(error)
                if len(errors) == position == len(task.sources):
                    raise errors[0] from None

    if len(task.sources) == 1:
        return ReadFrame(FrameMean.of_one(next(readable())), None)
    mean = frame_mean(readable(), saturated_counts=task.plan.metadata.voltage.saturated_counts)
    left_out = f"{len(errors)} of {len(task.sources)} frames left out of the mean: {errors[0]}" if errors else None
    return ReadFrame(mean, left_out)


def _stored(task: FrameTask, source: FrameSource) -> Stored:
    with open_frames(source, task.layout) as frames:
        if source.index is None and frames.count != 1:
            raise FrameError(f"{source}: found {frames.count} frames, expected one as in files of the same size")
        stored: Stored = frames.read(source.index or 0)
    if task.pixels is not None and stored.shape[2:] != task.pixels:
        found, expected = ("{1} × {0}".format(*size) for size in (stored.shape[2:], task.pixels))
        raise FrameError(f"{source}: found {found} pixels, expected {expected} as in the capture's first frame")
    return stored


def seconds_since(began: float, /) -> float:
    """Return the seconds since a time of the monotonic clock."""
    return round(time.monotonic() - began, 6)
