"""`cadtof evaluate`: the maps of a run against truth, beside what the first phasor alone would have said."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.discovery import Capture
from cadtof_cli.capture.frame_sources import FrameSource
from cadtof_cli.capture.frames import open_frames
from cadtof_cli.errors import CaptureError
from cadtof_cli.files.maps import read_layers
from cadtof_cli.maps.evaluation import DepthErrors, ErrorTally
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored, saturated_pixels
from cadtof_cli.units import metres_per_radian
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import read_run


@dataclass(frozen=True)
class Evaluation:
    """Errors of the direct depth, and of the first phasor's where the recorded frames are still there."""

    frames: int
    direct: DepthErrors
    first_phasor: DepthErrors | None


def evaluate_maps(maps: Path, /, *, truth: Path, progress: Progress) -> Evaluation:
    """Compare the direct depth of a folder of maps, or of one file, with the direct depth in a truth file.

    Raises:
        CadtofError: maps or truth cannot be read, hold no direct depth, differ in size, or hold z depth.
    """
    expected = direct_depth(truth)
    run = read_run(maps)
    run.require_range_depth()
    files, recorded = run.require_maps(), run.recorded_frames(progress.say)
    direct, first = ErrorTally(), ErrorTally()
    compared = 0
    for path in files:
        direct.add(same_size(direct_depth(path), expected, path, truth), expected)
        if run.name(path) in recorded:
            capture, source = recorded[run.name(path)]
            first.add(same_size(first_phasor_depth(capture, source), expected, source.paths[0], truth), expected)
            compared += 1
    return Evaluation(len(files), direct.summary(), first.summary() if compared == len(files) else None)


def first_phasor_depth(capture: Capture, source: FrameSource, /) -> Float:
    """Return the depth that the fundamental's phase alone gives, float64 (Y, X) in m: what MPI pulls off."""
    with open_frames(source, capture.layout) as frames:
        stored = frames.read(source.index or 0)
    metadata = capture.source.metadata
    planes = stored.reshape(*stored.shape[:2], -1)
    phasor = phasors_from_stored(planes, ideal_phasor_map(metadata, stored.dtype))[0]
    phasor[saturated_pixels(planes, metadata.voltage.saturated_counts)] = np.nan
    depth: Float = np.mod(np.angle(phasor), 2.0 * np.pi) * metres_per_radian(metadata.modulation.periods_ns[0])
    return depth.reshape(stored.shape[2:])


def direct_depth(path: Path, /) -> Float:
    """Return the direct depth in a map or truth file, float64 (Y, X) in m.

    Raises:
        CadtofError: the file cannot be read or has no such layer.
    """
    layers = read_layers(path)
    if DIRECT_DEPTH not in layers:
        raise CaptureError(f"{path}: found layers {', '.join(layers)}; expected {DIRECT_DEPTH}")
    return layers[DIRECT_DEPTH].astype(np.float64)


def same_size(depth: Float, expected: Float, path: Path, truth: Path, /) -> Float:
    """Return a depth read from `path` after making sure that it has the size of the one in `truth`."""
    if depth.shape != expected.shape:
        found, wanted = ("{1} × {0}".format(*shape) for shape in (depth.shape, expected.shape))
        raise CaptureError(f"{path}: found {found} pixels, expected {wanted} as in {truth}")
    return depth
