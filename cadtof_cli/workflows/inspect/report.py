"""`cadtof report`: the folder of a run → one HTML page."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cadtof_cli.arrays import Float
from cadtof_cli.errors import CadtofError, FrameError, OutputError, require
from cadtof_cli.files.atomic import require_new
from cadtof_cli.files.maps import STATUS
from cadtof_cli.maps.evaluation import EvaluationTally
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.records import setting
from cadtof_cli.report.colours import Limits, small_plane, widen
from cadtof_cli.report.frames import (
    ERROR,
    FIRST_PHASOR,
    FIRST_PHASOR_ERROR,
    TRUTH,
    EmbeddedFrame,
    PagePlan,
    Planes,
    embedded_frame,
    planned_page,
)
from cadtof_cli.report.page import ShownFrame, write_page
from cadtof_cli.workflows.inspect.first_phasors import FirstPhasors, first_phasors
from cadtof_cli.workflows.inspect.report_text import page_text
from cadtof_cli.workflows.inspect.run_map import GivenOptics, RunMap
from cadtof_cli.workflows.inspect.truth import Truth
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import Run, read_run

SUFFIXES = (".html", ".htm")

BYTES_PER_MB = 1_000_000

MOST_MB = 1_000_000
"""Largest page that can be asked for, in MB: far more than a browser opens."""


@dataclass(frozen=True, kw_only=True)
class ReportSettings(GivenOptics):
    """What a user can choose about a page, besides the optics."""

    truth: Path | None = setting(
        None,
        "File with the true direct.depth, or a folder with such a file, truth.exr, for each capture, in the same tree as "
        "OUT; truth and errors are shown too.",
    )
    max_size_mb: float = setting(
        25.0,
        "Largest size of the page. If it cannot hold all pixels of all frames, most frames keep every n-th pixel only; if that "
        "is still too much, only some frames are shown.",
        metavar="MB",
    )
    full_frames: int | None = setting(
        None,
        "Number of frames that keep all pixels, whatever the size.  [default: as many as fit into half of the size]",
    )
    overwrite: bool = setting(False, "Replace the page if it exists.")

    def __post_init__(self) -> None:
        require(1.0 <= self.max_size_mb <= MOST_MB, "--max-size-mb", f"{self.max_size_mb:g}", f"1 to {MOST_MB}")
        require(self.full_frames is None or self.full_frames >= 0, "--full-frames", self.full_frames, "0 or more")


def write_report(maps: Path, out: Path, /, *, settings: ReportSettings, progress: Progress) -> None:
    """Write the page of a run's folder, or of one of its maps.

    If a map cannot be read, the page says so and shows the other maps.

    Raises:
        CadtofError: there is neither a map that can be read nor a record, the truth cannot be read or has another size, or the
            page cannot be written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{out}: found the suffix {out.suffix!r}, expected {' or '.join(SUFFIXES)}")
    require_new(out, overwrite=settings.overwrite)
    run = read_run(maps)
    if run.record is None:
        run.require_maps()
    truth = None
    if settings.truth is not None:
        truth = Truth(settings.truth, run)
        truth.tell_of_captures(progress.say)
    gathered = _Gathered(run, settings, truth, first_phasors(run, progress.say))
    gathered.gather(progress)
    if run.record is None and not gathered.shown:
        raise FrameError(next(iter(gathered.problems.values())))
    given = settings.focal_length_px is not None or settings.principal_point_px is not None
    if given and all(one.optics.focal_length_px is None for one in gathered.shown.values()):
        progress.say(
            f"{run.maps}: no point cloud is shown: that needs --focal-length-px, and for maps of a --roi also "
            "--principal-point-px, counted from the corner of the maps"
        )
    errors = gathered.against_truth.summary()
    text = page_text(
        run,
        viewed=gathered.shown,
        depth_limits_m=gathered.limits.get(DIRECT_DEPTH, (0.0, 0.0))[:2],
        problems=gathered.problems,
        errors=errors.in_words if errors.frames else {},
    )
    write_page(out, text, frames=gathered.shown.values(), truth=gathered.truths.values(), limits=gathered.limits)


@dataclass(frozen=True)
class _Frame:
    """A frame of a run: the planes of its map and, if it is known, the truth."""

    file: Path
    planes: Planes
    truth_file: Path | None
    truth_m: Float | None


