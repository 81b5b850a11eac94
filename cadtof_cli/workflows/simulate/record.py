"""Record a simulated scene as a capture: bands of rows in parallel, then frames in parallel to disk, with the truth beside."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Pixel, Pulse, Target, Voltage
from cadtof_cli.capture.toml import FILE_NAME, toml_text
from cadtof_cli.errors import require
from cadtof_cli.execution.memory import keep_freed_memory
from cadtof_cli.execution.workers import ALONE, Workers
from cadtof_cli.files.atomic import new_folder
from cadtof_cli.files.formats import FRAME_FORMATS, TIFF, format_by_name
from cadtof_cli.files.frames import FrameLayout
from cadtof_cli.files.layers import write_layers
from cadtof_cli.records import setting
from cadtof_cli.simulation.pixel.mix import AT_REST, Motion
from cadtof_cli.simulation.pixel.pixel import IDEAL, PixelDefects
from cadtof_cli.simulation.scene.camera import Camera
from cadtof_cli.simulation.scene.exposure import Band, Exposure, band_rows, expose_bands, frame_voltages, joined
from cadtof_cli.simulation.scene.light import Scene
from cadtof_cli.simulation.scene.scenes import Wall
from cadtof_cli.version import __version__
from cadtof_cli.workflows.progress import NO_PROGRESS, Progress, results

MOST_BANDS = 16
"""Most bands that a process gets at once if there are several processes: larger shares would hide the progress."""


@dataclass(frozen=True, kw_only=True)
class RecordSettings:
    """How a capture is stored: how many frames, and in which files. TIFF files hold counts, EXR files volts."""

    frames: int = setting(1, "Number of frames of the capture.")
    frame_format: str = setting(TIFF.name, "File format of the frames.", option="--format", choices=FRAME_FORMATS)
    compress: bool = setting(False, "Compress the frames: Deflate in TIFF, ZIP in EXR.")

    def __post_init__(self) -> None:
        require(self.frames >= 1, "frames", self.frames, "1 or more")
        require(self.frame_format in FRAME_FORMATS, "format", self.frame_format, " or ".join(FRAME_FORMATS))


@dataclass(frozen=True)
class RecordReport:
    """The truth of a recorded capture: its median MPI/direct ratio, and its least and largest direct depth in m."""

    mpi_ratio: float
    depths_m: tuple[float, float]


def scene_exposure(
    scene: Scene,
    camera: Camera,
    /,
    *,
    modulation: Modulation,
    pulse: Pulse,
    integration_length: float | tuple[float, ...],
    seed: int,
    motion: Motion = AT_REST,
    defects: PixelDefects = IDEAL,
) -> Exposure:
    """Return the exposure of a scene, with the metadata for its `capture.toml`."""
    offset = getattr(scene, "lamp_offset_m", (0.0, 0.0, 0.0))
    metadata = CaptureMetadata(
        modulation=modulation,
        pixel=Pixel(integration_length=integration_length),
        pulse=pulse,
        voltage=camera.voltage,
        optics=replace(camera.optics, lamp_offset_m=offset) if any(offset) else camera.optics,
        target=Target(distance_m=scene.distance_m if isinstance(scene, Wall) else None),
    )
    return Exposure(scene=scene, camera=camera, metadata=metadata, seed=seed, motion=motion, defects=defects)


def record_scene(
    exposure: Exposure,
    out: Path,
    /,
    *,
    settings: RecordSettings,
    workers: Workers = ALONE,
    progress: Progress = NO_PROGRESS,
) -> RecordReport:
    """Write the capture to `out`, which must be absent or an empty folder. The files are the same for any number of jobs.

    The steps of the progress are the bands of rows, then the frames. Raise OutputError if `out` holds something or cannot be
    written, SettingsError if the scene cannot be recorded.
    """
    progress.advance(0, total=len(band_rows(exposure.camera.height)) + settings.frames)
    with new_folder(out) as folder:
        whole = expose(exposure, workers=workers, progress=progress)
        seen = np.isfinite(whole.truth["direct.depth"]).any()
        require(bool(seen), "scene", "nothing in view", "a surface there: bring the scene nearer")
        comments = _comments(exposure, settings.frames)
        write_capture(folder, (), exposure=exposure, settings=settings, truth=whole.truth, comments=comments)
        record = partial(_record_frame, _drawing(exposure, whole), partial(_write_frame, folder, exposure, settings))
        with closing(results(record, range(settings.frames), workers=workers, progress=progress)) as recorded:
            deque(recorded, maxlen=0)
    depth, ratio = whole.truth["direct.depth"], whole.truth["mpi.ratio"]
    return RecordReport(float(np.nanmedian(ratio)), (float(np.nanmin(depth)), float(np.nanmax(depth))))


def expose(exposure: Exposure, /, *, workers: Workers = ALONE, progress: Progress = NO_PROGRESS) -> Band:
    """Return the voltages and truth of a whole frame. The processes share its bands of rows.

    A process gets bands that lie together, because it keeps light of a room that its next band needs again.
    """
    # forked processes keep it, too
    keep_freed_memory()
    rows, bands = band_rows(exposure.camera.height), list[Band]()
    count = min(-(-len(rows) // workers.jobs), MOST_BANDS) if workers.jobs > 1 else 1
    shares = [rows[first : first + count] for first in range(0, len(rows), count)]
    for share in results(partial(expose_bands, exposure), shares, workers=workers, progress=NO_PROGRESS):
        bands += share
        progress.advance(len(share))
    return joined(bands)


def frames_of(exposure: Exposure, whole: Band, count: int, /) -> Iterator[Float]:
    """Yield so many frames, voltages in V (H, 2, Y, X) each, drawn from the distribution of a frame's voltages."""
    return map(_drawing(exposure, whole), range(count))


