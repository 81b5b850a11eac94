"""One recorded frame → one file of maps: the unit of work that goes to a worker process."""

import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameLayout, FrameSource, NotAFrameError
from cadtof_cli.capture.reader import open_frames
from cadtof_cli.errors import CadtofError, FrameError
from cadtof_cli.maps.layers import DepthMaps, empty_maps
from cadtof_cli.maps.writer import write_maps
from cadtof_cli.pipeline import FramePlan, resolve_frame
from cadtof_cli.resolver.status import count_status

FrameStatus = Literal["ok", "failed", "skipped"]


@dataclass(frozen=True)
class FrameTask:
    """A frame to resolve. `pixels` is the (Y, X) that the capture's frames have; `token` marks temporary files."""

    source: FrameSource
    layout: FrameLayout
    plan: FramePlan
    pixels: tuple[int, int] | None
    output: Path
    keep_existing: bool = False
    token: str = ""


@dataclass(frozen=True)
class FrameReport:
    """A line of `frames.jsonl`; the fields are its keys."""

    source: str
    output: str | None
    status: FrameStatus
    reason: str | None
    seconds: float
    one_path: int | None = None
    two_paths: int | None = None
    invalid: int | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        return asdict(self)


def resolve_file(task: FrameTask, /) -> FrameReport:
    """Read, resolve and write one frame. Whatever is wrong with it becomes a report, never an exception."""
    began = time.monotonic()
    source = str(task.source)

    def report(status: FrameStatus, reason: str) -> FrameReport:
        return FrameReport(source, None, status, reason, _seconds_since(began))

    if task.keep_existing and task.output.exists():
        return report("skipped", f"{task.output} exists already")
    try:
        stored = _read(task)
        resolved = resolve_frame(stored, plan=task.plan, maps=_reused_maps(*stored.shape[2:]))
        write_maps(task.output, resolved.maps, token=task.token)
    except NotAFrameError as error:
        return report("skipped", str(error))
    except CadtofError as error:
        return report("failed", str(error))
    except MemoryError:
        return report("failed", "not enough memory for a frame of this size: try fewer --jobs")
    except Exception as error:  # noqa: BLE001  (one frame's surprise must not cost the others)
        return report("failed", f"unexpected {type(error).__name__}: {error}; please report it with the frame")
    counts = count_status(resolved.maps.status)
    reason = None
    if resolved.noise_estimated:
        reason = f"noise estimated from the frame: integration_length {resolved.integration_length:.4g}"
    return FrameReport(
        source,
        str(task.output),
        "ok",
        reason,
        _seconds_since(began),
        counts.one_path,
        counts.two_paths,
        counts.invalid,
    )


@lru_cache(maxsize=1)
def _reused_maps(height: int, width: int) -> DepthMaps:
    """Return this process's maps of that size: a frame's are written before the next frame's are computed."""
    return empty_maps(height, width)


def _read(task: FrameTask) -> Stored:
    with open_frames(task.source, task.layout) as frames:
        if task.source.index is None and frames.count != 1:
            raise FrameError(f"{task.source}: found {frames.count} frames, expected one as in files of the same size")
        stored: Stored = frames.read(task.source.index or 0)
    if task.pixels is not None and stored.shape[2:] != task.pixels:
        found, expected = ("{1} × {0}".format(*size) for size in (stored.shape[2:], task.pixels))
        raise FrameError(f"{task.source}: found {found} pixels, expected {expected} as in the capture's first frame")
    return stored


def _seconds_since(began: float) -> float:
    return round(time.monotonic() - began, 6)
