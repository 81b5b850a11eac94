"""Record a simulated scene as a capture: bands of rows in parallel, then frame after frame to disk."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from cadtof_cli import __version__
from cadtof_cli.arrays import Float
from cadtof_cli.simulation.exposure import Band, Exposure, band_rows, expose_band, frame_voltages, joined
from cadtof_cli.simulation.mix import require
from cadtof_cli.simulation.recorder import FRAME_FORMATS, FrameFormat, write_capture
from cadtof_cli.workflows.record_folder import new_folder

Progress = Callable[[int, int], None]
"""Called with steps done and steps in all."""


@dataclass(frozen=True, kw_only=True)
class RecordSettings:
    """A capture to be made.

    Attributes:
        exposure: scene, camera, metadata and seed.
        frames: how many.
        frame_format: tif for counts, exr for volts.
        compress: smaller files, losslessly.
    """

    exposure: Exposure
    frames: int = 1
    frame_format: FrameFormat = "tif"
    compress: bool = False

    def __post_init__(self) -> None:
        require(self.frames >= 1, "frames", self.frames, "1 or more")
        require(self.frame_format in FRAME_FORMATS, "format", self.frame_format, " or ".join(FRAME_FORMATS))


@dataclass(frozen=True)
class RecordReport:
    """What was recorded: where, and the truth's median MPI/direct ratio and range of direct depths in metres."""

    folder: Path
    frames: int
    mpi_ratio: float
    depths_m: tuple[float, float]


def record_scene(
    settings: RecordSettings, out: Path, /, *, jobs: int = 1, progress: Progress | None = None
) -> RecordReport:
    """Write the capture to `out`, which must not exist; the files are the same for any number of jobs.

    Raises:
        OutputError: `out` exists or cannot be written.
        SettingsError: the scene cannot be recorded.
    """
    exposure = settings.exposure
    steps = len(band_rows(exposure.camera.height)) + settings.frames
    with new_folder(out) as folder:
        whole = expose(exposure, jobs=jobs, progress=progress and partial(_of, progress, steps, 0))
        frames = _frames(settings, whole, progress and partial(_of, progress, steps, steps - settings.frames))
        write_capture(
            folder,
            frames,
            truth=whole.truth,
            metadata=exposure.metadata,
            camera=exposure.camera,
            frame_format=settings.frame_format,
            compress=settings.compress,
            comments=_comments(settings),
        )
    depth = whole.truth["direct.depth"]
    return RecordReport(
        out,
        settings.frames,
        float(np.nanmedian(whole.truth["mpi.ratio"])),
        (float(np.nanmin(depth)), float(np.nanmax(depth))),
    )


def expose(exposure: Exposure, /, *, jobs: int = 1, progress: Callable[[int], None] | None = None) -> Band:
    """Return the voltages and truth of a whole frame, its bands shared among processes."""
    rows = band_rows(exposure.camera.height)
    pool: Executor | None = ProcessPoolExecutor(min(jobs, len(rows))) if jobs > 1 else None
    with pool or nullcontext():
        made = (pool.map if pool else map)(partial(expose_band, exposure), rows)
        bands = []
        for done, band in enumerate(made, start=1):
            bands.append(band)
            if progress:
                progress(done)
    return joined(bands)


def _frames(settings: RecordSettings, whole: Band, progress: Callable[[int], None] | None) -> Iterator[Float]:
    exposure = settings.exposure
    camera, harmonics = exposure.camera, len(exposure.metadata.modulation.harmonics)
    offsets = camera.dark_offsets_v(exposure.seed, harmonics) if camera.dark_offset_v > 0 else None
    for index in range(settings.frames):
        yield frame_voltages(exposure, whole, index, offsets_v=offsets)
        if progress:
            progress(index + 1)


def _of(progress: Progress, steps: int, before: int, done: int) -> None:
    progress(before + done, steps)


def _comments(settings: RecordSettings) -> tuple[str, ...]:
    exposure = settings.exposure
    return (
        f"simulated by cadtof {__version__}: {exposure.scene.summary}",
        f"scene: {exposure.scene!r}",
        f"camera: {exposure.camera!r}",
        f"frames: {settings.frames}, seed: {exposure.seed}; truth per pixel in truth.exr",
    )