def _drawing(exposure: Exposure, whole: Band) -> Callable[[int], Float]:
    """Return the function that draws the frame of an index."""
    camera, harmonics = exposure.camera, len(exposure.metadata.modulation.harmonics)
    offsets = camera.dark_offsets_v(exposure.seed, harmonics) if camera.dark_offset_v > 0 else None
    return partial(frame_voltages, exposure, whole, offsets_v=offsets)


def _record_frame(draw: Callable[[int], Float], write: Callable[[int, Float], None], index: int) -> None:
    write(index, draw(index))


def _write_frame(folder: Path, exposure: Exposure, settings: RecordSettings, index: int, voltages_v: Float) -> None:
    """Write the frame of an index into the folder of its capture."""
    kind = format_by_name(settings.frame_format)
    stored = exposure.camera.counts_from_voltages(voltages_v) if kind.recording == "counts" else voltages_v
    layout = FrameLayout(exposure.metadata.modulation.harmonics)
    path = folder / f"frame_{index:04d}.{kind.name}"
    kind.frames().write_frame(path, stored, layout=layout, compress=settings.compress)


def _comments(exposure: Exposure, frames: int) -> tuple[str, ...]:
    return (
        f"simulated by cadtof {__version__}: {exposure.scene.summary}",
        f"scene: {exposure.scene!r}",
        f"camera: {exposure.camera!r}",
        *([f"motion: {exposure.motion!r}"] if exposure.motion.speed_m_s else []),
        *([f"pixels: {exposure.defects!r}"] if exposure.defects != IDEAL else []),
        f"frames: {frames}, seed: {exposure.seed}; truth per pixel in truth.exr",
    )


def write_capture(
    folder: Path,
    frames: Iterable[Float],
    /,
    *,
    exposure: Exposure,
    settings: RecordSettings,
    truth: Mapping[str, Float],
    comments: tuple[str, ...] = (),
) -> None:
    """Write frames, voltages in V (H, 2, Y, X) each, `capture.toml` and `truth.exr` into a folder that exists.

    `truth` holds layers by name, (Y, X) each, NaN where the truth is unknown; `comments` are lines at the top of `capture.toml`.
    """
    kind, metadata = format_by_name(settings.frame_format), exposure.told
    metadata = metadata if kind.recording == "counts" else replace(metadata, voltage=Voltage())
    (folder / FILE_NAME).write_text(toml_text(metadata, comments=comments), encoding="utf-8")
    write_layers(folder / "truth.exr", truth, lossy=True)
    for index, voltages_v in enumerate(frames):
        _write_frame(folder, exposure, settings, index, voltages_v)
