"""What one recorded frame holds: the unit of work of `cadtof info`."""

import math
from dataclasses import dataclass, field

import numpy as np

from cadtof_cli.arrays import Stored
from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.errors import CadtofError
from cadtof_cli.files.formats import detect_format
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.phasors.noise import estimated_integration_length
from cadtof_cli.phasors.plausible import implausible
from cadtof_cli.phasors.voltages import ideal_phasor_map, not_finite_pixels, phasors_from_stored, saturated_pixels


@dataclass(frozen=True)
class LookTask:
    """A frame to look into; `pixels` is the (Y, X) that it should have."""

    source: FrameSource
    layout: FrameLayout
    metadata: CaptureMetadata
    pixels: tuple[int, int] | None


@dataclass(frozen=True)
class FrameFacts:
    """What a frame holds: the range of stored values a plane, shares of bad pixels, the n_av that its noise shows, and
    why its values cannot be voltages of the capture."""

    problem: str | None = None
    skipped: bool = False
    container: str = ""
    dtype: str = ""
    shape: tuple[int, ...] = ()
    planes: dict[str, tuple[float, float]] = field(default_factory=dict)
    saturated: float = 0.0
    not_finite: float = 0.0
    integration_length_seen: float = math.nan
    implausible: str | None = None


def facts_of_frame(task: LookTask, /) -> FrameFacts:
    """Read one frame and return what it holds; whatever is wrong with it is a `problem`, never an exception."""
    try:
        stored = read_stored(task.source, task.layout, size=task.pixels)
        container = detect_format(task.source.paths[0], raw=task.layout.raw is not None).name
        return _facts(stored, container, task)
    except NotAFrameError as error:
        return FrameFacts(problem=str(error), skipped=True)
    except CadtofError as error:
        return FrameFacts(problem=str(error))
    except MemoryError:
        return FrameFacts(problem=f"{task.source}: not enough memory for a frame of this size: try fewer --jobs")


def _facts(stored: Stored, container: str, task: LookTask) -> FrameFacts:
    planes = stored.reshape(*stored.shape[:2], -1)
    finite = [plane[np.isfinite(plane)] for channels in planes for plane in channels]
    ranges = {
        name: (float(plane.min()), float(plane.max()))
        for name, plane in zip(task.layout.plane_names, finite, strict=True)
        if plane.size
    }
    try:
        phasor_map = ideal_phasor_map(task.metadata, stored.dtype)
    except CadtofError:
        # what is missing is said once, for the whole capture
        return FrameFacts(container=container, dtype=str(stored.dtype), shape=stored.shape, planes=ranges)
    phasors = phasors_from_stored(planes, phasor_map)
    saturated = saturated_pixels(planes, task.metadata.voltage.saturated_counts)
    bad = not_finite_pixels(phasors)
    phasors[:, saturated] = np.nan
    return FrameFacts(
        container=container,
        dtype=str(stored.dtype),
        shape=stored.shape,
        planes=ranges,
        saturated=float(saturated.mean()),
        not_finite=float(bad.mean()),
        integration_length_seen=estimated_integration_length(phasors.reshape(-1, *stored.shape[2:])),
        implausible=implausible(stored, task.metadata),
    )
