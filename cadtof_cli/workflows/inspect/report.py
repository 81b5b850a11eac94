"""`cadtof report`: the folder of a run → one HTML page."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cadtof_cli.arrays import Float, Float32
from cadtof_cli.errors import CadtofError, CaptureError, FrameError, OutputError, SettingsError
from cadtof_cli.files.atomic import require_new
from cadtof_cli.files.maps import STATUS, read_layers
from cadtof_cli.maps.evaluation import DepthErrors, EvaluationTally
from cadtof_cli.maps.layers import DIRECT_DEPTH, DIRECT_SIGMA
from cadtof_cli.records import setting
from cadtof_cli.report.colours import LayerLimits, small_plane
from cadtof_cli.report.frames import FIRST_PHASOR, TRUTH, EmbeddedFrame, Planes, Shares, embedded_frame, planned_shares
from cadtof_cli.report.page import ShownFrame, write_page
from cadtof_cli.workflows.inspect.first_phasors import FirstPhasors, first_phasors
from cadtof_cli.workflows.inspect.layers import GivenOptics, require_same_size, true_depth
from cadtof_cli.workflows.inspect.report_text import page_text
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import Run, read_run

SUFFIXES = (".html", ".htm")

BYTES_PER_MB = 1_000_000

_BESIDE_MAPS = 150_000
"""Bytes of a page's scripts, style and settings."""

_PER_FRAME = 1_500
"""Bytes of the texts about each frame on a page."""


@dataclass(frozen=True, kw_only=True)
class ReportSettings(GivenOptics):
    """What a user can choose, besides the optics."""

    truth: Path | None = setting(None, "File with the true direct.depth; truth and errors are shown too.")
    max_size_mb: float = setting(
        25.0,
        "Largest size of the page. If it cannot hold all pixels of all frames, most frames keep every n-th pixel only.",
        metavar="MB",
    )
    full_frames: int | None = setting(
        None,
        "Number of frames that keep all pixels, whatever the size.  [default: as many as fit into half of the size]",
    )
    overwrite: bool = setting(False, "Replace the page if it exists.")

    def __post_init__(self) -> None:
        if not self.max_size_mb >= 1.0:
            raise SettingsError(f"--max-size-mb: found {self.max_size_mb:g}, expected 1 or more")
        if self.full_frames is not None and self.full_frames < 0:
            raise SettingsError(f"--full-frames: found {self.full_frames}, expected 0 or more")


