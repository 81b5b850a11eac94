"""`cadtof info`: what captures, map files and calibration folders hold, and what is wrong with them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.calibration.store import is_calibration_folder, load_calibration
from cadtof_cli.capture.discovery import find_captures
from cadtof_cli.capture.frames import Capture
from cadtof_cli.errors import CadtofError, CaptureError
from cadtof_cli.execution.workers import Workers
from cadtof_cli.files.digests import file_digest
from cadtof_cli.files.documents import plain
from cadtof_cli.files.layers import read_facts, read_layers
from cadtof_cli.files.maps import STATUS
from cadtof_cli.maps.layers import layer_unit
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.inspect.capture_facts import CaptureFacts, facts_of_captures
from cadtof_cli.workflows.inspect.run_map import holds_maps
from cadtof_cli.workflows.map_files import map_files
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import is_run_folder, read_run


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


def facts_of_maps(path: Path, /) -> MapFacts:
    """Return what a map file, or a folder of maps, holds; a map that cannot be read is a problem."""
    facts, files, written = MapFacts(str(path), 0), None, dict[Path | None, str | None]()
    if is_run_folder(path):
        try:
            run = read_run(path)
            facts.run, files = run.record, run.files
            facts.problems += [] if run.record else [run.no_record]
            written = {run.map_of(report): report.output_digest for report in run.reports()}
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
            if (digest := written.get(file)) is not None and digest != file_digest(file):
                facts.problems.append(
                    f"{file}: changed since the run wrote it: damaged, or replaced by another program"
                )
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


Facts = CaptureFacts | MapFacts | CalibrationFacts


def look_into(
    inputs: Sequence[Path],
    /,
    *,
    overrides: Mapping[str, Any],
    workers: Workers,
    progress: Progress,
    settings_file: Path | None,
    recursive: bool,
) -> list[Facts]:
    """Return what each input holds. All frames of captures are read, so that damaged ones are found.

    An input that does not exist or holds nothing to look into, or whose `capture.toml` is not allowed, has that as a problem.

    Raises:
        CadtofError: this is so for all inputs.
    """
    found: list[Facts] = []
    recorded: list[Path] = []
    for path in inputs:
        if is_calibration_folder(path):
            found.append(facts_of_calibration(path))
        elif holds_maps(path):
            found.append(facts_of_maps(path))
        else:
            recorded.append(path)
    unlisted: dict[Path, CadtofError] = {}
    search = partial(
        find_captures,
        overrides=overrides,
        settings_file=settings_file,
        recursive=recursive,
        on_unlisted=unlisted.__setitem__,
    )
    wrong: dict[Path, CadtofError] = {}
    try:
        captures = search(recorded)
    except CadtofError:
        wrong = {path: error for path in recorded if (error := _error_of(search, path))}
        sound = [path for path in recorded if path not in wrong]
        if not (sound and wrong) and not found:
            raise
        captures = search(sound)
    progress.advance(0, total=sum(len(capture.frames) for capture in captures))
    for facts in facts_of_captures(captures, workers=workers, progress=progress):
        # a search through all folders below an input also finds pictures that are no frames
        if not (facts.frames or facts.problems or recursive):
            facts.problems.append(f"{facts.root}: no frames: none of its files holds the voltages of a frame")
        found.append(facts)
    found += [CaptureFacts(str(path), problems=[str(error)]) for path, error in (unlisted | wrong).items()]
    return found


def _error_of(search: Callable[[Sequence[Path]], Sequence[Capture]], path: Path) -> CadtofError | None:
    try:
        search([path])
    except CadtofError as error:
        return error
    return None
