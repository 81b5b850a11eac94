"""`cadtof evaluate`: errors of a run's maps against truth, beside those of the first phasor alone; and scatter over time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cadtof_cli.errors import CaptureError, OutputError
from cadtof_cli.files.atomic import require_new, write_text
from cadtof_cli.files.documents import csv_text
from cadtof_cli.files.formats import EXR, format_by_suffix
from cadtof_cli.files.layers import write_layers
from cadtof_cli.maps.evaluation import DepthErrors, Evaluation, EvaluationTally, SequenceTally
from cadtof_cli.maps.layers import DIRECT_DEPTH, MPI_DEPTH
from cadtof_cli.units import counted
from cadtof_cli.workflows.inspect.first_phasors import first_phasors
from cadtof_cli.workflows.inspect.run_map import RunMap, require_same_size
from cadtof_cli.workflows.inspect.truth import Truth
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.resolve.lines import FRAMES_FILE
from cadtof_cli.workflows.run_folder import Run, read_run


@dataclass(frozen=True)
class Scatter:
    """Scatter of the direct depth in a sequence, measured and predicted: medians over the pixels; None: no pixel has any."""

    frames: int
    median_std_cm: float | None
    median_sigma_cm: float | None


def evaluate_maps(
    maps: Path,
    /,
    *,
    truth: Path,
    progress: Progress,
    table: Path | None,
    overwrite: bool,
    layer: str = DIRECT_DEPTH,
) -> Evaluation:
    """Compare a layer of depths of a folder of maps, or of one file, with that of the truth; a step of progress is a map.

    With the direct depth, the first phasor is compared too, over the same pixels: if a pixel has no answer in the maps, it has no
    first phasor either. `truth` is a file, or a folder with a file for each capture in the same tree as the maps. `table` is a
    CSV file to be written, with a line for each frame.

    Raises:
        CadtofError: maps or truth cannot be read, hold no direct depth, or differ in size; or range and
            z depth cannot be compared, because the optics are unknown.
    """
    if table is not None:
        require_new(table, overwrite=overwrite)
    run = read_run(maps)
    files = run.require_maps()
    known = Truth(truth, run, layer)
    known.tell_of_captures(progress.say)
    _tell_what_is_left_out(run, progress.say)
    recorded = first_phasors(run, progress.say) if layer == DIRECT_DEPTH else None
    whole, lines = EvaluationTally(), dict[str, Evaluation]()
    progress.advance(0, total=len(files))
    for one in (RunMap.read(run, file) for file in files):
        depth, sigma, expected = one.layer(layer), one.sigma(layer), known.depth(one)
        alone, of_frame = recorded.depth(one) if recorded else None, EvaluationTally()
        for tally in (whole, of_frame) if table is not None else (whole,):
            tally.add(depth, expected, sigma_m=sigma, first_phasor_m=alone)
        if table is not None:
            lines[run.name(one.file)] = of_frame.summary()
        progress.advance()
    if table is not None:
        _write_table(table, lines)
    return whole.summary()


def _tell_what_is_left_out(run: Run, say: Callable[[str], None]) -> None:
    """Say how many frames of the run have no maps, and whether it has not finished."""
    run.tell_if_unfinished(say)
    try:
        if lost := run.frames_without_maps():
            say(f"{run.maps}: {counted(lost, 'frame')} of the run without maps, not compared: see {FRAMES_FILE}")
    except CaptureError as error:
        say(f"frames of the run without maps are not counted: {error}")


def _write_table(path: Path, lines: Mapping[str, Evaluation]) -> None:
    """Write a line for each frame: its name, then the figures of the direct path and of the first phasor."""
    names = [field.name for field in fields(DepthErrors)]
    none = dict.fromkeys(names)
    rows = (
        (name, *vars(line.direct).values(), *(vars(line.first_phasor) if line.first_phasor else none).values())
        for name, line in lines.items()
    )
    write_text(path, csv_text(("frame", *names, *(f"first_phasor_{name}" for name in names)), rows))


def scatter_over_time(maps: Path, out: Path, /, *, progress: Progress, overwrite: bool) -> Scatter:
    """Write mean and standard deviation of each pixel's depths in a folder of maps, over time, as layers of an EXR file.

    The layers are `direct.mean`, `direct.std` and `direct.sigma` (root mean square of the predicted standard deviations) in m,
    and `direct.frames` (number of maps with an answer). If the maps have MPI depths, there are the same layers of `mpi`.

    Raises:
        CadtofError: maps cannot be read, hold no direct depth, or differ in size, kind of depth or part of the frames; or `out`
            cannot be written.
    """
    if format_by_suffix(out) is not EXR:
        raise OutputError(f"{out}: found the suffix {out.suffix!r}, expected .{EXR.name}")
    require_new(out, overwrite=overwrite)
    run = read_run(maps)
    files = run.require_maps()
    # raise SettingsError if the maps of a folder without a record are not alike
    _ = run.roi, run.depth_kind
    if run.captures_shown > 1:
        progress.say(
            f"{maps}: --over-time takes the maps of {run.captures_shown} captures for one scene at rest; the folder of one"
            " capture gives its own scatter"
        )
    _tell_what_is_left_out(run, progress.say)
    for stranger in run.unnamed_files():
        progress.say(
            f"{stranger}: {FRAMES_FILE} does not name it, so it may be of another run; it is counted all the same"
        )
    progress.advance(0, total=len(files))
    first = RunMap.read(run, files[0])
    shape = first.layer(DIRECT_DEPTH).shape
    tallies = {layer: SequenceTally(shape) for layer in (DIRECT_DEPTH, MPI_DEPTH) if layer in first.layers}
    for one in (RunMap.read(run, file) for file in files):
        require_same_size(one.layer(DIRECT_DEPTH), shape, one.file, files[0])
        for name, tally in tallies.items():
            values = one.layers.get(name, np.full(shape, np.nan))
            tally.add(values, one.sigma(name))
        progress.advance()
    planes: dict[str, NDArray[Any]] = {}
    for name, tally in tallies.items():
        planes |= {f"{name.removesuffix('.depth')}.{one}": plane for one, plane in vars(tally.summary()).items()}
    write_layers(out, planes)
    return Scatter(len(files), *(_median_cm(planes[f"direct.{one}"]) for one in ("std", "sigma")))


def _median_cm(plane: NDArray[Any]) -> float | None:
    finite = plane[np.isfinite(plane)]
    return float(100.0 * np.median(finite)) if finite.size else None
