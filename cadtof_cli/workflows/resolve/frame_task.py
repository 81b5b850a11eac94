"""One recorded frame → one file of maps: the unit of work that goes to a worker process."""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeVar

from cadtof_cli.capture.frames import FrameSource
from cadtof_cli.doubts.frame import frame_doubts
from cadtof_cli.errors import (
    CadtofError,
    FrameError,
    NoiseError,
    PlaceError,
    SettingsError,
    UnreadableError,
    no_memory_for,
)
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.execution.outcome import Later
from cadtof_cli.files.atomic import PartialFile
from cadtof_cli.files.digests import file_digest
from cadtof_cli.files.frames import NotAFrameError
from cadtof_cli.files.layers import stage_maps
from cadtof_cli.files.maps import DepthMaps
from cadtof_cli.files.reading import read_through
from cadtof_cli.pipeline.frame import ResolvedFrame, resolve_frame
from cadtof_cli.pipeline.plan import FramePlan
from cadtof_cli.records import dataclass
from cadtof_cli.resolver.status import StatusCounts, why_no_answer
from cadtof_cli.resolver.two_path.kernel import count_status
from cadtof_cli.workflows.recording import FrameReader, Recording, files_of
from cadtof_cli.workflows.resolve.reports import FrameReport, FrameStatus

Result = TypeVar("Result")

WHOLE_S_NS = 10**9
COARSEST_TIMES_NS = 2 * WHOLE_S_NS
"""Times of files are cut to whole seconds by SFTP and exFAT, and to two seconds by FAT."""


@dataclass(frozen=True)
class FrameTask:
    """A frame to be resolved, or several frames whose mean is to be resolved.

    `resume` says whether existing maps may be kept, and `before` is the report of an earlier run on them. `token` marks
    temporary files.
    """

    sources: tuple[FrameSource, ...]
    reader: FrameReader
    plan: FramePlan
    output: Path
    resume: bool = False
    before: FrameReport | None = None
    token: str = ""

    def report(self, status: FrameStatus, reason: str | None, seconds: float, /, **more: Any) -> FrameReport:
        """Return the report on the frame."""
        output = self.output.as_posix() if status == "ok" else None
        return FrameReport(str(self.sources[0]), output, status, reason, round(seconds, 6), **more)

    def kept(self, line: FrameReport, seconds: float, /) -> FrameReport:
        """Return the report on a frame whose maps stay as an earlier run made them; `line` is its line in the record."""
        return self.report("skipped", f"{self.output} exists already", seconds, kept=line)

    def kept_line(self) -> FrameReport | None:
        """Return the line of an earlier run about the maps, with the paths of this run; None if the maps are not as recorded."""
        if self.before is None or _maps_changed(self.output, self.before):
            return None
        return replace(self.before, source=str(self.sources[0]), output=self.output.as_posix())


def reported(work: Callable[..., Result], /) -> Callable[..., Result | FrameReport]:
    """Return a function that does the work on a task and never fails: every error becomes the report on the frame."""

    @wraps(work)
    def attempted(task: FrameTask, /, *arguments: Any) -> Result | FrameReport:
        began = time.monotonic()
        status: FrameStatus = "failed"
        failed: CadtofError
        source = task.sources[0]
        try:
            return work(task, *arguments)
        except NotAFrameError as error:
            status, failed = "skipped", error
        except (SettingsError, NoiseError) as error:
            # its message says what is wrong, but not in which frame
            failed = type(error)(f"{source}: {error}")
        except CadtofError as error:
            failed = error
        except MemoryError:
            failed = no_memory_for(source)
        except Exception as error:  # noqa: BLE001  (an error that nobody expected must not stop the other frames)
            failed = FrameError(
                f"{source}: unexpected {type(error).__name__}: {error}; please report it with the frame"
            )
        note = kept = None
        # on a share that fails, maps may stay without a line, and the next run makes them again
        with suppress(OSError):
            if task.resume and isinstance(failed, FrameError) and task.output.is_file():
                note, kept = _kept_or_removed(task, failed)
        more = {"files": files_of(task.sources), "kept": kept, "note": note, "stops": isinstance(failed, PlaceError)}
        return task.report(status, str(failed), time.monotonic() - began, **more)

    return attempted


def _kept_or_removed(task: FrameTask, failed: FrameError) -> tuple[str, FrameReport | None]:
    """Remove the maps of an earlier content of a frame that failed, unless the frame may be as it was and its maps are.

    Return a note for the user, and the line of the maps if they were kept.
    """
    if isinstance(failed, UnreadableError):
        read_through(task.output)
        if kept := task.kept_line():
            return f"{task.output}: kept, because its recorded frame may be as it was", kept
    task.output.unlink()
    return f"{task.output}: removed, because its recorded frame cannot be resolved any more", None


