"""`cadtof preview`: one picture of a frame's maps."""

from pathlib import Path

import numpy as np

from cadtof_cli.errors import CaptureError
from cadtof_cli.figures.maps import MapPicture, draw_maps
from cadtof_cli.files.atomic import whole_file
from cadtof_cli.files.maps import read_layers
from cadtof_cli.maps.layers import CONFIDENCE, DIRECT_DEPTH, DIRECT_SIGMA, MPI_DEPTH
from cadtof_cli.workflows.inspect.evaluate import direct_depth, first_phasor_depth, same_size
from cadtof_cli.workflows.progress import Progress
from cadtof_cli.workflows.run_folder import read_run


def preview_maps(maps: Path, /, *, out: Path, truth: Path | None, progress: Progress) -> None:
    """Draw the first map of a folder, or a map file, into the PNG `out`; with truth also the errors.

    Raises:
        CadtofError: the maps or the truth cannot be read or lack layers, or the PNG cannot be written.
    """
    path = read_run(maps).require_maps()[0]
    layers = read_layers(path)
    missing = [name for name in (DIRECT_DEPTH, MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA) if name not in layers]
    if missing:
        raise CaptureError(f"{path}: found layers {', '.join(layers)}; expected {', '.join(missing)} too")
    direct = layers[DIRECT_DEPTH].astype(np.float64)
    known, found = None, None
    if truth is not None:
        run = read_run(path)
        run.require_range_depth()
        known = direct_depth(truth)
        same_size(direct, known, path, truth)
        found = run.recorded_frames(progress.say).get(run.name(path))
    first_phasor = None if found is None else first_phasor_depth(*found)
    mpi, confidence, sigma = (layers[name].astype(np.float64) for name in (MPI_DEPTH, CONFIDENCE, DIRECT_SIGMA))
    picture = MapPicture(f"{path.parent.name}/{path.name}", direct, mpi, confidence, sigma, known, first_phasor)
    with whole_file(out) as temporary:
        draw_maps(picture, temporary)
