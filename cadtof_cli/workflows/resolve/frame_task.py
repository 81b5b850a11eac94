"""One recorded frame → one file of maps: the unit of work that goes to a worker process."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cadtof_cli.arrays import Stored
from cadtof_cli.calibration.store import Calibration, cached_calibration
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import open_frames
from cadtof_cli.errors import CadtofError, FrameError
from cadtof_cli.execution.workers import keep_freed_memory
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.files.maps import write_maps
from cadtof_cli.frame_plan import FramePlan
from cadtof_cli.phasors.frame_mean import FrameMean, frame_mean
from cadtof_cli.pipeline import ResolvedFrame, resolve_frame
from cadtof_cli.resolver.status import count_status
from cadtof_cli.workflows.run_folder import FrameReport, FrameStatus

Result = TypeVar("Result")


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

    def calibration(self) -> Calibration | None:
        """Return the calibration that the plan names, which each process reads once.

        Raises:
            MetadataError: it cannot be read, or has changed since the plan was made.
        """
        use = self.plan.calibration
        return cached_calibration(use.folder, use.digest) if use else None

    def report(self, status: FrameStatus, reason: str | None, seconds: float, /, **counts: Any) -> FrameReport:
        """Return what has become of the frame."""
        output = str(self.output) if status == "ok" else None
        return FrameReport(str(self.sources[0]), output, status, reason, round(seconds, 6), **counts)


def resolve_file(task: FrameTask, /) -> FrameReport:
    """Read, resolve and write one frame. Whatever is wrong with it becomes a report, never an exception."""
    keep_freed_memory()
    began = time.monotonic()

    def resolve() -> FrameReport:
        frame, left_out = read_frame(task)
        return written(
            task,
            resolve_frame(frame, plan=task.plan, calibration=task.calibration()),
            left_out=left_out,
            began=began,
        )

    return attempted(task, resolve, began=began)


def attempted(task: FrameTask, work: Callable[[], Result], /, *, began: float) -> Result | FrameReport:
    """Return what `work` on a frame returns, or a report of what kept it from returning."""
    status: FrameStatus = "failed"
    if task.keep_existing and task.output.exists():
        return task.report("skipped", f"{task.output} exists already", time.monotonic() - began)
    try:
        return work()
    except NotAFrameError as error:
        status, reason = "skipped", str(error)
    except CadtofError as error:
        reason = str(error)
    except MemoryError:
        reason = "not enough memory for a frame of this size: try fewer --jobs"
    except Exception as error:  # noqa: BLE001  (one frame's surprise must not cost the others)
        reason = f"unexpected {type(error).__name__}: {error}; please report it with the frame"
    return task.report(status, reason, time.monotonic() - began)


def written(task: FrameTask, resolved: ResolvedFrame, /, *, left_out: str | None, began: float) -> FrameReport:
    """Write a frame's maps and return its report; `left_out` says which frames of a mean could not be read."""
    write_maps(task.output, resolved.maps, token=task.token)
    counts = count_status(resolved.maps.status)
    reasons = [left_out] if left_out else []
    if resolved.noise_estimated:
        reasons.append(f"noise estimated from the frame: integration_length {resolved.integration_length:.4g}")
    return task.report(
        "ok",
        "; ".join(reasons) or None,
        time.monotonic() - began,
        one_path=counts.one_path,
        two_paths=counts.two_paths,
        more_paths=counts.more_paths if task.plan.settings.resolver.max_paths > 2 else None,
        diffuse=counts.diffuse,
        invalid=counts.invalid,
    )


def read_frame(task: FrameTask, /) -> tuple[Stored | FrameMean, str | None]:
    """Read a task's frame, or the mean of those of its frames that can be read; and say which could not (None: all could).

    Raises:
        FrameError: none of them can be read, or has the size of the capture's first.
    """
    if len(task.sources) == 1:
        return _stored(task, task.sources[0]), None
    errors: list[FrameError] = []

    def readable() -> Iterator[Stored]:
        for position, source in enumerate(task.sources, start=1):
            try:
                yield _stored(task, source)
            except FrameError as error:
                errors.append(error)
                if len(errors) == position == len(task.sources):
                    raise errors[0] from None

    mean = frame_mean(readable(), saturated_counts=task.plan.metadata.voltage.saturated_counts)
    return mean, f"{len(errors)} of {len(task.sources)} frames left out of the mean: {errors[0]}" if errors else None


def _stored(task: FrameTask, source: FrameSource) -> Stored:
    with open_frames(source, task.layout) as frames:
        if source.index is None and frames.count != 1:
            raise FrameError(f"{source}: found {frames.count} frames, expected one as in files of the same size")
        stored: Stored = frames.read(source.index or 0)
    if task.pixels is not None and stored.shape[2:] != task.pixels:
        found, expected = ("{1} × {0}".format(*size) for size in (stored.shape[2:], task.pixels))
        raise FrameError(f"{source}: found {found} pixels, expected {expected} as in the capture's first frame")
    return stored