def write_report(maps: Path, out: Path, /, *, settings: ReportSettings, progress: Progress) -> None:
    """Write the page of a run's folder, or of one of its maps.

    A map that cannot be read is told on the page, and does not keep the others from it.

    Raises:
        CadtofError: there is neither a map nor a record, the truth cannot be read or is of another size, or the page cannot be
            written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{out}: found the suffix {out.suffix!r}, expected {' or '.join(SUFFIXES)}")
    require_new(out, overwrite=settings.overwrite)
    run = read_run(maps)
    if run.record is None:
        run.require_maps()
    truth = None if settings.truth is None else true_depth(run, settings.truth)
    reader = _Reader(run, settings, truth, first_phasors(run, progress.say))
    gathered = _gathered(reader, progress)
    text = page_text(
        run,
        maps=gathered.maps,
        depth_limits_m=gathered.limits.known().get(DIRECT_DEPTH, (0.0, 0.0))[:2],
        problems=gathered.problems,
        errors=gathered.errors(),
    )
    write_page(out, text, frames=gathered.shown, truth=gathered.truth, limits=gathered.limits.known())


@dataclass(frozen=True)
class _Reader:
    """How the planes of a frame are read: its maps, and beside them the depth of the first phasor."""

    run: Run
    settings: ReportSettings
    truth_m: Float | None
    recorded: FirstPhasors

    def planes(self, file: Path, /) -> Planes:
        """Return a map's layers, and the first phasor's depth where the recorded frame is there and can be compared."""
        layers = {name: plane for name, plane in read_layers(file).items() if plane.ndim == 2}
        if DIRECT_DEPTH not in layers:
            raise FrameError(f"{file}: found layers {', '.join(layers)}; expected {DIRECT_DEPTH}")
        direct = layers[DIRECT_DEPTH]
        if self.truth_m is not None and self.settings.truth is not None:
            require_same_size(direct, self.truth_m.shape, file, self.settings.truth)
        first = self.recorded.depth(file, direct)
        status = {STATUS: layers.pop(STATUS)} if STATUS in layers else {}
        return layers | ({} if first is None else {FIRST_PHASOR: first}) | status


@dataclass
class _Gathered:
    """What the page needs of all maps of a run."""

    shown: list[ShownFrame] = field(default_factory=list)
    truth: list[EmbeddedFrame] = field(default_factory=list)
    maps: dict[Path, Float32] = field(default_factory=dict)
    problems: dict[Path, str] = field(default_factory=dict)
    limits: LayerLimits = field(default_factory=LayerLimits)
    against_truth: EvaluationTally = field(default_factory=EvaluationTally)

    def errors(self) -> Mapping[str, DepthErrors]:
        """Return the errors against truth by what they are of; the first phasor's only where every map has one."""
        found = self.against_truth.summary()
        errors = {"first phasor": found.first_phasor, "direct path": found.direct} if found.frames else {}
        return {name: one for name, one in errors.items() if one is not None}

    def add(self, reader: _Reader, file: Path, planes: Planes, shares: Shares) -> None:
        """Add a map."""
        number = len(self.shown)
        embedded = embedded_frame(planes, step=shares.step_of(number))
        name = reader.run.name(file)
        self.shown.append(ShownFrame(name, embedded, reader.settings.optics(reader.run, file), reader.run.depth_kind))
        self.maps[file] = small_plane(planes[DIRECT_DEPTH], longest_px=shares.thumbnail_px)
        for layer, plane in planes.items():
            if layer != STATUS:
                self.limits.add(layer, plane)
        if reader.truth_m is not None:
            self._add_truth(reader.truth_m, planes, embedded.step)

    def _add_truth(self, truth_m: Float, planes: Planes, step: int) -> None:
        first, sigma = planes.get(FIRST_PHASOR), planes.get(DIRECT_SIGMA)
        self.against_truth.add(planes[DIRECT_DEPTH], truth_m, sigma_m=sigma, first_phasor_m=first)
        if not any(one.step == step for one in self.truth):
            self.truth.append(embedded_frame({TRUTH: truth_m}, step=step))


def _gathered(reader: _Reader, progress: Progress) -> _Gathered:
    gathered = _Gathered()
    files = reader.run.files
    progress.total(len(files))
    samples = [planes for _, planes in _read(reader, _spread(files), _Gathered())]
    if not samples:
        list(_read(reader, files, gathered))
        return gathered
    room = BYTES_PER_MB * reader.settings.max_size_mb - _BESIDE_MAPS - _PER_FRAME * len(files)
    shares = planned_shares(samples, len(files), limit_bytes=max(room, 0.0), whole=reader.settings.full_frames)
    del samples
    for file, planes in _read(reader, files, gathered):
        gathered.add(reader, file, planes, shares)
        progress.advance()
    return gathered


def _spread(files: Sequence[Path]) -> Sequence[Path]:
    """Return the first, the middle and the last of the files."""
    return [files[place] for place in sorted({0, len(files) // 2, len(files) - 1})] if files else []


def _read(reader: _Reader, files: Sequence[Path], gathered: _Gathered) -> Iterator[tuple[Path, Planes]]:
    """Yield the planes of maps that can be read; of the others the reason is kept."""
    for file in files:
        try:
            planes = reader.planes(file)
        except CaptureError:
            raise
        except CadtofError as error:
            gathered.problems[file] = str(error)
            continue
        yield file, planes
