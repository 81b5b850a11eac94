"""How many frames of a run, and how many of their pixels, had which outcome."""

from typing import TYPE_CHECKING

from cadtof_cli.records import dataclass

if TYPE_CHECKING:
    from cadtof_cli.workflows.resolve.record import FrameReport


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

    def add(self, report: "FrameReport") -> None:
        """Count one more frame."""
        self.frames += 1
        setattr(self, report.status, getattr(self, report.status) + 1)
        if report.status == "skipped":
            self.already_there += report.is_already_there
        for kind in ("one_path", "two_paths", "more_paths", "diffuse", "invalid"):
            setattr(self, kind, getattr(self, kind) + (getattr(report, kind) or 0))
        self.diffuse_frames += bool(report.diffuse)