@reported
def resolve_file(task: FrameTask, /) -> FrameReport | Later[FrameReport]:
    """Read, resolve and write one frame. The steps that wait for the disk are left for later."""
    keep_freed_memory()
    if task.resume and (kept := kept_maps(task)):
        return kept
    recording = task.reader.read(task.sources)
    resolved = resolve_frame(recording.frame, plan=task.plan, calibration=task.plan.read_calibration())
    return written(task, resolved, recording)


def written(task: FrameTask, resolved: ResolvedFrame, recording: Recording, /) -> Later[FrameReport]:
    """Prepare the file of a frame's maps. The report on the frame comes later, when the file is on the disk.

    Raises:
        FrameError: no pixel has an answer; then nothing is written.
        OutputError: see `stage_maps`.
    """
    maps, counts = answered_maps(resolved, task.plan, source=task.sources[0])
    doubts = [told for told in (recording.left_out, *frame_doubts(recording.stored, maps, counts, task.plan)) if told]
    remarks = [told for told in (_why_again(task) if task.resume else None, *doubts) if told]
    header = task.plan.header.of_frame(task.sources[0].file_name)
    file, output_digest = stage_maps(task.output, maps, header=header, token=task.token)
    reasons = doubts
    if resolved.noise.estimated:
        reasons.append(f"noise estimated from the frame: integration_length {resolved.noise.integration_length:.4g}")
    report = task.report(
        "ok",
        "; ".join(reasons) or None,
        0.0,
        **vars(counts) | ({} if task.plan.settings.resolver.max_paths > 2 else {"more_paths": None}),
        files=recording.files,
        digest=recording.digest,
        output_digest=output_digest,
        note=f"{task.output}: {'; '.join(remarks)}" if remarks else None,
    )
    return Later(partial(_committed, task, file, report, recording.began))


@reported
def _committed(
    _task: FrameTask, file: PartialFile, report: FrameReport, began: float, let_go: Callable[[], None], /
) -> FrameReport:
    """Wait until a frame's maps are on the disk, and complete the report. `let_go` is called when no memory holds the maps."""
    size = file.commit(let_go)
    return replace(report, output_bytes=size, seconds=round(time.monotonic() - began, 6))


def answered_maps(resolved: ResolvedFrame, plan: FramePlan, /, *, source: object) -> tuple[DepthMaps, StatusCounts]:
    """Return the maps of a frame, cropped to the pixels of `--roi`, and their status counts. Messages name the `source`.

    Raises:
        FrameError: no pixel has an answer.
    """
    roi = plan.settings.roi
    maps = resolved.maps.cropped(roi) if roi else resolved.maps
    counts = count_status(maps.status)
    if counts.invalid == maps.status.size:
        raise FrameError(f"{source}: {why_no_answer(maps.status, noise_estimated=resolved.noise.estimated)}")
    return maps, counts


def kept_maps(task: FrameTask, /) -> FrameReport | None:
    """Return the report on the maps of an earlier run if neither maps nor frame have changed; None: resolve the frame.

    The frame's values are read and compared only if its files may have changed: if a size or modification time differs, or if a
    file was touched after the maps were written (ctime). A modification time can be set back, ctime cannot.

    Raises:
        FrameError: the frame cannot be read any more, or its file holds something else now.
    """
    began, line, files = time.monotonic(), task.kept_line(), files_of(task.sources)
    if line is None or files is None:
        return None
    if (files != line.files or _touched_since(task)) and task.reader.read(task.sources).digest != line.digest:
        return None
    return task.kept(replace(line, files=files), time.monotonic() - began)


def _why_again(task: FrameTask) -> str | None:
    """Return in words why existing maps are made again; None: there are no maps, for example because the frame failed."""
    if task.before is None:
        told = (
            "has no line in frames.jsonl, probably because a run was stopped" if os.path.lexists(task.output) else None
        )
    elif _maps_changed(task.output, task.before):
        told = "changed since it was written" if os.path.lexists(task.output) else "is gone"
    else:
        told = "its recorded frame has changed since"
    return told and f"{told}; made again"


def _maps_changed(path: Path, before: FrameReport) -> bool:
    try:
        return path.stat().st_size != before.output_bytes or file_digest(path) != before.output_digest
    except OSError:
        return True


def _touched_since(task: FrameTask) -> bool:
    written_ns = task.output.stat().st_mtime_ns
    touched = [path.stat().st_ctime_ns for source in task.sources for path in source.paths]
    # a time in whole seconds may have been cut
    return any(one + (0 if one % WHOLE_S_NS else COARSEST_TIMES_NS) >= written_ns for one in touched)
