"""What becomes of frames: the lines of a run's `frames.jsonl`, and how many frames and pixels ended how."""

import json
from dataclasses import fields
from typing import Any, Literal, get_args

from cadtof_cli.records import dataclass

ALREADY_THERE = "exists already"
"""How the reason ends of a frame that is skipped since its maps are there."""

FrameStatus = Literal["ok", "failed", "skipped"]


@dataclass(frozen=True)
class SourceFile:
    """A file that a frame was read from, as it was then."""

    name: str
    bytes: int
    mtime_ns: int


@dataclass(frozen=True)
class FrameReport:
    """A line of `frames.jsonl`; the fields are its keys, `more_paths` only where pixels may have more than two.

    Attributes:
        source: where the frame lies.
        output: its maps; None where there are none.
        status: what has become of it.
        reason: why, or what there is to know besides.
        seconds: that it took.
        one_path, two_paths, more_paths, invalid: pixels.
        files: that it was read from; None where one of them is missing.
        digest: of the values that were read, see `files/digest.py`.
        output_bytes: size of its maps' file.
        output_digest: digest of that file's bytes.
        line: the frame's line, where that is not this report: of maps that an earlier run made and this one kept.
        note: what the user should know, and the record should not.
        stops: whether the next frame could not be written either.
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
    line: "FrameReport | None" = None
    note: str | None = None
    stops: bool = False

    @property
    def is_valid(self) -> bool:
        """Whether the fields hold what they should: a line may come from anywhere."""
        texts = (self.output, self.reason, self.digest, self.output_digest)
        counts = (self.one_path, self.two_paths, self.more_paths, self.diffuse, self.invalid, self.output_bytes)
        return (
            isinstance(self.source, str)
            and self.status in get_args(FrameStatus)
            and isinstance(self.seconds, int | float)
            and all(isinstance(text, str | None) for text in texts)
            and all(isinstance(count, int | None) for count in counts)
        )

    @property
    def is_already_there(self) -> bool:
        """Whether an earlier run has made the maps."""
        return self.status == "skipped" and str(self.reason).endswith(ALREADY_THERE)

    def as_json(self) -> dict[str, Any]:
        """Return the line as a JSON object."""
        line = {name: value for name, value in vars(self).items() if name in _JSON_FIELDS}
        if self.more_paths is None:
            del line["more_paths"]
        line["files"] = self.files and [vars(file) for file in self.files]
        return line


_JSON_FIELDS = frozenset(field.name for field in fields(FrameReport)) - {"line", "note", "stops"}


def report_of(line: bytes, /) -> FrameReport | None:
    """Return the report that a line of `frames.jsonl` holds; None where it holds none."""
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
    """What has become of the frames so far.

    `diffuse_frames` are those whose MPI was taken for diffuse, `already_there` those that were skipped since their maps are.
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
        if report.status == "skipped":
            self.already_there += report.is_already_there
        for kind in ("one_path", "two_paths", "more_paths", "diffuse", "invalid"):
            setattr(self, kind, getattr(self, kind) + (getattr(report, kind) or 0))
        self.diffuse_frames += bool(report.diffuse)
