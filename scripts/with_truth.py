"""Functions for scripts that resolve frames with known true ranges: recorded, rendered, or simulated."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float, Stored
from cadtof_cli.capture.frames import Capture, read_stored, single_frames
from cadtof_cli.capture.metadata import CaptureMetadata, Pixel
from cadtof_cli.files.layers import read_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.pipeline.frame import ResolvedFrame, resolve_frame
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import MpiModel, ResolverSettings, SolverName
from cadtof_cli.simulation.pixel.averaging import averaging_gain
from cadtof_cli.simulation.pixel.statistics import VoltageStatistics
from cadtof_cli.simulation.scene.exposure import Band, Exposure, frame_voltages


def seed_range(text: str, /) -> range:
    """Return the seeds of an option, "FIRST-LAST" or one number."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def capture_truth(folder: Path, /) -> Float:
    """Return the true ranges of a capture, (Y, X), in m."""
    return read_layers(folder / "truth.exr")[DIRECT_DEPTH].astype(np.float64)


def first_stored(capture: Capture, /) -> Stored:
    """Return the stored values of a capture's first frame, (H, 2, Y, X)."""
    return read_stored(next(iter(single_frames(capture))), capture.layout)


def resolved(
    stored: Stored | Float, metadata: CaptureMetadata, /, *, model: MpiModel, solver: SolverName = "two-path"
) -> ResolvedFrame:
    """Return the maps of a frame, (H, 2, Y, X), by one model of its MPI."""
    settings = MapSettings(resolver=ResolverSettings(solver=solver, mpi_model=model))
    return resolve_frame(stored, plan=FramePlan(metadata=metadata, settings=settings))


def at_length(exposure: Exposure, whole: Band, length: float, /) -> tuple[Exposure, Band]:
    """Return an exposure and its light at another integration length; the light, `whole`, is not followed again."""
    gain = averaging_gain(length) / averaging_gain(exposure.integration_length)
    noisy = VoltageStatistics(whole.voltages.means_v, gain * whole.voltages.covariances_v2)
    metadata = replace(exposure.metadata, pixel=Pixel(integration_length=length))
    return replace(exposure, metadata=metadata), Band(noisy, whole.truth)


def with_length(exposure: Exposure, whole: Band, length: float, /) -> tuple[Float, CaptureMetadata]:
    """Return the volts of an exposure's frame, (H, 2, Y, X), at another integration length, and its metadata."""
    changed, light = at_length(exposure, whole, length)
    return frame_voltages(changed, light, 0), changed.metadata