@dataclass
class _Gathered:
    """What the page needs of all maps of a run, gathered frame by frame.

    `shown` holds the frames of the viewer by the files of their maps, and `truths` each truth by its file and step.
    """

    run: Run
    settings: ReportSettings
    truth: Truth | None
    recorded: FirstPhasors
    shown: dict[Path, ShownFrame] = field(default_factory=dict)
    truths: dict[tuple[Path, int], EmbeddedFrame] = field(default_factory=dict)
    problems: dict[Path, str] = field(default_factory=dict)
    limits: dict[str, Limits] = field(default_factory=dict)
    against_truth: EvaluationTally = field(default_factory=EvaluationTally)

    def gather(self, progress: Progress) -> None:
        """Read all maps: count each, and show those that the page has room for; raises CadtofError if the truth does not fit."""
        files, settings = self.run.files, self.settings
        progress.advance(0, total=len(files))
        places = sorted({0, len(files) // 2, len(files) - 1}) if files else ()
        samples = list(self._frames([files[place] for place in places], {}))
        if not samples:
            list(self._frames(files, self.problems))
            return
        planes = [one.planes for one in samples]
        if len({one.truth_file for one in samples}) > 1:
            # the frames share one truth, unless there are several: then each frame needs room for its own
            planes = [one.planes if one.truth_m is None else {**one.planes, TRUTH: one.truth_m} for one in samples]
        limit_bytes = BYTES_PER_MB * settings.max_size_mb
        plan = planned_page(planes, len(files), limit_bytes=limit_bytes, whole=settings.full_frames)
        del samples, planes
        shown_files = {files[place] for place in plan.shown}
        for frame in self._frames(files, self.problems):
            self._count(frame)
            if frame.file in shown_files:
                self._show(frame, plan)
            progress.advance()

    def _frames(self, files: Sequence[Path], problems: dict[Path, str]) -> Iterator[_Frame]:
        """Yield the frames with maps that can be read; for the others, keep the reason in `problems`."""
        for file in files:
            try:
                one = RunMap.read(self.run, file)
                planes = self._planes(one)
            except CadtofError as error:
                problems[file] = str(error)
                continue
            truth_file = self.truth.file(file) if self.truth else None
            truth_m = self.truth.depth(one) if self.truth else None
            yield _Frame(file, planes, truth_file, truth_m)

    def _planes(self, one: RunMap) -> Planes:
        """Return a map's layers, and the first phasor's depth if the recorded frame is there and can be compared."""
        layers, first = dict(one.layers), self.recorded.depth(one)
        status = {STATUS: layers.pop(STATUS)} if STATUS in layers else {}
        return layers | ({} if first is None else {FIRST_PHASOR: first}) | status

    def _count(self, frame: _Frame) -> None:
        """Add a frame to the errors and to the limits of the layers."""
        planes, truth_m, first = frame.planes, frame.truth_m, frame.planes.get(FIRST_PHASOR)
        for layer, plane in planes.items():
            if layer != STATUS:
                widen(self.limits, layer, plane)
        if truth_m is not None:
            sigma = planes.get(DIRECT_SIGMA)
            self.against_truth.add(planes[DIRECT_DEPTH], truth_m, sigma_m=sigma, first_phasor_m=first)
            widen(self.limits, ERROR, planes[DIRECT_DEPTH] - truth_m)
            if first is not None:
                widen(self.limits, FIRST_PHASOR_ERROR, first - truth_m)

    def _show(self, frame: _Frame, plan: PagePlan) -> None:
        """Add a frame to those that the page shows, and its truth, unless a frame of the same capture added it before."""
        file, planes, truth = frame.file, frame.planes, None
        embedded = embedded_frame(planes, step=plan.step_of(len(self.shown)))
        if frame.truth_file is not None and frame.truth_m is not None:
            key = frame.truth_file, embedded.step
            if key not in self.truths:
                self.truths[key] = embedded_frame({TRUTH: frame.truth_m}, step=embedded.step)
            truth = list(self.truths).index(key)
        small_m = small_plane(planes[DIRECT_DEPTH], longest_px=plan.thumbnail_px)
        optics = self.settings.optics(self.run, file)
        self.shown[file] = ShownFrame(self.run.name(file), embedded, small_m, optics, self.run.depth_kind, truth)
