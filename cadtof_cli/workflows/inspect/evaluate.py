"""`cadtof evaluate`: the maps of a run against truth, beside what the first phasor alone would have said."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cadtof_cli.arrays import Float
from cadtof_cli.capture.discovery import Capture, find_captures
from cadtof_cli.capture.reader import open_frames
from cadtof_cli.capture.stacks import single_frames
from cadtof_cli.errors import CadtofError, CaptureError, SettingsError
from cadtof_cli.files.frames import FrameSource
from cadtof_cli.files.layers import MAP_SUFFIXES, read_layers
from cadtof_cli.maps.evaluation import DepthErrors, ErrorTally
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.phasors.voltages import phasor_scale, phasors_from_voltages, saturated_pixels
from cadtof_cli.units import metres_per_radian
from cadtof_cli.workflows.resolve.run_record import RUN_FILE


@dataclass(frozen=True)
class Evaluation:
    """Errors of the direct depth, and of the first phasor's where the recorded frames are still there."""

    frames: int
    direct: DepthErrors
    first_phasor: DepthErrors | None

    def as_json(self) -> dict[str, Any]:
        """Return the evaluation as a JSON object."""
        return asdict(self)


def evaluate_maps(maps: Path, /, *, truth: Path, on_note: Callable[[str], None]) -> Evaluation:
    """Compare the direct depth of a folder of maps, or of one file, with the direct depth in a truth file.

    Raises:
        CadtofError: maps or truth cannot be read, hold no direct depth, differ in size, or hold z depth.
    """
    expected = direct_depth(truth)
    require_range_depth(maps)
    files = list(map_files(maps))
    if not files:
        raise CaptureError(f"{maps}: found no maps (.exr, .tif), expected those of `cadtof resolve`")
    sources = _sources(_run_record(maps), on_note)
    direct, first = ErrorTally(), ErrorTally()
    compared = 0
    for path in files:
        direct.add(same_size(direct_depth(path), expected, path, truth), expected)
        if path.stem in sources:
            capture, source = sources[path.stem]
            first.add(same_size(first_phasor_depth(capture, source), expected, source.paths[0], truth), expected)
            compared += 1
    return Evaluation(len(files), direct.summary(), first.summary() if compared == len(files) else None)


def first_phasor_depth(capture: Capture, source: FrameSource, /) -> Float:
    """Return the depth that the fundamental's phase alone gives, float64 (Y, X) in m: what MPI pulls off."""
    with open_frames(source, capture.layout) as frames:
        stored = frames.read(source.index or 0)
    metadata = capture.source.metadata
    scale = phasor_scale(metadata, stored.dtype)
    planes = stored.reshape(*stored.shape[:2], -1)
    phasor = phasors_from_voltages(planes, scale=scale)[0]
    phasor[saturated_pixels(planes, scale=scale)] = np.nan
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


def map_files(maps: Path) -> Iterator[Path]:
    """Yield a folder's map files in the order of their names, or the one file."""
    if not maps.exists():
        raise CaptureError(f"{maps}: no such file or folder; expected maps that `cadtof resolve` wrote")
    if maps.is_file():
        yield maps
        return
    yield from sorted(p for p in maps.iterdir() if p.suffix in MAP_SUFFIXES and not p.name.startswith("."))


def find_source(path: Path, on_note: Callable[[str], None]) -> tuple[Capture, FrameSource] | None:
    """Return the recorded frame that a map file was made from, if it is still where `run.json` says."""
    return _sources(_run_record(path), on_note).get(path.stem)


def require_range_depth(maps: Path, /) -> None:
    """Make sure that maps, by the record of their run, can be held against truth, which is radial range."""
    run = _run_record(maps)
    if run is not None and run["arguments"].get("depth") == "z":
        raise SettingsError(f"{maps}: holds z depth, and truth is radial range; resolve with --depth range to evaluate")


def _run_record(maps: Path) -> dict[str, Any] | None:
    path = (maps if maps.is_dir() else maps.parent) / RUN_FILE
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return record if record["arguments"].keys() >= {"inputs", "overrides"} else None
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None


def _sources(run: dict[str, Any] | None, on_note: Callable[[str], None]) -> dict[str, tuple[Capture, FrameSource]]:
    """Return where the recorded frame of every map lies, by the map's name; nothing, and a note, where that is not known."""
    if run is None:
        on_note(f"no {RUN_FILE} beside the maps, so the first phasor is not evaluated")
        return {}
    arguments = run["arguments"]
    try:
        captures = find_captures([Path(path) for path in arguments["inputs"]], overrides=arguments["overrides"])
        return {source.name: (capture, source) for capture in captures for source in single_frames(capture)}
    except (CadtofError, KeyError) as error:
        on_note(f"the recorded frames are not where they were, so the first phasor is not evaluated: {error}")
        return {}
