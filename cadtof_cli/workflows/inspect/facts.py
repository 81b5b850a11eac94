"""What a recorded frame, a map file and a calibration folder hold, for `cadtof info`."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.arrays import Stored
from cadtof_cli.calibration.store import load_calibration
from cadtof_cli.capture.frames import FrameSource, read_stored
from cadtof_cli.capture.metadata import CaptureMetadata
from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.doubts.frame import doubts
from cadtof_cli.doubts.plausible import implausible
from cadtof_cli.errors import CadtofError, CaptureError, no_memory_for
from cadtof_cli.files.documents import plain
from cadtof_cli.files.formats import MAP_SUFFIXES, detect_format
from cadtof_cli.files.frames import FrameLayout, NotAFrameError
from cadtof_cli.files.layers import read_facts, read_layers
from cadtof_cli.files.maps import STATUS, is_map_layer
from cadtof_cli.maps.layers import layer_unit
from cadtof_cli.phasors.noise import estimated_integration_length
from cadtof_cli.phasors.voltages import ideal_phasor_map, phasors_from_stored, saturated_pixels
from cadtof_cli.resolver.status import StatusBit, why_no_answer
from cadtof_cli.workflows.inspect.layers import first_sound_layers
from cadtof_cli.workflows.map_files import map_files
from cadtof_cli.workflows.recording import FrameReader
from cadtof_cli.workflows.run_folder import is_run_folder, read_run


@dataclass(frozen=True)
class FrameFacts:
    """What a recorded frame holds.

    Attributes:
        problem: why it could not be read; None: it was read.
        skipped: whether the file is sound, but no frame.
        container: name of the file format.
        dtype: type of the stored values.
        shape: shape of the frame, (H, 2, Y, X).
        planes: least and largest stored value of each plane, by its name.
        saturated: share of saturated pixels.
        not_finite: share of pixels with values that are not finite.
        integration_length_seen: the n_av that its noise shows.
        implausible: why its values cannot be voltages of the capture, or why its planes are hardly what they are read as.
    """

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


@dataclass(frozen=True)
class FrameLook:
    """A frame to be read: of the capture in this place, whose frames are read by the `reader`."""

    place: int
    source: FrameSource
    reader: FrameReader


def facts_of_frame(look: FrameLook, /) -> FrameFacts:
    """Read one frame and return what it holds. Every error becomes its `problem`."""
    source, reader = look.source, look.reader
    try:
        stored = read_stored(source, reader.layout, size=reader.pixels)
        container = detect_format(source.paths[0], raw=reader.layout.raw is not None).name
        return _facts(stored, container, reader.layout, reader.metadata)
    except NotAFrameError as error:
        return FrameFacts(problem=str(error), skipped=True)
    except CadtofError as error:
        return FrameFacts(problem=str(error))
    except MemoryError:
        return FrameFacts(problem=str(no_memory_for(source)))


def _facts(stored: Stored, container: str, layout: FrameLayout, metadata: CaptureMetadata) -> FrameFacts:
    planes = stored.reshape(*stored.shape[:2], -1)
    finite = [plane[np.isfinite(plane)] for channels in planes for plane in channels]
    ranges = {
        name: (float(plane.min()), float(plane.max()))
        for name, plane in zip(layout.plane_names, finite, strict=True)
        if plane.size
    }
    saturated = saturated_pixels(planes, metadata.voltage.saturated_counts)
    facts = FrameFacts(
        container=container,
        dtype=str(stored.dtype),
        shape=stored.shape,
        planes=ranges,
        saturated=float(saturated.mean()),
        not_finite=float(1.0 - np.isfinite(planes).all(axis=(0, 1)).mean()),
    )
    try:
        phasor_map = ideal_phasor_map(metadata, stored.dtype)
    except CadtofError:
        # the missing setting is reported once, for the whole capture
        return facts
    phasors = phasors_from_stored(planes, phasor_map)
    phasors[:, saturated] = np.nan
    return replace(
        facts,
        integration_length_seen=estimated_integration_length(
            phasors.reshape(-1, *stored.shape[2:]), metadata, quantised=stored.dtype.kind in "iu"
        ),
        implausible=implausible(stored, metadata)
        or (why_no_answer(np.array([StatusBit.NOT_FINITE], np.uint16)) if facts.not_finite == 1.0 else None)
        or "; ".join(doubts(stored, metadata))
        or None,
    )


@dataclass(frozen=True)
class LayerFacts:
    """One layer of a map: its unit, its range and median over the pixels that have an answer, and the share of these pixels."""

    unit: str
    lowest: float | None
    median: float | None
    highest: float | None
    valid: float


@dataclass
class MapFacts:
    """What a map file, or a folder of maps, holds.

    Attributes:
        path: the file or folder.
        files: number of map files.
        pixels: size (Y, X) of the first map that can be read.
        layers: the layers of that map, by name.
        status: share of its pixels by status bit.
        about: the facts in its header.
        run: the record of the run; None: there is none.
        problems: what is wrong, in words.
    """

    path: str
    files: int
    pixels: tuple[int, int] | None = None
    layers: dict[str, LayerFacts] = field(default_factory=dict)
    status: dict[str, float] = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    run: Mapping[str, Any] | None = None
    problems: list[str] = field(default_factory=list)


def is_map(path: Path, /) -> bool:
    """Return whether a file has layers of maps, as truth has too; in a folder without capture.toml, its first sound image."""
    try:
        if not path.is_dir():
            files = [path] if path.suffix.lower() in MAP_SUFFIXES and path.is_file() else []
        elif (path / CAPTURE_FILE).exists():
            files = []
        else:
            files = sorted(one for one in path.iterdir() if one.suffix in MAP_SUFFIXES and one.is_file())
    except OSError:
        return False
    return any(map(is_map_layer, first_sound_layers(files) or ()))


def facts_of_maps(path: Path, /) -> MapFacts:
    """Return what a map file, or a folder of maps, holds; a map that cannot be read is a problem."""
    facts, files = MapFacts(str(path), 0), None
    if is_run_folder(path):
        try:
            run = read_run(path)
            facts.run, files = run.record, run.files
            facts.problems += [] if run.record else [run.no_record]
        except CaptureError as error:
            facts.problems.append(str(error))
    files = map_files(path) if files is None else files
    facts.files = len(files)
    if not files:
        facts.problems.append(f"{path}: found no maps")
    described = False
    for file in files:
        try:
            layers = read_layers(file)
            if not described:
                facts.about, described = read_facts(file), True
                _describe(facts, layers)
        except CadtofError as error:
            facts.problems.append(str(error))
    return facts


def _describe(facts: MapFacts, layers: Mapping[str, NDArray[Any]]) -> None:
    for name, values in layers.items():
        if name == STATUS:
            facts.status = {str(bit.name).lower(): float(np.mean((values & bit) != 0)) for bit in StatusBit}
            continue
        facts.pixels = (values.shape[0], values.shape[1])
        finite = values[np.isfinite(values)]
        figures = (finite.min(), np.median(finite), finite.max()) if finite.size else (None, None, None)
        lowest, median, highest = (None if figure is None else float(figure) for figure in figures)
        facts.layers[name] = LayerFacts(layer_unit(name), lowest, median, highest, finite.size / values.size)


@dataclass
class CalibrationFacts:
    """The digest of a calibration folder, and for each of its parts the origin and the figures."""

    path: str
    digest: str | None = None
    parts: dict[str, dict[str, Any]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def facts_of_calibration(path: Path, /) -> CalibrationFacts:
    """Return what a calibration folder holds; a part that cannot be read, or is out of date, is a problem."""
    facts = CalibrationFacts(str(path))
    try:
        calibration = load_calibration(path)
    except CadtofError as error:
        facts.problems.append(str(error))
        return facts
    facts.digest = calibration.digest
    facts.problems += calibration.stale()
    for part in calibration.parts:
        origin = asdict(part.origin)
        del origin["used"]
        known = {"digest": calibration.digests[part.kind], **origin, "pixels": origin["pixels"][::-1]}
        facts.parts[part.kind] = plain(known | part.tables())
    return facts
