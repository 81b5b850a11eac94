"""What `cadtof preview` can draw: maps, truth, other files of named layers, and recorded frames, as layers by name."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.capture.discovery import find_captures, placed_captures
from cadtof_cli.capture.frames import Capture, FrameSource, read_stored, single_frames
from cadtof_cli.errors import SettingsError
from cadtof_cli.figures.layers import Shown
from cadtof_cli.files.layers import read_layers
from cadtof_cli.files.system import common_folder, path_from
from cadtof_cli.maps.layers import DIRECT_DEPTH
from cadtof_cli.phasors.voltages import saturated_pixels, volts_from_stored
from cadtof_cli.pipeline.plan import DEPTH_IN_WORDS
from cadtof_cli.resolver.status import StatusBit
from cadtof_cli.workflows.inspect.run_map import holds_maps
from cadtof_cli.workflows.run_folder import Run, read_run

LIGHT = "H1.amplitude"
"""The layer of a recorded frame that thumbnails and films show."""


@dataclass(frozen=True)
class Pictured:
    """A frame that can be drawn: its name, the function that reads it, its leading layer, and for a map its run and file."""

    name: str
    read: Callable[[], Shown]
    layer: str
    run: Run | None = None
    file: Path | None = None


def pictured(inputs: Sequence[Path], /, *, say: Callable[[str], None]) -> Iterator[Pictured]:
    """Yield every frame that can be drawn from folders of maps, map files, truth, captures and recorded frames.

    `say` is called with a note on each run that has not finished.

    Raises:
        CadtofError: an input does not exist, or holds nothing that can be drawn.
    """
    # frames of several inputs often have the same names, so their names begin below the folder that holds all inputs
    folders = (path if path.is_dir() else path.parent for path in inputs)
    base = common_folder(folders) if len(inputs) > 1 else None
    for path in inputs:
        # where there is no file, maps are missed first of all
        has_files = any(one.is_file() for one in itertools.chain([path], path.rglob("*")))
        if not has_files or holds_maps(path, or_other_layers=True):
            run = read_run(path)
            run.tell_if_unfinished(say)
            for file in run.require_maps():
                name = run.name(file) if base is None else Path(path_from(base, file)).with_suffix("").as_posix()
                yield Pictured(name, partial(_read_map, run, file), DIRECT_DEPTH, run, file)
            continue
        for capture in placed_captures(find_captures([path], recursive=path.is_dir()), [path], base=base)[0]:
            for source in single_frames(capture):
                yield Pictured(source.name, partial(_read_frame, capture, source), LIGHT)


def _read_map(run: Run, file: Path) -> Shown:
    """Read a map, or any file of named layers."""
    title = str(run.folder.name / file.relative_to(run.folder))
    return Shown.of(title, read_layers(file), depth=DEPTH_IN_WORDS[run.depth_kind])


def _read_frame(capture: Capture, source: FrameSource) -> Shown:
    """Read a recorded frame: volts, amplitudes and phases; only stored values if nothing says how many volts they are."""
    stored, metadata = read_stored(source, capture.layout), capture.source.metadata
    try:
        values, unit = volts_from_stored(stored, metadata.voltage), "V"
    except SettingsError:
        values, unit = stored.astype(np.float64), "counts"
    saturated = saturated_pixels(stored, metadata.voltage.saturated_counts)
    values[..., saturated] = np.nan
    layers: dict[str, NDArray[Any]] = {}
    for harmonic, (cosine, sine) in zip(metadata.modulation.harmonics, values, strict=True):
        layers |= {f"H{harmonic}.SC1": cosine, f"H{harmonic}.SC2": sine}
        if unit == "V":
            phase = np.mod(np.arctan2(sine, cosine), 2.0 * np.pi)
            layers |= {f"H{harmonic}.amplitude": np.hypot(cosine, sine), f"H{harmonic}.phase": phase}
    units = {name: "rad" if name.endswith(".phase") else unit for name in layers}
    bits = np.where(saturated, np.uint32(StatusBit.SATURATED), np.uint32(0))
    return Shown(f"{source}: as recorded", layers, units, bits)
