"""The reports on the frames of a run, which are the lines of `frames.jsonl`, and the totals of all reports."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, get_args

from cadtof_cli.records import dataclass
from cadtof_cli.resolver.status import StatusCounts
from cadtof_cli.workflows.recording import SourceFile

FrameStatus = Literal["ok", "failed", "skipped"]

_OUTCOMES = tuple(one.name for one in fields(StatusCounts))
"""What may become of a pixel; a report and the totals have a field for each."""

_MOST_SECONDS = 1e12
"""Limit on the time of a frame: JSON holds numbers that are too large for arithmetic."""


@dataclass(frozen=True)
class FrameReport:
    """The report on a frame: a line of `frames.jsonl`. All fields but the last three are keys of the line.

    Attributes:
        source: file of the frame, with the position in a stack.
        output: file of its maps; None if there is none.
        status: resolved (`ok`), failed or skipped.
        reason: why it failed or was skipped, or a remark on how it was resolved.
        seconds: time that it took.
        one_path, two_paths, diffuse, invalid: number of pixels with this outcome.
        more_paths: the same; a key only if pixels may have more than two paths.
        files: files that it was read from; None if one of them is missing.
        digest: digest of the values that were read, see `content_digest`.
        output_bytes: size of the map file.
        output_digest: digest of the bytes of the map file.
        kept: report of an earlier run whose maps are kept; it goes into `frames.jsonl` in place of this one. None: not kept.
        note: a message for the user that is not recorded.
        stops: whether the run must stop, because the next maps could not be written either.
    """

    source: str
    output: str | None
    status: FrameStatus
    reason: str | None
    seconds: float
    one_path: int | None = None
    two_paths: int | None = None
    more_paths: int | None = None
    diffuse: int | None = None
    invalid: int | None = None
    files: tuple[SourceFile, ...] | None = None
    digest: str | None = None
    output_bytes: int | None = None
    output_digest: str | None = None
    kept: "FrameReport | None" = None
    note: str | None = None
    stops: bool = False

    @property
    def is_valid(self) -> bool:
        """Whether the fields hold values of the right kinds. A line may come from anywhere."""
        texts = (self.output, self.reason, self.digest, self.output_digest)
        counts = (getattr(self, name) for name in (*_OUTCOMES, "output_bytes"))
        return (
            isinstance(self.source, str)
            and self.status in get_args(FrameStatus)
            and isinstance(self.seconds, int | float)
            and abs(self.seconds) < _MOST_SECONDS
            and all(isinstance(text, str | None) for text in texts)
            and (self.output is None or Path(self.output).name != "")
            and all(isinstance(count, int | None) for count in counts)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        line = {name: value for name, value in vars(self).items() if name in _JSON_FIELDS}
        if self.more_paths is None:
            del line["more_paths"]
        line["files"] = self.files and [vars(file) for file in self.files]
        return line


def failed_input(source: object, error: Exception, /) -> FrameReport:
    """Return the report on a frame without a task, or on an input of which no frame can be read: it counts as a frame."""
    return FrameReport(str(source), None, "failed", str(error), 0.0)


_JSON_FIELDS = frozenset(one.name for one in fields(FrameReport)) - {"kept", "note", "stops"}


def report_of(line: bytes, /) -> FrameReport | None:
    """Return the report that a line of `frames.jsonl` holds; None if it holds no valid report."""
    try:
        values = json.loads(line)
        files = values.get("files")
        known = None if files is None else tuple(SourceFile(**one) for one in files)
        report = FrameReport(**{**values, "files": known})
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None
    return report if report.is_valid else None


@dataclass
class RunTotals:
    """Counts of frames and pixels by their outcome.

    `diffuse_frames` counts the frames whose MPI was taken for diffuse. `already_there` counts the frames that were skipped
    because their maps were there.
    """

    frames: int = 0
    ok: int = 0
    failed: int = 0
    skipped: int = 0
    already_there: int = 0
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
        self.already_there += report.status == "skipped" and report.kept is not None
        for outcome in _OUTCOMES:
            setattr(self, outcome, getattr(self, outcome) + (getattr(report, outcome) or 0))
        self.diffuse_frames += bool(report.diffuse)
