"""What map files hold, for `cadtof info`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.capture.toml import FILE_NAME as CAPTURE_FILE
from cadtof_cli.errors import CadtofError
from cadtof_cli.files.formats import MAP_SUFFIXES
from cadtof_cli.files.maps import STATUS, read_facts, read_layers
from cadtof_cli.maps.layers import DIRECT_DEPTH, layer_unit
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.run_folder import RUN_FILE, is_run_folder, map_files, read_record, require_valid_record


@dataclass(frozen=True)
class LayerFacts:
    """One layer of a map: its unit, range and median over the pixels that have an answer, and their share."""

    unit: str
    lowest: float | None
    median: float | None
    highest: float | None
    valid: float


@dataclass
class MapFacts:
    """What a map file, or the first of a folder of them, holds; shares of pixels by status bit; the facts in its header; the
    run's record."""

    path: str
    files: int
    pixels: tuple[int, int] | None = None
    layers: dict[str, LayerFacts] = field(default_factory=dict)
    status: dict[str, float] = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    run: dict[str, Any] | None = None
    problems: list[str] = field(default_factory=list)


def is_map(path: Path, /) -> bool:
    """Tell whether a file, or the first image of a folder without a capture.toml, is a map or truth."""
    try:
        if path.is_dir() and not (path / CAPTURE_FILE).exists():
            inside = (one for one in path.iterdir() if one.suffix in MAP_SUFFIXES and one.is_file())
            path = min(inside, default=path)
        return path.suffix.lower() in MAP_SUFFIXES and path.is_file() and DIRECT_DEPTH in read_layers(path)
    except (CadtofError, OSError):
        return False


def facts_of_maps(path: Path, /) -> MapFacts:
    """Return what a map file, or a folder of maps, holds; a map that cannot be read is a problem."""
    files = map_files(path)
    facts = MapFacts(str(path), len(files))
    if is_run_folder(path):
        try:
            facts.run = dict(require_valid_record(read_record(path)))
        except OSError as error:
            facts.problems.append(f"{path / RUN_FILE}: cannot be read: {error.strerror or error}")
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            facts.problems.append(f"{path / RUN_FILE}: not the record of a run ({error})")
    if not files:
        facts.problems.append(f"{path}: found no maps")
    for index, file in enumerate(files):
        try:
            layers = read_layers(file)
            if index == 0:
                facts.about = read_facts(file)
        except CadtofError as error:
            facts.problems.append(str(error))
            continue
        if index == 0:
            _describe(facts, layers)
    return facts


def _describe(facts: MapFacts, layers: Mapping[str, NDArray[Any]]) -> None:
    for name, values in layers.items():
        if name == STATUS:
            bits = values.astype(np.uint32)
            facts.status = {str(bit.name).lower(): float(np.mean((bits & bit) != 0)) for bit in StatusBit}
            continue
        facts.pixels = (values.shape[0], values.shape[1])
        finite = values[np.isfinite(values)]
        figures = (finite.min(), np.median(finite), finite.max()) if finite.size else (None, None, None)
        lowest, median, highest = (None if figure is None else float(figure) for figure in figures)
        facts.layers[name] = LayerFacts(layer_unit(name), lowest, median, highest, finite.size / values.size)
